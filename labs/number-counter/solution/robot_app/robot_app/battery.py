"""A battery that shows on an LED whether it is empty."""

import rclpy
from panel_interfaces.srv import SetLed
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

FULL_S = 2.0
EMPTY_S = 3.0
LED = 3


class Battery(Node):
    """Calls `/set_led` when the battery becomes empty, and when it is full again."""

    def __init__(self):
        super().__init__("battery")
        self.is_empty = False
        self.panel = self.create_client(SetLed, "set_led")
        self.timer = self.create_timer(FULL_S, self.change)

    def change(self):
        """Change between full and empty, and tell the panel."""
        self.is_empty = not self.is_empty
        self.destroy_timer(self.timer)
        self.timer = self.create_timer(EMPTY_S if self.is_empty else FULL_S, self.change)
        if not self.panel.service_is_ready():
            self.get_logger().warning("There is no panel; the LED stays as it is.")
            return
        answer = self.panel.call_async(SetLed.Request(led_number=LED, state=self.is_empty))
        answer.add_done_callback(self.report)

    def report(self, answer):
        """Log an answer that is no success."""
        if not answer.result().success:
            self.get_logger().error(answer.result().message)


def main():
    try:
        with rclpy.init():
            rclpy.spin(Battery())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
