"""Definitions, docstrings and lines of a student's source."""

from __future__ import annotations

import time
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.text.source import SourceFacts, docstring_share, parse
from grader.evidence.text.syntax import SIZE_LIMIT

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
    return parse(path, text)


def share(*texts: str) -> Decimal:
    """Share of documented definitions in some files."""
    return docstring_share([parse(f"file{index}.py", text) for index, text in enumerate(texts)]).share


def test_definitions_are_reported_with_kind_line_and_owner() -> None:
    """Modules, classes, methods and functions come in the order of their lines."""
    found = [(d.kind, d.name, d.line, d.owner, d.trivial) for d in facts(DOCUMENTED).definitions]
    assert found == [
        ("module", "joint_publisher", 1, None, False),
        ("class", "JointPublisher", 7, None, False),
        ("method", "__init__", 10, "JointPublisher", True),
        ("method", "on_timer", 15, "JointPublisher", False),
        ("method", "send", 22, "JointPublisher", True),
        ("function", "main", 26, None, True),
    ]
    assert facts(DOCUMENTED).definitions[3].label == "method JointPublisher.on_timer"


def test_a_reasonable_student_gets_it_all() -> None:
    """Module, class and main methods documented is full marks; main and short ones need nothing."""
    result = docstring_share([facts(DOCUMENTED)])
    assert (result.documented, result.needed, result.undocumented) == (3, 3, ())
    assert result.share == 1


def test_what_is_missing_is_named() -> None:
    """A definition without a docstring is reported with its file and the reason."""
    text = DOCUMENTED.replace('        """Compute the next positions and publish them."""\n', "")
    result = docstring_share([facts(text)])
    assert result.share == Decimal("0.75")
    (missing,) = result.undocumented
    assert (missing.path, missing.definition.name, missing.reason) == (
        "src/joint_publisher.py",
        "on_timer",
        "has no docstring",
    )


@pytest.mark.parametrize(
    ("docstring", "reason"),
    [
        ("TODO", "placeholder"),
        ("...", "placeholder"),
        ("docstring", "placeholder"),
        ("Add docstring here", "placeholder"),
        ("Joint publisher.", "repeats its name"),
        ("The JointPublisher class", "repeats its name"),
        ("Sends things", "fewer than 3 words"),
        ("x x x x", "fewer than 3 words"),
        ("发布", "fewer than 3 words"),
        ("Publish joint commands for the arm.", "repeats the docstring"),
    ],
)
def test_docstrings_that_say_nothing_do_not_count(docstring: str, reason: str) -> None:
    """Placeholders, names, crumbs and repeats are told from docstrings that explain."""
    text = DOCUMENTED.replace("Node that sends a sine wave to the first two joints.", docstring)
    (missing,) = docstring_share([facts(text)]).undocumented
    assert reason in missing.reason


@pytest.mark.parametrize(
    "docstring",
    [
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
    text = DOCUMENTED.replace("Node that sends a sine wave to the first two joints.", docstring)
    assert docstring_share([facts(text)]).share == 1


def test_nothing_documented_is_nothing() -> None:
    """Without any docstring, and for an empty submission, the share is zero."""
    assert share("import os\n\n\nclass A:\n    def f(self):\n        x = 1\n        y = 2\n        return x + y\n") == 0
    assert share("") == 0
    assert share() == 0


def test_documenting_small_things_makes_up_for_something() -> None:
    """A docstring on a method that needs none weighs half a missing one, and never lifts above one."""
    text = DOCUMENTED.replace('        """Compute the next positions and publish them."""\n', "")
    text = text.replace("def main():\n", 'def main():\n    """Start the node and spin until Ctrl-C."""\n')
    assert share(text) == Decimal("0.875")
    assert share(DOCUMENTED.replace("def main():\n", 'def main():\n    """Start and spin the node."""\n')) == 1


def test_a_comment_above_the_code_stands_for_the_module_docstring() -> None:
    """Students who explain a file in a leading comment have documented it."""
    text = DOCUMENTED.replace('"""Publish joint commands for the arm."""', "# Publishes joint commands for the arm.")
    assert share(text) == 1


def test_nested_and_private_definitions_need_nothing() -> None:
    """What is not for others to use needs no docstring."""
    text = (
        "def outer():\n    '''Make a counter for others.'''\n    def inner():\n        a = 1\n     "
        "   b = 2\n        return a\n    return inner\n"
    )
    text += "class _Hidden:\n    def f(self):\n        a = 1\n        b = 2\n        return a\n"
    assert [d.name for d in facts(text).definitions if d.public] == ["joint_publisher", "outer"]


BROKEN = DOCUMENTED.replace("second = math.cos(self.t)", "second = math.cos(self.t")


def test_a_syntax_error_is_not_charged_as_missing_documentation() -> None:
    """Definitions and docstrings of a file that Python refuses are told from its lines."""
    broken = facts(BROKEN)
    assert [(d.kind, d.name, d.line) for d in broken.definitions] == [
        (d.kind, d.name, d.line) for d in facts(DOCUMENTED).definitions
    ]
    assert docstring_share([broken]).share == 1


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
    """Without the lines that Python refuses, the others say what they said."""
    broken = facts(DOCUMENTED.replace(right, wrong))
    names = [(d.kind, d.name, d.docstring) for d in facts(DOCUMENTED).definitions]
    assert broken.readable
    assert [(d.kind, d.name, d.docstring) for d in broken.definitions if d.name != "empty"] == names


def test_what_is_no_python_at_all_is_not_readable() -> None:
    """Then nobody knows what it defines, and nothing is made up."""
    prose = facts("This is not what\nwas asked for, is it?\n" * 30)
    assert not prose.readable
    assert docstring_share([prose]).needed == 0


def test_line_ends_and_marks_do_not_matter() -> None:
    """Windows line ends and a byte order mark change nothing."""
    windows = "\ufeff" + DOCUMENTED.replace("\n", "\r\n")
    assert facts(windows).definitions == facts(DOCUMENTED).definitions


def test_code_lines_are_lines_with_code() -> None:
    """Blank lines, comments and docstrings are no code; strings in code are."""
    text = '"""A\nB\n"""\n\n# remark\nx = 1  # inline\ny = """a\nb"""\n'
    assert facts(text).code_lines == 3


def test_huge_files_are_cut_off() -> None:
    """A file that nobody wrote by hand is read in part."""
    assert facts("x = 'some text'\n" * 100_000).code_lines == SIZE_LIMIT // len("x = 'some text'\n")


@pytest.mark.parametrize(
    "piece",
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
    docstring_share([result])
    assert result.definitions[0].kind == "module"
