"""Tracebacks read out of output, in the styles of several Pythons and among other lines."""

from __future__ import annotations

import textwrap
import traceback

import pytest

from grader.evidence.crash.tracebacks import chains, student_file, student_frame, tracebacks
from grader.recording.session import OutputLine
from tests.counted import calls_of


def lines(text: str, stream: str = "stderr") -> list[OutputLine]:
    """A text as a process's output, a line every nanosecond."""
    found = []
    for t, line in enumerate(textwrap.dedent(text).strip("\n").split("\n")):
        found.append(OutputLine(t, stream, line))
    return found


PLAIN = """
Traceback (most recent call last):
  File "/cell/ws/talker.py", line 9, in <module>
    main()
    ~~~~^^
  File "/cell/ws/talker.py", line 5, in main
    self.count += 1
    ^^^^^^^^^^
AttributeError: 'Talker' object has no attribute 'count'
"""


def test_a_plain_traceback() -> None:
    """Type, message and frames are read, with or without marks under the code."""
    for text in (PLAIN, "\n".join(line for line in PLAIN.split("\n") if "^" not in line)):
        (raised,) = tracebacks(lines(text))
        assert (raised.type, raised.message) == (
            "AttributeError",
            "'Talker' object has no attribute 'count'",
        )
        assert [(frame.line, frame.function) for frame in raised.frames] == [
            (9, "<module>"),
            (5, "main"),
        ]


def test_log_lines_between_do_not_matter() -> None:
    """Log lines of other threads in between are skipped, and lines on the other stream as well."""
    mixed: list[OutputLine] = []
    for line in lines(PLAIN):
        mixed += [
            line,
            OutputLine(line.t_ns, "stderr", "[INFO] [1795185180.472679044] [talker]: still here"),
        ]
        mixed.append(OutputLine(line.t_ns, "stdout", "ValueError: printed by the student"))
    (raised,) = tracebacks(mixed)
    assert raised.name == "AttributeError"
    assert len(raised.frames) == 2


def test_colours_and_launch_prefixes_are_taken_off() -> None:
    """Output under a launch carries the process's name before each line."""
    decorated = []
    for line in lines(PLAIN):
        decorated.append(OutputLine(0, "stderr", f"[talker-1] \x1b[35m{line.text}\x1b[0m"))
    (raised,) = tracebacks(decorated)
    assert raised.frames[-1].function == "main"


def test_a_traceback_on_standard_output_is_read_if_it_is_the_only_one() -> None:
    """Students print tracebacks themselves; Python's own on standard error goes first."""
    assert tracebacks(lines(PLAIN, "stdout"))[0].name == "AttributeError"
    both = lines(PLAIN, "stdout") + lines(PLAIN.replace("AttributeError", "KeyError"))
    assert [raised.name for raised in tracebacks(both)] == ["KeyError"]


@pytest.mark.parametrize(
    "link",
    [
        "During handling of the above exception, another exception occurred:",
        "The above exception was the direct cause of the following exception:",
    ],
)
def test_chained_exceptions_hang_together(link: str) -> None:
    """Exceptions that came of each other are one chain; others are not."""
    text = f"{PLAIN}\n{link}\n{PLAIN.replace('AttributeError', 'ValueError')}\nmore\n{PLAIN}"
    assert [[raised.name for raised in chain] for chain in chains(tracebacks(lines(text)))] == [
        ["AttributeError", "ValueError"],
        ["AttributeError"],
    ]


def test_exception_groups() -> None:
    """The exceptions of a group are read through its margin."""
    text = """
      + Exception Group Traceback (most recent call last):
      |   File "/cell/ws/talker.py", line 3, in t
      |     f()
      | ExceptionGroup: eg (2 sub-exceptions)
      +-+---------------- 1 ----------------
        | Traceback (most recent call last):
        |   File "/cell/ws/talker.py", line 7, in g
        |     raise ValueError("a")
        | ValueError: a
        +---------------- 2 ----------------
        | TypeError: b
        +------------------------------------
    """
    assert [(r.name, r.frames[-1].line) for r in tracebacks(lines(text))][:2] == [
        ("ExceptionGroup", 3),
        ("ValueError", 7),
    ]


@pytest.mark.parametrize(
    "text",
    [
        '  File "/cell/ws/talker.py", line 2\n    def f(:\n          ^\nSyntaxError: invalid syntax\n',
        'Traceback (most recent call last):\n  File "/cell/ws/main.py", line 1, in <module>\n    '
        "import talker\n"
        '  File "/cell/ws/talker.py", line 2\n    def f(:\n          ^\nSyntaxError: invalid syntax\n',
    ],
    ids=["as script", "imported"],
)
def test_syntax_errors_have_no_header_of_their_own(text: str) -> None:
    """A syntax error is read with and without a traceback's header."""
    (raised,) = tracebacks(lines(text))
    assert (raised.name, raised.frames[-1].path, raised.frames[-1].line) == (
        "SyntaxError",
        "/cell/ws/talker.py",
        2,
    )


def test_printed_frames_are_no_exception() -> None:
    """A line that looks like a frame starts no traceback."""
    assert tracebacks(lines('  File "a.py", line 3, in f\nDone: all well\n')) == []


def test_messages_of_several_lines_are_kept() -> None:
    """A message goes on until an empty line."""
    text = (
        'Traceback (most recent call last):\n  File "a.py", line 1, in f\nrclpy.x.E: bad name:\n '
        " 'a b'\n    ^\n\nrest"
    )
    (raised,) = tracebacks(lines(text))
    assert raised.message == "bad name:\n  'a b'\n    ^"
    assert raised.name == "E"


def test_ignored_exceptions_are_marked() -> None:
    """Python went on after an exception in a destructor."""
    text = f"Exception ignored in: <function A.__del__ at 0x7f>\n{PLAIN.strip()}\n"
    assert tracebacks(lines(text))[0].ignored


def test_this_python_is_read() -> None:
    """Whatever style this interpreter prints, its frames and message are found."""
    try:
        [1, 2][int("7")]
    except IndexError:
        text = traceback.format_exc()
    (raised,) = tracebacks(lines(text))
    assert (raised.type, raised.message) == ("IndexError", "list index out of range")
    assert student_frame(raised.frames, ["evidence/test_tracebacks.py"]) is not None


@pytest.mark.parametrize(
    ("path", "file"),
    [
        ("/cell/ws/src/pkg/pkg/talker.py", "src/pkg/pkg/talker.py"),
        ("/cell/prefix/lib/python3.11/site-packages/pkg/talker.py", "src/pkg/pkg/talker.py"),
        ("/cell/prefix/lib/pkg/talker.py", "src/pkg/pkg/talker.py"),
        ("talker.py", "talker.py"),
        ("/cell/ws/node.py", "node.py"),
        ("/venv/lib/python3.11/site-packages/rclpy/node.py", None),
        ("/usr/lib/python3.12/threading.py", None),
        ("/cell/ws/other.py", None),
        ("<frozen importlib._bootstrap>", None),
    ],
)
def test_paths_in_a_sandbox_mean_files_of_the_submission(path: str, file: str | None) -> None:
    """The longest common end decides, and a library's file of the same name is none of the student's."""
    files = ["src/pkg/pkg/talker.py", "node.py", "threading.py", "README.md", "old/x.py"]
    if path == "talker.py":
        files.append("talker.py")
    assert student_file(path, files) == file


def test_endless_tracebacks_are_read_in_few_steps() -> None:
    """Only the deepest of 20,000 frames are compared with the submission's 2,000 files."""
    said = [
        "Traceback (most recent call last):",
        *['  File "/lib/other.py", line 1, in f'] * 20_000,
        "ValueError: x",
    ]
    (raised,) = tracebacks([OutputLine(n, "stderr", line) for n, line in enumerate(said)])
    files = [f"package{n}/other{n}.py" for n in range(2000)]
    assert calls_of(lambda: student_frame(raised.frames, files)) < 20_000


def test_the_deepest_frame_of_the_submission_is_found_below_many_others() -> None:
    """The student's line is told although a library's frames are below it."""
    said = [
        "Traceback (most recent call last):",
        '  File "/ws/src/talker.py", line 9, in <module>',
        *['  File "/lib/other.py", line 1, in f'] * 150,
        "ValueError: x",
    ]
    (raised,) = tracebacks([OutputLine(n, "stderr", line) for n, line in enumerate(said)])
    assert student_frame(raised.frames, ["talker.py", "package/talker.py"]) == ("talker.py", 9)
