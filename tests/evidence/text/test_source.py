"""Explained files, classes and functions, and their explanations."""

from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.text.source import Rules, SourceFacts
from grader.evidence.text.sources import read_sources
from tests.thorough import part

DOCUMENTED = '''"""Publish joint commands for the arm."""
import math

from rclpy.node import Node


class JointPublisher(Node):
    """Node that sends a sine wave to the first two joints."""

    def __init__(self):
        super().__init__("joint_publisher")
        self.t = 0.0
        self.create_timer(0.01, self.on_timer)

    def on_timer(self):
        """Compute the next positions and publish them."""
        self.t += 0.01
        first = math.sin(self.t)
        second = math.cos(self.t)
        if first > second:
            self.get_logger().info("first")
        self.send(first, second)

    def send(self, first, second):
        self.publisher.publish(first, second)


def main():
    rclpy.init()
    node = JointPublisher()
    rclpy.spin(node)
    node.destroy_node()
'''


def facts(text: str, path: str = "src/joint_publisher.py") -> SourceFacts:
    """Facts of one file."""
    return read_sources(
        {path: text}, Rules(fillers=("the", "class", "function"), placeholders=("^todo", "^add "))
    )[0]


def explained(source: SourceFacts) -> dict[str, bool]:
    """Give the units that need it by name, and whether each is explained."""
    return {unit.name: unit.explained_by is not None for unit in source.units if unit.needed}


def test_a_class_is_one_with_its_file_and_short_functions_with_their_class() -> None:
    """Only the file and long functions need an explanation."""
    assert explained(facts(DOCUMENTED)) == {"joint_publisher.py": True, "on_timer": True}


@pytest.mark.parametrize(
    ("written", "instead"),
    [
        (
            '        """Compute the next positions and publish them."""',
            "        # The phase goes on, so that nothing jumps",
        ),
        (
            '        """Compute the next positions and publish them."""',
            "        'Positions of the next tick.'",
        ),
        (
            "    def on_timer(self):",
            "    # Called a hundred times a second\n    def on_timer(self):",
        ),
        ("        self.t += 0.01", "        self.t += 0.01  # seconds since the start"),
    ],
)
def test_a_comment_is_as_good_as_a_docstring(written: str, instead: str) -> None:
    """A reason above, in or behind the code explains the function that it belongs to."""
    bare = DOCUMENTED.replace('        """Compute the next positions and publish them."""\n', "")
    assert not explained(facts(bare))["on_timer"]
    text = DOCUMENTED if written.strip().startswith('"') else bare
    assert explained(facts(text.replace(written, instead)))["on_timer"]


def test_comments_in_the_constructor_explain_the_class() -> None:
    """A file that is explained by comments alone lacks nothing."""
    bare = DOCUMENTED.replace('"""Publish joint commands for the arm."""', "")
    bare = bare.replace('    """Node that sends a sine wave to the first two joints."""\n', "")
    assert not explained(facts(bare))["joint_publisher.py"]
    assert explained(facts(bare.replace("self.t = 0.0", "self.t = 0.0  # starts at rest")))[
        "joint_publisher.py"
    ]


@pytest.mark.parametrize(
    "docstring",
    [
        "TODO",
        "...",
        "Add docstring here",
        "On timer.",
        "The on_timer function",
        "x x x x",
        "发布",
        "<what it does>",
        "Publish joint commands for the arm.",
    ],
)
def test_docstrings_that_say_nothing_do_not_count(docstring: str) -> None:
    """Placeholders, names, crumbs and repeats are told from docstrings that explain."""
    assert not explained(
        facts(DOCUMENTED.replace("Compute the next positions and publish them.", docstring))
    )["on_timer"]


@pytest.mark.parametrize(
    "docstring",
    [
        "Sends things",
        "Sendet Sinuswellen an zwei Gelenke.",
        "向前两个关节发送正弦波。",
        "最初の二つの関節に正弦波を送る。",
        "처음 두 관절에 사인파를 보낸다.",
        "يرسل موجة جيبية إلى المفصلين",
        "पहले दो जोड़ों को साइन तरंग भेजता है।",
    ],
)
def test_docstrings_count_in_any_language(docstring: str) -> None:
    """A docstring explains in any language."""
    assert explained(
        facts(DOCUMENTED.replace("Compute the next positions and publish them.", docstring))
    )["on_timer"]


def test_several_classes_and_functions_stand_for_themselves() -> None:
    """Each of several classes needs an explanation, and one explained class explains the file.

    The same holds for functions, except `main`.
    """
    two = "class A:\n    'Sends the commands.'\n    x = 1\n\n\nclass B:\n    y = 2\n"
    assert explained(facts(two)) == {"joint_publisher.py": True, "A": True, "B": False}
    long = "    a = 1\n    b = 2\n    c = 3\n    d = 4\n    return a + b + c + d\n"
    several = (
        f"def f():\n    'Adds the weights.'\n{long}\n\ndef g():\n{long}\n\ndef main():\n{long}"
    )
    assert explained(facts(several)) == {"joint_publisher.py": False, "f": True, "g": False}
    assert explained(facts(f"def only():\n    'Adds the weights.'\n{long}")) == {
        "joint_publisher.py": True
    }
    assert explained(facts(f"def main():\n    # Adds the weights\n{long}")) == {
        "joint_publisher.py": True
    }


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("class JointPublisher(Node):", "class JointPublisher(Node)"),
        ("def on_timer(self):", "def on_timer(self:"),
        ("self.t = 0.0", "print 'hello'"),
        ("self.t = 0.0", "if self.t = 0.0:\n            self.t = 1.0\n            self.u = 2.0"),
        ("        rclpy.spin(node)", "    \trclpy.spin(node)"),
        ("def main():", "def empty():\n    # later\n\n\ndef main():"),
        ("    rclpy.init()", "    rclpy.init(\n        args=args"),
    ],
)
def test_slips_of_typing_hide_no_definition(right: str, wrong: str) -> None:
    """Only the lines that Python refuses are lost; all other definitions and texts stay."""
    broken = facts(DOCUMENTED.replace(right, wrong))
    assert broken.readable
    assert explained(broken) == explained(facts(DOCUMENTED))


def test_what_is_no_python_at_all_is_not_readable() -> None:
    """Only the comments are known, and nothing is invented."""
    prose = facts("This is not what\nwas asked for, is it?\n" * 30)
    assert not prose.readable
    assert explained(prose) == {"joint_publisher.py": False}


def test_line_ends_and_marks_do_not_matter() -> None:
    """Windows line ends and a byte order mark change nothing."""
    assert facts("\ufeff" + DOCUMENTED.replace("\n", "\r\n")).units == facts(DOCUMENTED).units


@pytest.mark.parametrize(
    "piece",
    part(
        [
            "(",
            "'",
            "#",
            "# f(\n",
            "# self.x = 1\n",
            "# (\n# x\n",
            "\\",
            '"""',
            "x=1\n",
            "def f():\n",
            "class A:\n def f(self): ...\n",
            "a.",
            "not ",
            "\x00",
            "\ud800",
            "é",
            "发",
            "a=a+a\n",
            "if x:\n ",
        ],
        3,
    ),
)
def test_hostile_files_take_bounded_time(piece: str) -> None:
    """A megabyte of anything is read in a bounded time."""
    text = (piece * (1_000_000 // len(piece) + 1))[:1_000_000]
    started = time.process_time()
    facts(text)
    assert time.process_time() - started < 5, "ten times what an idle machine takes"


@given(st.text(max_size=400))
def test_any_text_is_read(text: str) -> None:
    """No text raises."""
    result = facts(text)
    assert result.units[0].name == "joint_publisher.py"
