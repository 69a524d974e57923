"""The QoS that a Python text asks for where no run told: a topic and a profile that are as good as literals."""

from __future__ import annotations

import ast
import functools
import re
from typing import Any

from grader.evidence.syntax import normalise, tree_of
from grader.python_source import Literals, NotRecognisedError
from grader.recording.session import Qos

_METHODS = {
    "create_publisher": ("publisher", ("msg_type", "topic", "qos_profile")),
    "create_subscription": ("subscription", ("msg_type", "topic", "callback", "qos_profile")),
}
_POLICY = re.compile(
    r"\b(?:QoS)?(?:Reliability|Durability|History|Liveliness)Policy\.(?:RMW_QOS_POLICY_[A-Z]+?_(?=[A-Z]))?(\w+)$"
)
_PRESETS = {
    "sensor_data": Qos("best_effort", "volatile", "keep_last", 5),
    "system_default": Qos("system_default", "system_default", "system_default", 0),
}
"""Profiles that rclpy 7.1 brings along for topics."""

_PRESET = re.compile(r"\bqos_profile_(\w+)$|\bQoSPresetProfiles\.(\w+)\.value$")
_MOST_DEPTH = 2**31


class _RclpyScript(Literals):
    def known(self, name: str) -> Any:
        """Return a policy in lower case, or a profile that rclpy brings along."""
        if (policy := _POLICY.search(name)) is not None:
            return policy[1].lower()
        preset = _PRESET.search(name)
        qos = _PRESETS.get((preset[1] or preset[2]).lower()) if preset is not None else None
        return qos if qos is not None else super().known(name)

    def called(self, name: str, given: list[Any], named: dict[str, Any]) -> Any:
        """Return the profile that `QoSProfile` makes."""
        if name.rpartition(".")[2] != "QoSProfile" or given:
            raise NotRecognisedError
        depth = named.pop("depth", 10)
        if not isinstance(depth, int) or not 0 <= depth < _MOST_DEPTH:
            raise NotRecognisedError
        policies = {"reliability": "reliable", "durability": "volatile", "history": "keep_last", **named}
        if not all(isinstance(policy, str) for policy in policies.values()):
            raise NotRecognisedError
        return Qos(**policies, depth=depth)


@functools.lru_cache(maxsize=64)
def asked_qos(text: str, kind: str, topic: str) -> tuple[Qos, int] | None:
    """Return the QoS with which a text makes an endpoint of a topic, and the line; None if it is not recognised.

    Parameters
    ----------
    kind : str
        "publisher" or "subscription".
    """
    tree = tree_of(normalise(text))
    if tree is None:
        return None
    script = _RclpyScript(tree)
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        made, names = _METHODS.get(getattr(call.func, "attr", ""), ("", ()))
        arguments = dict(zip(names, call.args, strict=False)) | {each.arg: each.value for each in call.keywords}
        if made != kind or not {"topic", "qos_profile"} <= set(arguments):
            continue
        try:
            name, qos = script.value(arguments["topic"]), script.value(arguments["qos_profile"])
            qos = script.called("QoSProfile", [], {"depth": qos}) if isinstance(qos, int) else qos
        except NotRecognisedError:
            continue
        if isinstance(name, str) and name.strip("/") == topic.strip("/") and isinstance(qos, Qos):
            return qos, call.lineno
    return None
