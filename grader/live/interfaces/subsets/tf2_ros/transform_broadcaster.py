"""The name under which the real package has its broadcaster."""

from tf2_ros.broadcasters import TransformBroadcaster

__all__ = ["TransformBroadcaster"]
