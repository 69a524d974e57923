"""The QoS that a source asks for where no run told."""

from __future__ import annotations

import textwrap

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.calls import asked_qos
from grader.recording.session import Qos

HEADER = """
import rclpy
from rclpy.node import Node
from rclpy.qos import *
from std_msgs.msg import String
"""


def asked(body: str, kind: str = "publisher", topic: str = "/chatter") -> Qos | None:
    """Give the QoS that a node asks for whose `__init__` has this body."""
    start = "class Talker(Node):\n    def __init__(self):\n        super().__init__('talker')"
    found = asked_qos(f"{HEADER}\n{start}\n{textwrap.indent(body, ' ' * 8)}\n", kind, topic)
    return found[0] if found is not None else None


def profile(reliability: str, depth: int, durability: str = "volatile", history: str = "keep_last") -> Qos:
    """Give a profile as rclpy spells it."""
    return Qos(reliability, durability, history, depth)


@pytest.mark.parametrize(
    ("given_qos", "expected"),
    [
        ("10", profile("reliable", 10)),
        ("qos_profile=7", profile("reliable", 7)),
        ("QoSProfile(depth=3)", profile("reliable", 3)),
        ("QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)", profile("best_effort", 1)),
        (
            "QoSProfile(depth=1, durability=QoSDurabilityPolicy.RMW_QOS_POLICY_DURABILITY_TRANSIENT_LOCAL)",
            profile("reliable", 1, "transient_local"),
        ),
        ("QoSProfile(depth=2, durability=rclpy.qos.DurabilityPolicy.VOLATILE)", profile("reliable", 2)),
        ("QoSProfile(history=HistoryPolicy.KEEP_ALL)", profile("reliable", 10, history="keep_all")),
        ("qos_profile_sensor_data", profile("best_effort", 5)),
        ("QoSPresetProfiles.SENSOR_DATA.value", profile("best_effort", 5)),
        ("rclpy.qos.qos_profile_sensor_data", profile("best_effort", 5)),
        ("qos_profile_system_default", profile("system_default", 0, "system_default", "system_default")),
        ("QoSProfile(**dict_of_somewhere)", None),
        ("QoSProfile(depth=something())", None),
        ("QoSProfile(depth=2, reliability=2)", None),
        ("0x" + "f" * 5000, None),
        ("-1", None),
        ("'10'", None),
    ],
)
def test_profiles_are_read_as_rclpy_makes_them_or_not_at_all(given_qos: str, expected: Qos | None) -> None:
    """Integers, keywords, presets and old spellings give the profile that rclpy would offer; nothing is guessed."""
    assert asked(f"self.pub = self.create_publisher(String, 'chatter', {given_qos})") == expected


def test_presets_are_those_of_rclpy() -> None:
    """The profiles that rclpy brings along are the ones written down here."""
    qos = pytest.importorskip("rclpy.qos")
    for name in ("sensor_data", "system_default"):
        real = getattr(qos, f"qos_profile_{name}")
        policies = [policy.name.lower() for policy in (real.reliability, real.durability, real.history)]
        expected = Qos(policies[0], policies[1], policies[2], real.depth)
        assert asked(f"self.create_publisher(String, 'chatter', qos_profile_{name})") == expected


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("qos = QoSProfile(depth=4)\nself.create_subscription(String, '/chatter', self.on, qos)", 4),
        ("self.depth = 6\nself.create_subscription(String, '/chatter', self.on, self.depth)", 6),
        ("self.create_subscription(String, topic='/chatter', callback=self.on, qos_profile=8)", 8),
        ("self.create_publisher(String, '/chatter', 3)", None),
        ("self.create_subscription(String, '/other', self.on, 3)", None),
        ("qos = QoSProfile(depth=4)\nqos.depth = 5\nself.create_subscription(String, '/chatter', self.on, qos)", None),
        ("n = 4\nn = 5\nself.create_subscription(String, '/chatter', self.on, n)", None),
        ("a = b\nb = a\nself.create_subscription(String, '/chatter', self.on, a)", None),
        ("for n in (1, 2):\n    self.create_subscription(String, '/chatter', self.on, n)", None),
    ],
)
def test_names_are_followed_that_are_bound_once(body: str, expected: int | None) -> None:
    """No guess is made between two assignments, nor about what is changed afterwards or goes round in a loop."""
    found = asked(body, "subscription")
    assert (found.depth if found is not None else None) == expected


PIECES = st.sampled_from(
    [
        *".()[]{}:,=*#/ \n",
        "self",
        "create_publisher",
        "'a'",
        "1",
        "def f(a)",
        "QoSProfile",
        "depth",
        "**",
        "f'{a}'",
        "x",
    ]
)


@given(st.one_of(st.text(max_size=300), st.lists(PIECES, max_size=60).map("".join)))
def test_any_text_is_read(source: str) -> None:
    """No text raises."""
    assert asked_qos(source, "publisher", "/a") is None or "create_publisher" in source
