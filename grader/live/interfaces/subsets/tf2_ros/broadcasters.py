"""Publishers of transforms."""

from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage


def _several(transform):
    return list(transform) if hasattr(transform, "__iter__") else [transform]


class TransformBroadcaster:
    """Publishes transforms that change, on /tf."""

    def __init__(self, node, qos=None):
        self.pub_tf = node.create_publisher(
            TFMessage, "/tf", QoSProfile(depth=100) if qos is None else qos
        )

    def sendTransform(self, transform):
        """Publish one transform, or several."""
        self.pub_tf.publish(TFMessage(transforms=_several(transform)))


class StaticTransformBroadcaster:
    """Publishes lasting transforms on /tf_static: each message has all given ones, for late subscriptions."""

    def __init__(self, node, qos=None):
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.pub_tf = node.create_publisher(TFMessage, "/tf_static", kept if qos is None else qos)
        self._sent = {}

    def sendTransform(self, transform):
        """Publish one transform, or several, with those from before."""
        self._sent.update({each.child_frame_id: each for each in _several(transform)})
        self.pub_tf.publish(TFMessage(transforms=list(self._sent.values())))
