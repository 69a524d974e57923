"""Actions on ROS nodes."""

from __future__ import annotations

from typing import Any

from launch._catalogue import missing_name

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


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)
