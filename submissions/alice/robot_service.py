#!/usr/bin/env python3
# Lab 09-01, part 3: service
# Alice M.

import rclpy
from rclpy.node import Node
from std_srvs.srv import SetBool


class RobotModeService(Node):
    """Service to enable and disable the robot."""

    def __init__(self):
        super().__init__('robot_mode_service')

        self.declare_parameter('max_velocity', 1.0)
        self.declare_parameter('safety_enabled', True)

        self.max_velocity = self.get_parameter('max_velocity').value
        self.safety_enabled = self.get_parameter('safety_enabled').value

        self.robot_enabled = False

        self.srv = self.create_service(SetBool, '/robot/enable', self.enable_callback)
        self.get_logger().info('service /robot/enable is ready')

    def enable_callback(self, request, response):
        if request.data:
            if self.safety_enabled:
                self.robot_enabled = True
                response.success = True
                response.message = 'Robot enabled'
                self.get_logger().info('Robot enabled')
            else:
                response.success = False
                response.message = 'Cannot enable: safety checks failed'
                self.get_logger().warn('enable request rejected, safety checks failed')
        else:
            # switching off is always allowed
            self.robot_enabled = False
            response.success = True
            response.message = 'Robot disabled'
            self.get_logger().info('Robot disabled')
        return response


def main(args=None):
    rclpy.init(args=args)
    node = RobotModeService()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.shutdown()


if __name__ == '__main__':
    main()
