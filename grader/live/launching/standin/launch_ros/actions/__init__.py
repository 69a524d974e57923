"""Actions on ROS nodes."""

from __future__ import annotations

from launch._catalogue import missing_name_of

from ._lifecycle import LifecycleNode, LifecycleTransition
from ._node import ComposableNodeContainer, LoadComposableNodes, Node
from ._scopes import (
    PushROSNamespace,
    PushRosNamespace,
    ROSTimer,
    RosTimer,
    SetParameter,
    SetParametersFromFile,
    SetRemap,
    SetROSLogDir,
    SetUseSimTime,
)

__all__ = [
    "ComposableNodeContainer",
    "LifecycleNode",
    "LifecycleTransition",
    "LoadComposableNodes",
    "Node",
    "PushROSNamespace",
    "PushRosNamespace",
    "ROSTimer",
    "RosTimer",
    "SetParameter",
    "SetParametersFromFile",
    "SetROSLogDir",
    "SetRemap",
    "SetUseSimTime",
]
__getattr__ = missing_name_of(__name__)
