"""A lifecycle node that talks at the rate of a parameter, and plans straight paths."""

import rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from std_msgs.msg import String


class Talker(LifecycleNode):
    """Publishes a greeting on /chatter while it is active."""

    def __init__(self):
        """Declare the parameters, and offer the service."""
        super().__init__("talker")
        self.declare_parameter("rate_hz", 10.0)
        self.declare_parameter("greeting", "hello")
        self.add_on_set_parameters_callback(self.judge)
        self.add_post_set_parameters_callback(self.follow)
        self.create_service(GetPlan, "/plan", self.plan)
        self.publisher = self.timer = None

    def judge(self, parameters):
        """Refuse what cannot be."""
        for parameter in parameters:
            if parameter.name == "rate_hz" and parameter.value <= 0:
                return SetParametersResult(successful=False, reason="the rate must be positive")
            if parameter.name == "greeting" and not parameter.value:
                return SetParametersResult(
                    successful=False, reason="the greeting must not be empty"
                )
        return SetParametersResult(successful=True)

    def follow(self, parameters):
        """Make the timer anew."""
        if self.timer is not None:
            self.destroy_timer(self.timer)
            self.start_timer()

    def start_timer(self):
        """Start the timer with the present rate."""
        self.timer = self.create_timer(1.0 / self.get_parameter("rate_hz").value, self.talk)

    def talk(self):
        """Greet."""
        self.publisher.publish(String(data=self.get_parameter("greeting").value))

    def plan(self, request, response):
        """Plan three poses from the origin to the goal."""
        response.plan.header.frame_id = request.goal.header.frame_id or "map"
        for n in range(3):
            pose = PoseStamped()
            pose.pose.position.x = n / 2 * request.goal.pose.position.x
            pose.pose.position.y = n / 2 * request.goal.pose.position.y
            response.plan.poses.append(pose)
        return response

    def on_configure(self, state):
        """Make publisher and timer."""
        self.publisher = self.create_lifecycle_publisher(String, "/chatter", 10)
        self.start_timer()
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state):
        """Destroy them."""
        self.destroy_timer(self.timer)
        self.destroy_lifecycle_publisher(self.publisher)
        self.timer = self.publisher = None
        return TransitionCallbackReturn.SUCCESS


def main():
    """Run the node."""
    rclpy.init()
    node = Talker()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
