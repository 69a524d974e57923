"""An action server that computes the Fibonacci sequence; a newer goal takes the place of the one under way."""

import time

import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from test_msgs.action import Fibonacci


class FibonacciServer(Node):
    """Serves /fibonacci."""

    def __init__(self):
        super().__init__("fibonacci_server")
        self.newest = None
        self.server = ActionServer(
            self,
            Fibonacci,
            "/fibonacci",
            execute_callback=self.execute,
            goal_callback=self.decide,
            handle_accepted_callback=self.begin,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
            callback_group=ReentrantCallbackGroup(),
        )

    def decide(self, goal):
        """Reject what cannot be computed."""
        return GoalResponse.ACCEPT if goal.order >= 0 else GoalResponse.REJECT

    def begin(self, handle):
        """Let a new goal take the place of the one before."""
        self.newest = handle
        handle.execute()

    def execute(self, handle):
        """Compute a number every tenth of a second."""
        feedback = Fibonacci.Feedback(sequence=[0, 1])
        for _ in range(handle.request.order - 1):
            time.sleep(0.1)
            if handle.is_cancel_requested:
                handle.canceled()
                return Fibonacci.Result()
            if self.newest is not handle:
                handle.abort()
                return Fibonacci.Result()
            feedback.sequence.append(feedback.sequence[-1] + feedback.sequence[-2])
            handle.publish_feedback(feedback)
        handle.succeed()
        return Fibonacci.Result(sequence=feedback.sequence)


def main():
    """Serve until Ctrl-C."""
    rclpy.init()
    node = FibonacciServer()
    try:
        rclpy.spin(node, executor=MultiThreadedExecutor(4))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
