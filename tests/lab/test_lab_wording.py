"""The lab's reading of students' output, in any wording and layout."""

from __future__ import annotations

from pathlib import Path

import pytest

from grader.evidence.text.printed import printed_vector, reports
from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric
from grader.recording.session import OutputLine
from tests.synthetic import Session, at


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


def wanted(rubric: Rubric, check: str) -> dict[str, object]:
    """Give the parameters of a check."""
    return next(spec.parameters.model_dump() for spec in rubric.checks() if spec.id == check)


@pytest.mark.parametrize(
    "line",
    [
        "[INFO] [1700.5] [joint_state_subscriber]: RMS tracking error: 0.1234 rad",
        "rms tracking error: 0.1234",
        "RMS-Nachführfehler = 0.1234 rad",
        "RMS tracking error [rad]: 0.1234",
        "RMS error over 7 joints: 0.1234 rad",
        "RMS error at t=1.2s: 0.1234 rad",
        "RMS: 0.1234, max: 0.5 rad",
        "RMS tracking error: \x1b[32m0.1234\x1b[0m rad",
        "Tracking RMS error is 0.1234 rad",
        "RMSE=1.234e-01",
        "Tracking error: 0.1234 rad",
        "Root mean square error: 0.1234 rad",
        "均方根误差：0.1234 弧度",
    ],
)
def test_a_report_is_read_however_it_is_worded(tmp_path: Path, rubric: Rubric, line: str) -> None:
    """Letter case, a unit in brackets, hyphens, colours, other languages: the number of the state is found."""
    patterns = wanted(rubric, "subscriber.rms")["pattern"]
    assert isinstance(patterns, tuple)
    recorded = Session(tmp_path).process("it", ["Listening to 2 arms: 7 joints", line]).recorded()
    assert [r.value for r in reports(recorded, "it", patterns)] == [pytest.approx(0.1234)]


def test_reports_as_the_lab_words_them_come_before_others(tmp_path: Path, rubric: Rubric) -> None:
    """Other errors that a node prints are no reports where it prints those that were asked for."""
    patterns = wanted(rubric, "subscriber.rms")["pattern"]
    assert isinstance(patterns, tuple)
    lines = [
        "error of joint 1: 0.5 rad",
        "RMS tracking error: 0.1234 rad",
        "no RMS of the 7 joints yet",
    ]
    recorded = Session(tmp_path).process("it", lines).recorded()
    assert [r.value for r in reports(recorded, "it", patterns)] == [0.1234]


def vectors(*labels: str) -> str:
    """Give three vectors of three numbers behind labels: 0.1, 0.2 and 0.3, and hundredths more."""
    rows = (f"[{0.1 * n:.2f} {0.1 * n + 0.01:.2f} {0.1 * n + 0.02:.2f}]" for n in (1, 2, 3))
    return "\n".join(f"{label}: {row}" for label, row in zip(labels, rows, strict=True))


def listed(form: str) -> str:
    """Give a line for each of three joints."""
    return "\n".join(
        form.format(j=j, a=0.1 + j / 100, b=0.2 + j / 100, c=0.3 + j / 100) for j in range(3)
    )


@pytest.mark.parametrize(
    "text",
    [
        vectors("Mean", "Max", "RMS"),
        vectors("Mean", "Max", "RMS (root mean square)"),
        vectors("Mean", "Max", "Root mean square").replace("[", "").replace("]", ""),
        vectors("Average", "Largest", "RMSE"),
        vectors("Mittelwert", "Größter Fehler", "Quadratisches Mittel"),
        vectors("平均误差", "最大误差", "均方根误差"),
        vectors("Mean", "Max", "RMS").replace("Max", "\x1b[1mMax\x1b[0m"),
        listed("Joint {j}: mean {a:.2f} rad, max {b:.2f} rad, RMS {c:.2f} rad"),
        "joint  mean  max  root mean square\n" + listed("{j}  {a:.2f}  {b:.2f}  {c:.2f}"),
        "\n".join(
            f"{name} error per joint:\n{listed('  Joint {j}: {' + key + ':.2f} rad')}"
            for name, key in (("Mean", "a"), ("Max", "b"), ("RMS", "c"))
        )
        + "\nSamples: 1000",
        "\n".join(
            f"{name}: {{'joint_1': {n}.0e-1, 'joint_2': {n}.1e-1, 'joint_3': {n}.2e-1}}"
            for n, name in ((1, "Mean"), (2, "Max"), (3, "RMS"))
        ),
        "Mean: j0=0.10, j1=0.11, j2=0.12\nMax: j0=0.20, j1=0.21, j2=0.22\nRMS: j0=0.30, j1=0.31, j2=0.32",
    ],
)
def test_statistics_are_read_however_they_are_labelled(rubric: Rubric, text: str) -> None:
    """Each label finds its own numbers, in another language, spelt out, below its label, or one joint after another."""
    output = [OutputLine(at(1.0), "stdout", line) for line in text.split("\n")]
    for check, first in (
        ("subscriber.mean", 0.1),
        ("subscriber.max", 0.2),
        ("subscriber.statistics_rms", 0.3),
    ):
        p = wanted(rubric, check)
        labels = (p["label"], *p["synonyms"])  # type: ignore[misc]
        unless = p.get("unless")
        assert unless is None or isinstance(unless, str)
        found = printed_vector(output, labels, at(0.5), unless)
        assert found is not None, check
        assert found.values == pytest.approx((first, first + 0.01, first + 0.02)), check
