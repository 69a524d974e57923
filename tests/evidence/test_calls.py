"""rclpy calls told from the source."""

from __future__ import annotations

import textwrap
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.calls import CallFact, defines_main, has_main_guard, rclpy_calls

HEADER = """
import rclpy
from rclpy.node import Node
from rclpy.qos import *
from rclpy.qos import ReliabilityPolicy as RP
from std_msgs.msg import String
"""


def calls(body: str, kind: str = "publisher") -> list[CallFact]:
    """Calls of one kind in a method body of a node."""
    method = body if body.startswith("\n") else textwrap.indent(body, " " * 8)
    start = "class Talker(Node):\n    def __init__(self):\n        super().__init__('talker')"
    source = f"{HEADER}\n{start}\n{method}\n"
    return [fact for fact in rclpy_calls(source) if fact.kind == kind]


def profile(reliability: str, depth: int, durability: str = "volatile", history: str = "keep_last") -> dict[str, Any]:
    """A profile as the facts spell it."""
    return {"reliability": reliability, "history": history, "depth": depth, "durability": durability}


@pytest.mark.parametrize(
    ("given_qos", "expected"),
    [
        ("10", profile("reliable", 10)),
        ("qos_profile=7", profile("reliable", 7)),
        ("QoSProfile(depth=3)", profile("reliable", 3)),
        ("QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)", profile("best_effort", 1)),
        ("QoSProfile(depth=1, reliability=RP.BEST_EFFORT)", profile("best_effort", 1)),
        (
            "QoSProfile(depth=1, durability=QoSDurabilityPolicy.RMW_QOS_POLICY_DURABILITY_TRANSIENT_LOCAL)",
            profile("reliable", 1, "transient_local"),
        ),
        ("QoSProfile(depth=2, durability=rclpy.qos.DurabilityPolicy.VOLATILE)", profile("reliable", 2)),
        ("QoSProfile(history=HistoryPolicy.KEEP_ALL)", profile("reliable", 10, history="keep_all")),
        ("QoSProfile(depth=2, reliability=2)", profile("best_effort", 2)),
        ("QoSProfile(**dict_of_somewhere)", None),
        ("qos_profile_sensor_data", profile("best_effort", 5)),
        ("QoSPresetProfiles.SENSOR_DATA.value", profile("best_effort", 5)),
        ("rclpy.qos.qos_profile_sensor_data", profile("best_effort", 5)),
        ("qos_profile_system_default", profile("system_default", 0, "system_default", "system_default")),
        ("something()", None),
    ],
)
def test_profiles_are_read_as_rclpy_makes_them(given_qos: str, expected: dict[str, Any] | None) -> None:
    """Integers, keywords, presets and old spellings all give the profile that rclpy would offer."""
    (fact,) = calls(f"self.pub = self.create_publisher(String, '/chatter', {given_qos})")
    assert (fact.name, fact.type, fact.qos) == ("/chatter", "String", expected)


def test_presets_are_those_of_rclpy() -> None:
    """The profiles that rclpy brings along are the ones written down here."""
    qos = pytest.importorskip("rclpy.qos")
    for name in (
        "default",
        "sensor_data",
        "services_default",
        "parameters",
        "system_default",
        "best_available",
    ):
        (fact,) = calls(f"self.create_publisher(String, 'a', qos_profile_{name})")
        real = getattr(qos, f"qos_profile_{name}")
        assert fact.qos == profile(
            real.reliability.name.lower(), real.depth, real.durability.name.lower(), real.history.name.lower()
        )


def test_an_unknown_policy_is_left_out() -> None:
    """What cannot be told is missing, what can is there."""
    (fact,) = calls("self.create_publisher(String, 'a', QoSProfile(depth=self.deep(), reliability=RP.RELIABLE))")
    assert fact.qos == {"reliability": "reliable", "history": "keep_last", "durability": "volatile"}


@pytest.mark.parametrize(
    "body",
    [
        """
        for name, qos in {'a': 1, 'b': 2}.items():
            self.create_publisher(String, f'/test_{name}', qos)
        """,
        """
        self.profiles = {'a': QoSProfile(depth=1), 'b': QoSProfile(depth=2)}
        for name in self.profiles:
            self.create_publisher(String, '/test_' + name, self.profiles[name])
        """,
        """
        self.profiles = {}
        self.profiles['a'] = 1
        self.profiles['b'] = 2
        self.pubs = {n: self.create_publisher(String, f'/test_{n}', q) for n, q in self.profiles.items()}
        """,
        """
        for name, depth in [('a', 1), ('b', 2)]:
            qos = QoSProfile(depth=depth)
            self.create_publisher(String, f'/test_{name}', qos)
        """,
        """
        self.add('a', 1)
        self.add(depth=2, name='b')
    def add(self, name, depth=10):
        qos = QoSProfile(depth=10)
        qos.depth = depth
        self.create_publisher(String, '/test_' + name, qos)
        """,
        """
        for i, name in enumerate(['a', 'b']):
            self.create_publisher(String, f'/test_{name}', self.make(i + 1))
    def make(self, depth):
        return QoSProfile(depth=depth)
        """,
        """
        self.both = [Channel(self, *pair) for pair in dict(a=1, b=2).items()]
class Channel:
    def __init__(self, node, name, qos):
        node.create_publisher(String, '/test_' + name, qos)
        """,
        """
        for candidate in candidates():
            self.create_publisher(String, '/test_' + candidate.name, candidate.qos)
@dataclass
class Candidate:
    name: str
    qos: int
def candidates():
    return [Candidate('a', 1), Candidate(qos=2, name='b')]
        """,
    ],
    ids=["items", "keys", "filled", "pairs", "helper", "factory", "class", "dataclass"],
)
def test_loops_and_helpers_are_followed(body: str) -> None:
    """A call that a loop or a helper reaches several times is several facts."""
    found = [(fact.name, fact.qos["depth"]) for fact in calls(body) if fact.qos]
    assert found == [("/test_a", 1), ("/test_b", 2)]


def test_all_kinds_of_calls() -> None:
    """Publishers, subscriptions, services, clients, timers, parameters and nodes are told with their line."""
    source = HEADER + textwrap.dedent("""
        RATE = 50.0
        class Talker(Node):
            def __init__(self):
                super().__init__('talker')
                self.create_subscription(String, 'in', self.on_message, 10)
                self.create_service(srv_type=SetBool, srv_name='/enable', callback=self.on_enable)
                self.create_client(SetBool, '/other')
                self.create_timer(1.0 / RATE, self.tick)
                self.declare_parameter('rate', 2 * RATE)
                self.declare_parameters('arm', [('a', 1), ('b', True)])
        def main():
            extra = rclpy.create_node('extra')
            other = Node('other')
    """)
    found = [(f.kind, f.name, f.callback, f.value) for f in rclpy_calls(source)]
    assert found == [
        ("node", "talker", None, None),
        ("subscription", "in", "on_message", None),
        ("service", "/enable", "on_enable", None),
        ("client", "/other", None, None),
        ("timer", None, "tick", 0.02),
        ("parameter", "rate", None, 100.0),
        ("parameter", "arm.a", None, 1),
        ("parameter", "arm.b", None, True),
        ("node", "extra", None, None),
        ("node", "other", None, None),
    ]


def test_launch_nodes_are_no_nodes_of_rclpy() -> None:
    """The Node of a launch file names an executable, and is none of rclpy's."""
    assert rclpy_calls("Node(package='p', executable='e', name='n')\n") == ()


def test_a_parameter_counts_by_its_default() -> None:
    """A timer whose period comes from a parameter has that of the parameter's default."""
    body = """
        rate = self.declare_parameter('rate', 50.0).value
        self.declare_parameter('period', 0.25)
        self.create_timer(1.0 / rate, self.tick)
        self.create_timer(self.get_parameter('period').get_parameter_value().double_value, self.tick)
        self.create_timer(self.get_parameter('other').value, self.tick)
    """
    assert [fact.value for fact in calls(body, "timer")] == [0.02, 0.25, None]


def test_a_name_assigned_twice_is_unknown() -> None:
    """No guess is made between two assignments."""
    (fact,) = calls("topic = 'a'\ntopic = 'b'\nself.create_publisher(String, topic, 10)")
    assert fact.name is None


@pytest.mark.parametrize(
    "source",
    [
        "def f(a):\n    return f(a) + f(a)\nself.create_timer(f(1), f)\n",
        "a = b\nb = a\nself.create_timer(a, f)\n",
        "class A:\n    x = self.x\n    def f(self):\n        self.create_timer(self.x, f)\n",
        "def f(n):\n    f(n)\n    create_node(n)\n    self.create_node(n)\nf('a')\n",
        "x = 10 ** 10 ** 10\nself.create_timer(10 ** 100000000, f)\n",
        "self.create_timer([0] * 10**9, f)\n",
    ],
)
def test_endless_definitions_end(source: str) -> None:
    """What refers to itself, or would not fit in memory, is unknown."""
    assert all(fact.value is None for fact in rclpy_calls(source))


@pytest.mark.parametrize(
    ("source", "guard", "main"),
    [
        ("def main():\n    pass\n\nif __name__ == '__main__':\n    main()\n", True, True),
        ('if "__main__" == __name__:\n    pass\n', True, False),
        ("class A:\n    def main(self):\n        pass\n", False, False),
        ("def main(:\n    pass\nif __name__ == '__main__':\n    main()\n", True, True),
        ("# if __name__ == '__main__':\n", False, False),
    ],
)
def test_main_and_its_guard(source: str, guard: bool, main: bool) -> None:
    """How a file can be started is told even where Python refuses it."""
    assert has_main_guard(source) is guard
    assert defines_main(source) is main


PIECES = st.sampled_from(
    [
        "self",
        ".",
        "create_publisher",
        "(",
        ")",
        "[",
        "]",
        "{",
        "}",
        ":",
        ",",
        "'a'",
        "1",
        "=",
        "for",
        " ",
        "in",
        "\n",
        "    ",
        "def f(a)",
        "QoSProfile",
        "depth",
        "lambda",
        "*",
        "**",
        "f'{a}'",
        "class A(Node)",
        "return",
        "x",
        "#",
        "/",
    ]
)


@given(st.one_of(st.text(max_size=300), st.lists(PIECES, max_size=60).map("".join)))
def test_any_text_is_read(source: str) -> None:
    """No text raises."""
    assert isinstance(rclpy_calls(source), tuple)
    assert has_main_guard(source) in (True, False)
    assert defines_main(source) in (True, False)


def test_numbers_that_cannot_be_written_are_not_known() -> None:
    """Python refuses to write thousands of digits; what a text holds of them is not told, and the rest is."""
    number = "0x" + "f" * 5000
    unknown, known = calls(
        f"self.create_publisher(String, f'/t{{{number}}}', {number})\nself.create_publisher(String, 't', 5)"
    )
    assert (unknown.name, unknown.qos) == (None, None)
    assert (known.name, known.qos) == ("t", profile("reliable", 5))
