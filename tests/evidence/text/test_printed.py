"""Numbers printed by students' processes, in many forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.text.printed import printed_vector, reports, reports_of
from grader.lab.patterns import patterns_bounded
from grader.recording.session import OutputLine, ProcessRun
from tests.counted import calls_of
from tests.synthetic import Session, at

PATTERN = r"RMS[^\d\[\]+-]{0,60}([+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)"


def said(*lines: str, stream: str = "stdout") -> list[OutputLine]:
    """Give output lines."""
    return [OutputLine(at(1.0), stream, line) for line in lines]


def vector_of(
    output: list[OutputLine], label: str, after_ns: int | None = None
) -> list[float] | None:
    """Give the values of the last vector behind a label."""
    found = printed_vector(output, [label], after_ns)
    return list(found.values) if found is not None else None


@pytest.mark.parametrize(
    "lines",
    [
        ["Mean: [0.1 0.2 0.3]"],
        ["  mean : [0.1, 0.2, 0.3]"],
        ["Mean absolute error = [0.1 0.2 0.3] rad"],
        ["Mean:", "[0.1 0.2 0.3]"],
        ["Mean: [0.1 0.2", " 0.3]"],
        ["Mean: array([0.1, 0.2, 0.3])"],
        ["Mean: [np.float64(0.1), np.float64(0.2), np.float64(0.3)]"],
        ["[INFO] [1.5] [node]: Mean: [1.0e-01 2.e-1 3E-1]"],
        ["Mean: [9 9 9]", "Mean: [.1 .2 .3]"],
        ["Mean error [rad]: [0.1 0.2 0.3]"],
        ["Mean [rad]:", "[0.1 0.2 0.3]"],
    ],
)
def test_a_vector_is_found_however_it_is_printed(lines: list[str]) -> None:
    """Wrapped lines, numpy's types, labels in any case: the last one counts."""
    assert vector_of(said(*lines), "Mean") == pytest.approx([0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    "lines", [[], ["Mean: 0.1"], ["Max: [0.1]"], ["Mean: [0.1 0.2"], ["Meaning [", "x"]]
)
def test_where_there_is_no_vector_none_is_found(lines: list[str]) -> None:
    """Another label, a single number or a bracket that never closes are none."""
    assert vector_of(said(*lines), "Mean") is None


@pytest.mark.parametrize(
    ("lines", "form"),
    [
        (["Mean: 0.1, 0.2, 0.3 rad"], "vector"),
        (["Mean error (rad): (0.1, 0.2, 0.3)"], "vector"),
        (
            ["j1: mean (rad) = 0.1, max = 9", "j2: mean (rad) = 0.2", "j3: mean (rad) = 0.3"],
            "lines",
        ),
        (
            [
                "Joint   Mean     Max",
                "  0     0.1     9.0",
                "  1     0.2     9.0",
                "  2     0.3     9.0",
            ],
            "table",
        ),
        (
            [
                "| joint | mean | max |",
                "|---|---|---|",
                "| a | 0.1 | 9 |",
                "| b | 0.2 | 9 |",
                "| c | 0.3 | 9 |",
            ],
            "table",
        ),
        (
            ["joint mean[rad] max", "J 0 0.1 9.0", "J 1 0.2 9.0", "J 2 0.3 9.0", "", "Done 1 2 3"],
            "table",
        ),
        (["      j0    j1    j2", "Mean  0.1   0.2   0.3", "Max   9     9     9"], "vector"),
        (["│ Mean │ 0.1 │ 0.2 │ 0.3 │"], "vector"),
        (["joint  mean |e|  max |e|", "0  0.1  9.0", "1  0.2  9.0", "2  0.3  9.0"], "table"),
        (["j1: mean=0.1, max=9.0", "j2: mean=0.2, max=9.0", "j3: mean=0.3, max=9.0"], "lines"),
        (
            [
                "Joint 1",
                "  Mean: 0.1 rad",
                "  Max: 9 rad",
                "Joint 2",
                "  Mean: 0.2 rad",
                "Joint 3",
                "  Mean: 0.3 rad",
            ],
            "lines",
        ),
        (
            [
                "joint 0 mean error: 0.1 max error: 9",
                "joint 1 mean error: 0.2 max error: 9",
                "x mean: 0.3 y: 1",
            ],
            "lines",
        ),
    ],
)
def test_other_forms_count_after_ctrl_c(lines: list[str], form: str) -> None:
    """Bare numbers, tables and a line for each element are read, only at the end of the output."""
    found = printed_vector(said(*lines), ["Mean"], at(0.5))
    assert found is not None
    assert found.values == pytest.approx((0.1, 0.2, 0.3))
    assert found.form == form
    assert printed_vector(said(*lines), ["Mean"], at(1.5)) is None


def test_one_number_is_no_column() -> None:
    """A single number behind the label stays one, so that it can be told."""
    assert vector_of(said("Mean: 0.1", "Max: 0.2"), "Mean", at(0.5)) == [0.1]
    assert vector_of(said("Mean  Max", "0.1   0.2"), "Mean", at(0.5)) is None


@pytest.mark.parametrize(
    ("numbers", "rounding"),
    [
        ("0.12 0.3 1.", 0.005),
        ("0.123 0.3", 0.0005),
        ("0.1 0.2", 0.0),
        ("1 2", 0.0),
        ("1.2e-01 3.0e-02", 0.0),
    ],
)
def test_rounding_is_half_of_the_last_place(numbers: str, rounding: float) -> None:
    """Numpy leaves out trailing zeros, so the number with most places tells; less than two say nothing."""
    found = printed_vector(said(f"Mean: [{numbers}]"), ["Mean"])
    assert found is not None
    assert found.rounding == pytest.approx(rounding)


def test_labels_do_not_reach_into_each_other() -> None:
    """Each label finds its own vector."""
    output = said("Error Statistics:", "Mean: [1. 2.]", "Max: [3. 4.]", "RMS: [5. 6.]")
    assert [vector_of(output, label) for label in ("Mean", "Max", "RMS")] == [
        [1, 2],
        [3, 4],
        [5, 6],
    ]


def test_standard_output_comes_before_the_log() -> None:
    """A vector on standard output wins over one on standard error, which stands in where there is none."""
    both = said("Mean: [2.]", stream="stderr") + said("Mean: [1.]")
    assert vector_of(both, "Mean") == [1.0]
    assert vector_of(both[:1], "Mean") == [2.0]


def test_numbers_that_are_none_are_read_as_such() -> None:
    """NaN and infinity are numbers of their own."""
    vector = vector_of(said("Mean: [nan inf -inf 1.]"), "Mean")
    assert vector is not None
    assert np.isnan(vector[0])
    assert vector[1:] == [np.inf, -np.inf, 1.0]


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=12))
def test_what_numpy_prints_is_read_back(values: list[float]) -> None:
    """Each array that numpy prints gives its numbers, also over several lines."""
    lines = f"Mean: {np.array(values)}".splitlines()
    assert vector_of(said(*lines), "Mean") == pytest.approx(values, rel=1e-3, abs=1e-6)


@given(st.text(max_size=300))
def test_no_text_breaks_it(text: str) -> None:
    """Whatever is printed, the answer is a list of numbers or none."""
    for lines in (f"Mean: [{text}", f"Mean {text}\nMean", f"x Mean\n{text}"):
        found = vector_of(said(*lines.splitlines()), "Mean", at(0.5))
        assert found is None or all(isinstance(x, float) for x in found)


# -- reports ---------------------------------------------------------------------------------------


def test_reports_are_read_until_the_interrupt(tmp_path: Path) -> None:
    """Each line's first group counts, with its time; statistics after Ctrl-C do not."""
    lines = [
        (1.0, "RMS tracking error: 0.1234 rad"),
        (1.5, "other"),
        (2.0, "RMS: 1e-3"),
        (21.0, "RMS: 9.0"),
    ]
    recorded = Session(tmp_path).process("it", lines).recorded()
    found = reports(recorded, "it", [PATTERN])
    assert [(r.t_ns, r.value) for r in found] == [(at(1.0), 0.1234), (at(2.0), 0.001)]


def test_reports_of_all_starts_count(tmp_path: Path) -> None:
    """A node that was started twice reported in both lives."""
    session = Session(tmp_path).process("it", [(1.0, "RMS: 1")]).process("it", [(2.0, "RMS: 2")])
    assert [r.value for r in reports(session.recorded(), "it", [PATTERN])] == [1.0, 2.0]


def test_without_reports_there_are_none(tmp_path: Path) -> None:
    """Neither output nor a log gives none, and numbers that are none are left out."""
    session = Session(tmp_path).process("it", ["hello", "value x"])
    recorded = session.recorded()
    assert reports(recorded, "it", [PATTERN]) == []
    assert reports(recorded, "it", [r"value (\w)"]) == []
    assert reports(recorded, "it", ["value"]) == []


@pytest.mark.parametrize("line", ["Mean:[", "Mean  x", "Mean: [0.1", "| Mean | Max |", "Mean"])
def test_endless_statistics_are_read_in_few_steps(line: str) -> None:
    """Only the last of twenty thousand lines similar to statistics are read closely."""
    output = [OutputLine(n, "stdout", line) for n in range(20_000)]
    assert calls_of(lambda: printed_vector(output, ["Mean"], 0)) < 500_000


def test_the_last_of_many_vectors_counts() -> None:
    """A program that prints its statistics again and again is judged by the last ones."""
    output = [OutputLine(n, "stdout", f"Mean: [{n}.0 1.0]") for n in range(5000)]
    assert vector_of(output, "Mean") == [4999.0, 1.0]


def _run(lines: int) -> ProcessRun:
    """Return a process that printed numbers in some lines."""
    output = [OutputLine(number, "stdout", f"RMS: {number}.5") for number in range(lines)]
    return ProcessRun("it", "student", ["it"], output=output)


def test_numbers_of_a_process_are_sought_once() -> None:
    """Several checks seek the same numbers in the output of a process."""
    run = _run(500)
    with patterns_bounded():
        first = reports_of(run, [r"RMS: (\d+\.\d)"])
        assert len(first) == 500
        assert calls_of(lambda: reports_of(run, [r"RMS: (\d+\.\d)"])) < 100
        assert reports_of(run, [r"RMS: (\d+\.\d)"]) == first


def test_numbers_are_sought_again_with_more_time() -> None:
    """A search that was given up decides nothing for the next check, which has time of its own."""
    run = _run(3)
    with patterns_bounded() as budget:
        budget.left_s = 0.0
        assert reports_of(run, [r"RMS: (\d+\.\d)"]) == []
    with patterns_bounded():
        assert len(reports_of(run, [r"RMS: (\d+\.\d)"])) == 3
