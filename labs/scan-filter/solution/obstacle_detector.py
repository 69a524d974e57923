"""Says how near the nearest thing is."""

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from scan_interfaces.msg import Obstacle
from sensor_msgs.msg import LaserScan


class ObstacleDetector(Node):
    def __init__(self):
        super().__init__("obstacle_detector")
        self.publisher = self.create_publisher(Obstacle, "/obstacle", 10)
        self.create_subscription(LaserScan, "/scan_filtered", self.on_scan, qos_profile_sensor_data)

    def on_scan(self, scan):
        index = min(range(len(scan.ranges)), key=scan.ranges.__getitem__)
        message = Obstacle()
        message.header = scan.header
        message.distance = float(scan.ranges[index])
        message.bearing = scan.angle_min + index * scan.angle_increment
        if message.distance < 0.5:
            message.state = Obstacle.BLOCKED
        elif message.distance < 1.5:
            message.state = Obstacle.NEAR
        else:
            message.state = Obstacle.FREE
        self.publisher.publish(message)


def main():
    rclpy.init()
    node = ObstacleDetector()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
