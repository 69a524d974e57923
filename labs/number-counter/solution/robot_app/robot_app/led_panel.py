"""A panel of three LEDs."""

import rclpy
from panel_interfaces.msg import LedStates
from panel_interfaces.srv import SetLed
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

PERIOD_S = 1.0


class LedPanel(Node):
    """Publishes `/led_panel_state`, and serves `/set_led`."""

    def __init__(self):
        super().__init__("led_panel")
        self.leds = [False, False, False]
        self.states = self.create_publisher(LedStates, "led_panel_state", 10)
        self.create_service(SetLed, "set_led", self.switch)
        self.create_timer(PERIOD_S, self.send)

    def send(self):
        """Publish the states of all LEDs."""
        self.states.publish(LedStates(states=self.leds))

    def switch(self, request, response):
        """Switch the LED with the number of the request, and publish at once."""
        if not 1 <= request.led_number <= len(self.leds):
            response.success = False
            response.message = f"There is no LED {request.led_number}; the LEDs are 1 to 3."
            return response
        self.leds[request.led_number - 1] = request.state
        self.send()
        response.success = True
        response.message = f"LED {request.led_number} is switched."
        return response


def main():
    try:
        with rclpy.init():
            rclpy.spin(LedPanel())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
