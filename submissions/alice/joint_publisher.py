#!/usr/bin/env python3
# Lab 09-01, part 1: publisher
# Alice M.

import math

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, HistoryPolicy
from std_msgs.msg import Float64MultiArray


class JointCommandPublisher(Node):
    """Publishes sinusoidal commands for the 7 joints of the arm."""

    def __init__(self):
        super().__init__('joint_command_publisher')

        qos = QoSProfile(
            reliability=ReliabilityPolicy.RELIABLE,
            history=HistoryPolicy.KEEP_LAST,
            depth=10,
        )
        self.pub = self.create_publisher(Float64MultiArray, '/joint_commands', qos)

        # a bit more than 10 ms, because publishing itself also needs some time
        # and otherwise the callbacks would overlap
        self.timer = self.create_timer(0.011, self.timer_callback)

        self.t = 0.0
        self.get_logger().info('publisher started')

    def timer_callback(self):
        msg = Float64MultiArray()
        q = [0.0] * 7
        q[0] = 0.5 * math.sin(2 * math.pi * 0.2 * self.t)
        q[1] = 0.3 * math.sin(2 * math.pi * 0.3 * self.t)
        # the other joints stay at zero
        msg.data = q
        self.pub.publish(msg)
        self.t += 0.01


def main(args=None):
    rclpy.init(args=args)
    node = JointCommandPublisher()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.shutdown()


if __name__ == '__main__':
    main()
