"""What comments are worth."""

from __future__ import annotations

import pytest

from grader.evidence.text.source import parse


def kinds(*lines: str) -> list[str]:
    """Kinds of comments that stand on lines of their own below code."""
    text = "x = 1\n\n" + "\n".join(f"# {line}" for line in lines) + "\n"
    return [comment.kind for comment in parse("node.py", text).comments]


@pytest.mark.parametrize(
    "text",
    [
        "Keep only the latest command, an error needs both",
        "import modules",
        "Initialise (once)",
        "not used",
        "return value",
        "return the value",
        "for each joint: sum up",
        "if safety is on:",
        "Note: something else",
        "default: 100 Hz",
        "x, y and z of the tool",
        "reliable or best_effort",
        "error = command - state",
        "angle = amplitude * sin(2 * pi * f * t)",
        "rms = sqrt(mean(error**2))",
        "positions = [j0, j1, ..., j6]",
        "Joint 0: 0.5*sin(2*pi*0.2*t)",
        "see page (3)",
        "while the arm moves, publish",
        "with the lock held",
        "class for the arm",
        "Wenn der Zustand vor dem Befehl kommt: ignorieren",
        "Guarda el último comando recibido",
        "初始化节点并创建发布者",
        "最新のコマンドを保存する",
        "최신 명령을 저장한다",
        "يحسب الخطأ بين الأمر والحالة",
        "Сохраняем последнюю команду",
        "कमांड सहेजें और त्रुटि निकालें",
        "TODO: this needs a lock as two callbacks write the history",
        "see https://docs.ros.org/en/jazzy",
    ],
)
def test_prose_explains_in_any_language(text: str) -> None:
    """Prose is prose, even where it happens to parse as Python."""
    assert kinds(text) == ["explains"]


@pytest.mark.parametrize(
    "lines",
    [
        ["import rclpy"],
        ["from std_msgs.msg import String"],
        ["self.x = 5"],
        ["timer_period = 0.5"],
        ["print('x')"],
        ["main()"],
        ["Node(", "    package='lab',", "    executable='talker',", "),"],
        ["i += 1"],
        ["x: float = 3.0"],
        ["node = JointPublisher()"],
        ["rclpy.spin(node)"],
        ["msg.data = [0.0] * 7"],
        ["for joint in joints:", "    print(joint)"],
        ["if self.x:", "    return True", "else:", "    pass"],
        ["try:", "    rclpy.spin(node)", "except KeyboardInterrupt:", "    pass"],
        ["@property", "def f(self):", "    return self._f"],
        ["self.pub = self.create_publisher(", "    Float64MultiArray,", "    '/joint_commands',", "    10)"],
    ],
    ids=lambda lines: lines[0][:20],
)
def test_commented_out_code_is_code(lines: list[str]) -> None:
    """Code put aside explains nothing, also where a statement spans several comments."""
    assert set(kinds(*lines)) == {"code"}


def test_code_between_prose_is_distinguished() -> None:
    """In one block, the lines of prose explain and the lines of code do not."""
    block = [
        "This is the old timer:",
        "self.timer = self.create_timer(0.1, self.tick)",
        "because ten hertz were enough",
    ]
    assert kinds(*block) == ["explains", "code", "explains"]


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("", "empty"),
        ("-----------", "banner"),
        ("==== Publisher ====", "banner"),
        ("Publisher", "banner"),
        ("x", "banner"),
        ("TODO", "marker"),
        ("TODO: implement", "marker"),
        ("FIXME", "marker"),
        ("noqa: E501", "marker"),
        ("type: ignore", "marker"),
        ("-*- coding: utf-8 -*-", "marker"),
        ("pylint: disable=all", "marker"),
    ],
)
def test_what_explains_nothing(text: str, kind: str) -> None:
    """Rules, headings of a word, words for tools, and bare tasks are told apart from explanations."""
    assert kinds(text) == [kind]


def test_repeated_comments_count_once() -> None:
    """The second of two equal comments is a repeat, whatever its punctuation."""
    assert kinds("Store the command.", "store the command", "Another remark") == [
        "explains",
        "repeated",
        "explains",
    ]


def test_shebang_and_licence_are_markers() -> None:
    """A shebang and a licence header explain no code."""
    text = "#!/usr/bin/env python3\n# Copyright 2024 Somebody\n# Licensed under some licence\n\nimport os\n"
    assert {comment.kind for comment in parse("node.py", text).comments} == {"marker"}


def test_echoes_of_the_line_say_nothing() -> None:
    """A comment that only says its line again is an echo; one that adds a word is not."""
    text = (
        "self.pub.publish(msg)  # publish msg\nself.rate = 3  # rate of the timer in hertz\n# "
        "import rclpy now\nimport rclpy\n"
    )
    assert [c.kind for c in parse("node.py", text).comments] == ["echo", "explains", "explains"]


def test_inline_comments_are_marked() -> None:
    """A comment behind code knows that it is."""
    first, second = parse("node.py", "x = 1  # metres per second\n# radians per second\n").comments
    assert first.inline
    assert not second.inline
