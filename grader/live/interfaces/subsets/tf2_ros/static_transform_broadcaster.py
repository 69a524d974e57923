"""The name under which the real package has its static broadcaster."""

from tf2_ros.broadcasters import StaticTransformBroadcaster

__all__ = ["StaticTransformBroadcaster"]
