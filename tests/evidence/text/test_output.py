"""Output is read as a person reads it, and a number is read whole or not at all."""

from __future__ import annotations

import pytest

from grader.evidence.text.output import is_whole, plain_output, read_output
from grader.evidence.text.printed import printed_vector, reports
from grader.recording.session import OutputLine
from tests.synthetic import Session, at

RMS = r"RMS[^\d\[\]+-]{0,60}([+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)"
TRACEBACK = """\
Traceback (most recent call last):
  File "/ws/a.py", line 9, in f
    print(f"RMS: {rms:.4f}")
          ^^^^^^^^^^^^^^^^^^
  File "/ws/a.py", line 12, in g
    raise ValueError("RMS 4")
ValueError: RMS: 4.0 is too much"""


def said(*texts: str, stream: str = "stdout") -> list[OutputLine]:
    """Give output lines."""
    return [OutputLine(at(1.0), stream, text) for text in texts]


def texts_of(*texts: str) -> list[str]:
    """Read lines."""
    return [line.text for line in read_output(said(*texts))]


@pytest.mark.parametrize(
    ("printed", "read"),
    [
        ("[INFO] [1695.25] [arm.sub]: RMS: 0.1234", ["RMS: 0.1234"]),
        ("[arm-2] [WARN] [1695.25] [arm]: RMS: 0.1234", ["RMS: 0.1234"]),
        ("[arm-2] RMS: 0.1234", ["RMS: 0.1234"]),
        ("\rRMS: 0.1\rRMS: 0.2", ["", "RMS: 0.1", "RMS: 0.2"]),
        ("RMS:\x07 \x1b[32m0.1234\x1b[0m", ["RMS: 0.1234"]),
        ("RMS: 0,1234 rad", ["RMS: 0.1234 rad"]),
        ("Mean: [0,1 0,2 -0,3]", ["Mean: [0.1 0.2 -0.3]"]),
        ("Mean: 0,1; 0,2, 0,3", ["Mean: 0.1; 0.2, 0.3"]),
        ("counts: [1,2,3] and [0,1]", ["counts: [1,2,3] and [0,1]"]),
        ("1,234 messages", ["1,234 messages"]),
        ("0.1,0.2", ["0.1,0.2"]),
        ("0,1,2", ["0,1,2"]),
    ],
)
def test_a_line_is_read_as_in_the_table(printed: str, read: list[str]) -> None:
    """Prefixes, control characters and decimal commas are understood."""
    assert texts_of(printed) == read


def test_one_fraction_tells_of_the_decimal_comma() -> None:
    """A program that writes 0,5 means 1,25 alike; a line with points is in the other style."""
    assert texts_of("RMS: 0,5", "RMS: 1,25", "t=1.5: 1,25") == [
        "RMS: 0.5",
        "RMS: 1.25",
        "t=1.5: 1,25",
    ]


def test_lines_of_a_traceback_are_left_out() -> None:
    """Neither the code in it nor the message is output of the program; the lines around and between are."""
    first, *rest = TRACEBACK.split("\n")
    between = "[INFO] [1.5] [arm]: RMS: 0.2"
    assert texts_of("RMS: 0.1", first, between, *rest, "RMS: 0.3") == [
        "RMS: 0.1",
        "RMS: 0.2",
        "RMS: 0.3",
    ]
    mixed = [*said(first, stream="stderr"), *said("RMS: 0.4"), *said(*rest, stream="stderr")]
    assert [line.text for line in read_output(mixed)] == ["RMS: 0.4"]


def test_plain_output_keeps_tracebacks() -> None:
    """Tracebacks matter to the question why a program ended."""
    lines = TRACEBACK.split("\n")
    assert [line.text for line in plain_output(said(*lines))] == lines


@pytest.mark.parametrize(
    ("text", "number", "whole"),
    [
        ("RMS: 0.1234 rad", "0.1234", True),
        ("RMS: 0.1,0.2", "0.1", True),
        ("RMS ...0.1234", "0.1234", True),
        ("RMS: 12ms", "12", True),
        ("RMS: -0.5.", "-0.5", True),
        ("RMS: 0,1234", "0", False),
        ("RMS: 12.5", "12", False),
        ("RMS: {rms:.4f}", "4", False),
        ("RMS: 1.5e-3", "1.5", False),
        ("RMS: 1.2.3", "1.2", False),
        ("RMS: 0,1234", "1234", False),
    ],
)
def test_a_part_of_a_number_is_no_number(text: str, number: str, whole: bool) -> None:
    """A number is shown as the program printed it, or not at all."""
    start = text.index(number)
    assert is_whole(text, start, start + len(number)) is whole


def test_code_in_a_traceback_reports_nothing(tmp_path_factory: pytest.TempPathFactory) -> None:
    """`:.4f` is no report of 4."""
    for text, values in ((TRACEBACK, []), ("\rRMS: 0.1\rRMS: 0.2\rRMS: 0,3", [0.1, 0.2, 0.3])):
        lines = [OutputLine(at(1.0), "stdout", line) for line in text.split("\n")]
        session = Session(tmp_path_factory.mktemp("s")).process("node", output=lines)
        assert [report.value for report in reports(session.recorded(), "node", [RMS])] == values


def test_a_thousand_numbers_on_many_lines_are_counted() -> None:
    """A vector that goes on over 167 lines has all its numbers; one that never ends has none."""
    numbers = [f"0.{n:04}" for n in range(1000)]
    rows = [" ".join(numbers[at : at + 6]) for at in range(0, 1000, 6)]
    assert len(rows) == 167
    rows[0] = f"Mean: [{rows[0]}"
    found = printed_vector(said(*rows[:-1], f"{rows[-1]}]"), ["Mean"], at(0.5))
    assert found is not None
    assert len(found.values) == 1000
    assert printed_vector(said(*rows), ["Mean"], at(0.5)) is None
