"""Drives a differential-drive robot to a goal."""

import math

import rclpy
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_srvs.srv import Trigger

TOLERANCE_M = 0.05
MAX_TURN_RADPS = 1.5


class GoToGoal(Node):
    def __init__(self):
        super().__init__("go_to_goal")
        self.max_speed = self.declare_parameter("max_speed", 0.5).value
        self.add_on_set_parameters_callback(self.on_parameters)
        self.pose = None
        self.goal = None
        self.publisher = self.create_publisher(Twist, "/cmd_vel", 10)
        self.create_subscription(Odometry, "/odom", self.on_odom, 10)
        self.create_subscription(PoseStamped, "/goal", self.on_goal, 10)
        self.create_service(Trigger, "/stop", self.on_stop)
        self.create_timer(0.05, self.on_timer)

    def on_parameters(self, parameters):
        for parameter in parameters:
            if parameter.name == "max_speed":
                if parameter.value < 0.0:
                    return SetParametersResult(successful=False, reason="max_speed must not be negative")
                self.max_speed = parameter.value
        return SetParametersResult(successful=True)

    def on_odom(self, message):
        position, q = message.pose.pose.position, message.pose.pose.orientation
        self.pose = position.x, position.y, 2.0 * math.atan2(q.z, q.w)

    def on_goal(self, message):
        self.goal = message.pose.position.x, message.pose.position.y

    def on_stop(self, request, response):
        self.goal = None
        self.publisher.publish(Twist())
        response.success = True
        response.message = "stopped"
        return response

    def on_timer(self):
        if self.goal is None or self.pose is None:
            return
        x, y, heading = self.pose
        dx, dy = self.goal[0] - x, self.goal[1] - y
        distance = math.hypot(dx, dy)
        command = Twist()
        if distance < TOLERANCE_M:
            self.goal = None
        else:
            error = math.atan2(dy, dx) - heading
            error = math.atan2(math.sin(error), math.cos(error))
            command.angular.z = max(-MAX_TURN_RADPS, min(MAX_TURN_RADPS, 2.0 * error))
            command.linear.x = min(self.max_speed, 1.0 * distance) * max(0.0, math.cos(error))
        self.publisher.publish(command)


def main():
    rclpy.init()
    node = GoToGoal()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
