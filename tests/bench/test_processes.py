"""CPU times of a grading are told apart process by process."""

from __future__ import annotations

import os
from dataclasses import replace

from bench.processes import Process, by_kind, read_process, table_rows, with_command

_TICKS = os.sysconf("SC_CLK_TCK")
_SERVER = "python3 -I -m grader.live.session.fork_server 5"
#: Processes of a grading as /proc shows them: forks keep the command of the fork server.
_SEEN = (
    Process(1, 0, "grade", "python3 grade alice", 2.0),
    Process(2, 1, "python3", "python3 grade alice", 1.0),
    Process(3, 1, "bwrap", "bwrap --args 5 python3 -c probe", 0.25),
    Process(4, 1, "python3", _SERVER, 0.5),
    Process(5, 4, "fork server", _SERVER, 0.25),
    Process(6, 5, "sandbox", _SERVER, 0.0),
    Process(7, 6, "session", _SERVER, 1.0),
    Process(8, 7, "director", _SERVER, 2.0),
    Process(9, 7, "arm", _SERVER, 1.0),
    Process(10, 7, "bwrap", "bwrap --args 17 python3 publisher", 0.0),
    Process(11, 10, "director", "python3 publisher", 4.0),
    Process(12, 7, "bwrap", "bwrap --args 17 python3 /launching/inside/evaluate.py", 0.0),
    Process(13, 12, "python3", "python3 /launching/inside/evaluate.py", 1.0),
    Process(14, 7, "link-sender", _SERVER, 0.5),
)


def test_each_process_has_its_kind() -> None:
    """A program of the student's stays the student's, whatever name it gives itself."""
    assert by_kind(_SEEN, 14.0) == {
        "grade": 2.0,
        "judging": 1.0,
        "probes of the sandbox": 0.25,
        "fork server": 0.75,
        "first processes of sandboxes": 1.0,
        "director": 2.0,
        "reference node arm": 1.0,
        "student's programs": 4.0,
        "evaluation of launch files": 1.0,
        "link": 0.5,
        "too short to be seen": 0.5,
    }


def test_the_last_moments_of_the_students_programs_are_theirs() -> None:
    """Without the recorded time they would pass for processes of the grader's."""
    found = by_kind(_SEEN, 14.0, 4.375)
    assert found["student's programs"] == 4.375
    assert found["too short to be seen"] == 0.125


def test_an_ended_process_keeps_its_command() -> None:
    """Until its parent has asked for its end, the kernel shows it without a command."""
    server = _SEEN[3]
    ended = replace(server, command="", cpu_s=0.75)
    assert with_command(ended, {4: server}) == replace(server, cpu_s=0.75)
    assert with_command(ended, {}) == ended


def test_a_name_may_hold_brackets() -> None:
    """The kernel writes names as they are, and the fields follow the last bracket."""
    stat = f"7 (a) b (c) S 3 7 7 0 -1 0 0 0 0 0 {_TICKS} {2 * _TICKS} 5 5 20 0 1 0"
    assert read_process(7, stat, "a\0-b\0") == Process(7, 3, "a) b (c", "a -b", 3.0)


def test_rows_are_medians_beside_the_students() -> None:
    """The last two rows are the sums."""
    runs = [{"student's programs": 4.0, "director": cpu_s, "grade": 1.0} for cpu_s in (1, 2, 9)]
    assert table_rows(runs) == [
        ["student's programs", "4.00 s", "1.00"],
        ["evaluation of launch files", "0.00 s", "0.00"],
        ["director", "2.00 s", "0.50"],
        ["grade", "1.00 s", "0.25"],
        ["**the student's**", "4.00 s", "1.00"],
        ["**the grader's**", "3.00 s", "0.75"],
    ]
