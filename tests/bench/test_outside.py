"""CPU times of a student's programs inside and outside of their sandboxes are told apart and compared."""

from __future__ import annotations

from pathlib import Path

from bench.outside import inside_s, row
from grader.recording.session import ProcessRun, SessionRecord, Usage, write_session


def _ran(name: str, role: str, *cpu_s: float) -> ProcessRun:
    """Return a process with samples of its CPU time."""
    run = ProcessRun(name, role, [name])
    for number, used_s in enumerate(cpu_s):
        run.usage.append(Usage(number, round(used_s * 1e9), 0))
    return run


def test_the_students_programs_count_until_their_ends(tmp_path: Path) -> None:
    """The grader's own processes and evaluations of the launch file do not count."""
    record = SessionRecord("launch")
    record.processes = [
        _ran("director", "grader", 9.0),
        _ran("launch file", "student", 8.0),
        _ran("arm", "reference", 7.0),
        _ran("talker", "student", 0.5, 1.5),
        _ran("listener", "student", 2.0),
        _ran("gone at once", "student"),
    ]
    write_session(tmp_path, record)
    assert inside_s(tmp_path) == 3.5


def test_a_row_compares_medians() -> None:
    """A single slow run decides nothing."""
    assert row("qos", [1.0, 1.2, 9.0], [1.5, 0.1, 2.0]) == [
        "QoS comparison",
        "1.20 s",
        "1.50 s",
        "0.80",
    ]
