"""A lifecycle node that filters laser scans."""

import rclpy
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan


class ScanFilter(LifecycleNode):
    def __init__(self):
        super().__init__("scan_filter")
        self.publisher = None
        self.subscription = None

    def on_configure(self, state):
        self.publisher = self.create_lifecycle_publisher(LaserScan, "/scan_filtered", qos_profile_sensor_data)
        self.subscription = self.create_subscription(LaserScan, "/scan", self.on_scan, qos_profile_sensor_data)
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state):
        self.destroy_publisher(self.publisher)
        self.destroy_subscription(self.subscription)
        return TransitionCallbackReturn.SUCCESS

    def on_scan(self, scan):
        if not self.publisher.is_activated:
            return
        clamped = [min(max(r, scan.range_min), scan.range_max) for r in scan.ranges]
        filtered = list(clamped)
        for i in range(1, len(clamped) - 1):
            filtered[i] = sorted(clamped[i - 1 : i + 2])[1]
        scan.ranges = filtered
        self.publisher.publish(scan)


def main():
    rclpy.init()
    node = ScanFilter()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
