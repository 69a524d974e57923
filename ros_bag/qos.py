"""QoS profiles, and their text in a bag of rosbag2."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

#: Largest time and duration in a bag, in ns: that of int64. It stands for an infinite duration.
INFINITE_NS = 9_223_372_036_854_775_807

#: Numbers of QoS policies in rmw's `types.h`; rosbag2 writes them up to metadata version 8.
_HISTORY = ("system_default", "keep_last", "keep_all", "unknown")
_RELIABILITY = ("system_default", "reliable", "best_effort", "unknown", "best_available")
_DURABILITY = ("system_default", "transient_local", "volatile", "unknown", "best_available")
_LIVELINESS = ("system_default", "automatic", "manual_by_node", "manual_by_topic", "unknown")


@dataclass
class Qos:
    """A QoS profile as rclpy spells its policies, in lower case ("reliable", "keep_last", ...).

    `history` is "unknown" and `depth` 0 if they come from discovery. Durations in ns, None for infinite.
    """

    reliability: str = "unknown"
    durability: str = "unknown"
    history: str = "unknown"
    depth: int = 0
    deadline_ns: int | None = None
    lifespan_ns: int | None = None
    liveliness: str = "unknown"
    liveliness_lease_ns: int | None = None


def _number(policy: str, policies: Sequence[str]) -> int:
    return policies.index(policy if policy in policies else "unknown")


def _duration(duration_ns: int | None) -> dict[str, int]:
    seconds, nanoseconds = divmod(INFINITE_NS if duration_ns is None else duration_ns, 10**9)
    return {"sec": seconds, "nsec": nanoseconds}


def qos_text(profiles: Sequence[Qos]) -> str:
    """Write offered QoS profiles in the terms of rosbag2 up to metadata version 8, as JSON, which is YAML.

    Later versions understand policies as numbers too. The channel and `metadata.yaml` hold the same text, because
    `rosbags` gives no messages of a channel if the two differ.
    """
    return json.dumps([_plain_qos(qos) for qos in profiles])


def _plain_qos(qos: Qos) -> dict[str, Any]:
    return {
        "history": _number(qos.history, _HISTORY),
        "depth": qos.depth,
        "reliability": _number(qos.reliability, _RELIABILITY),
        "durability": _number(qos.durability, _DURABILITY),
        "deadline": _duration(qos.deadline_ns),
        "lifespan": _duration(qos.lifespan_ns),
        "liveliness": _number(qos.liveliness, _LIVELINESS),
        "liveliness_lease_duration": _duration(qos.liveliness_lease_ns),
        "avoid_ros_namespace_conventions": False,
    }


def offered_policies(text: str) -> list[tuple[str, str]]:
    """Return the reliability and durability of each QoS profile in a channel's text; none if it is not understood.

    Recordings of earlier versions name the policies: `[{"reliability": "best_effort", ...}]`; they are numbers today.
    """
    policies = []
    try:
        for profile in json.loads(text or "[]"):
            reliability = _name(profile["reliability"], _RELIABILITY)
            policies.append((reliability, _name(profile["durability"], _DURABILITY)))
    except (ValueError, TypeError, KeyError, RecursionError):
        return []
    return policies


def _name(policy: object, policies: Sequence[str]) -> str:
    if isinstance(policy, int) and 0 <= policy < len(policies):
        return policies[policy]
    return str(policy)
