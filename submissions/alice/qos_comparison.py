#!/usr/bin/env python3
# Lab 09-01, part 5: comparison of QoS profiles
# Alice M.

import time

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, HistoryPolicy, DurabilityPolicy
from std_msgs.msg import Float64MultiArray


class QoSComparisonNode(Node):

    def __init__(self):
        super().__init__('qos_comparison')

        self.profiles = {
            'best_effort': QoSProfile(
                reliability=ReliabilityPolicy.BEST_EFFORT,
                history=HistoryPolicy.KEEP_LAST,
                depth=1),
            'reliable': QoSProfile(
                reliability=ReliabilityPolicy.RELIABLE,
                history=HistoryPolicy.KEEP_LAST,
                depth=10),
            'sensor_data': QoSProfile(
                reliability=ReliabilityPolicy.BEST_EFFORT,
                history=HistoryPolicy.KEEP_LAST,
                depth=5,
                durability=DurabilityPolicy.VOLATILE),
            'control_command': QoSProfile(
                reliability=ReliabilityPolicy.RELIABLE,
                history=HistoryPolicy.KEEP_LAST,
                depth=1,
                durability=DurabilityPolicy.VOLATILE),
        }

        # the name self.publishers is taken by rclpy (AttributeError), so self.pubs
        self.pubs = {}
        self.counts = {}
        self.latencies = {}

        for name, qos in self.profiles.items():
            self.counts[name] = 0
            self.latencies[name] = []
            self.pubs[name] = self.create_publisher(Float64MultiArray, f'/test_{name}', qos)
            # n=name is needed, otherwise all lambdas use the last name
            self.create_subscription(
                Float64MultiArray, f'/test_{name}', lambda msg, n=name: self.callback(msg, n), qos)

        self.timer = self.create_timer(0.01, self.publish_all)
        self.start = time.time()

    def publish_all(self):
        for pub in self.pubs.values():
            msg = Float64MultiArray()
            msg.data = [time.time()]
            pub.publish(msg)

    def callback(self, msg, name):
        self.counts[name] += 1
        self.latencies[name].append(time.time() - msg.data[0])

    def print_results(self):
        print(f'QoS Comparison Results ({time.time() - self.start:.1f}s):')
        print('-' * 60)
        for name in self.profiles:
            lat = self.latencies[name]
            if lat:
                avg = sum(lat) / len(lat) * 1000
                print(f'{name:20s}: {self.counts[name]:5d} msgs, '
                      f'avg latency: {avg:.2f}ms, max: {max(lat) * 1000:.2f}ms')
            else:
                print(f'{name:20s}: {self.counts[name]:5d} msgs, no latency data')


def main(args=None):
    rclpy.init(args=args)
    node = QoSComparisonNode()
    end = time.time() + 10.0
    try:
        while rclpy.ok() and time.time() < end:
            rclpy.spin_once(node, timeout_sec=0.1)
    except KeyboardInterrupt:
        pass
    node.print_results()
    node.destroy_node()
    rclpy.shutdown()


if __name__ == '__main__':
    main()
