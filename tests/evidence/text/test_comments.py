"""The value of comments."""

from __future__ import annotations

import pytest

from grader.evidence.text.source import Note, Rules
from grader.evidence.text.sources import read_sources

RULES = Rules(placeholders=(r"^\W*(?:todo|fixme)\b(?:\W+\w+){0,6}\W*$",))


def notes(text: str) -> tuple[Note, ...]:
    """Notes of a file."""
    return read_sources({"node.py": text}, RULES)[0].notes


def kinds(*lines: str) -> list[str]:
    """Faults of comments that stand on lines of their own below code; "explains" for none."""
    found = []
    for note in notes("x = 1\n\n" + "\n".join(f"# {line}" for line in lines) + "\n"):
        found.append(note.fault or "explains")
    return found


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
        ["from std_msgs.msg import String"],
        ["self.x = 5"],
        ["print('x')"],
        ["main()"],
        ["Node(", "    package='lab',", "    executable='talker',", "),"],
        ["i += 1"],
        ["node = JointPublisher()"],
        ["rclpy.spin(node)"],
        ["msg.data = [0.0] * 7"],
        ["for joint in joints:", "    print(joint)"],
        ["if self.x:", "    return True", "else:", "    pass"],
        ["try:", "    rclpy.spin(node)", "except KeyboardInterrupt:", "    pass"],
        ["@property", "def f(self):", "    return self._f"],
        [
            "self.pub = self.create_publisher(",
            "    Float64MultiArray,",
            "    '/joint_commands',",
            "    10)",
        ],
    ],
    ids=lambda lines: lines[0][:20],
)
def test_commented_out_code_is_code(lines: list[str]) -> None:
    """Code put aside explains nothing, also where a statement spans several comments."""
    assert kinds(*lines) == ["commented-out code"]


def test_code_between_prose_is_distinguished() -> None:
    """In one block, the lines of prose explain and the lines of code do not."""
    block = [
        "This is the old timer:",
        "self.timer = self.create_timer(0.1, self.tick)",
        "because ten hertz were enough",
    ]
    assert kinds(*block) == ["explains", "commented-out code", "explains"]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "-----------",
        "==== Publisher ====",
        "x",
        "TODO",
        "TODO: implement",
        "FIXME",
        "noqa: E501",
        "type: ignore",
    ],
)
def test_what_explains_nothing(text: str) -> None:
    """Rules, headings of a word, words for tools, and bare tasks are told apart from explanations."""
    assert "explains" not in kinds(text)


def test_repeated_comments_count_once() -> None:
    """The second of two equal texts explains nothing, whatever its punctuation, in another file too."""
    files = {
        "a.py": "# Store the command.\nx = 1\n",
        "b.py": "# store the command\ny = 1\n# Another remark\nz = 2\n",
    }
    assert [note.fault for f in read_sources(files) for note in f.notes] == ["", "said before", ""]


def test_shebang_and_licence_explain_nothing() -> None:
    """A shebang and a licence header explain no code."""
    text = "#!/usr/bin/env python3\n# Copyright 2024 Somebody\n# Licensed under some licence\n\nimport os\n"
    assert [note.fault for note in notes(text)] == ["a licence"]


def test_echoes_of_the_line_say_nothing() -> None:
    """A comment that only says its line again is an echo; one that adds a word is not."""
    text = (
        "self.pub.publish(msg)  # publish msg\nself.rate = 3  # rate of the timer in hertz\n"
        "# create the publisher\nself.publisher = self.create_publisher(the)\n"
    )
    assert [note.fault for note in notes(text)] == ["repeats the code", "", "repeats the code"]
