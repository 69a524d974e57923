"""CPU time of a grading, process by process.

The processes of a grading are found in /proc twenty times a second, by their parents. The student's programs are in its
recordings too, with the CPU time until their ends.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from bench.submissions import SOLUTION
from grader.recording.session import SESSION_FILE, read_session
from grader.result_folder import RECORDINGS

_PERIOD_S = 0.05
#: Parts of the commands of evaluations and of the fork server, also of its forks.
_EVALUATION, _SERVER = "evaluate.py", "fork_server"
_TICK_S = 1 / os.sysconf("SC_CLK_TCK")

STUDENTS, LAUNCH, PROBES = (
    "student's programs",
    "evaluation of launch files",
    "probes of the sandbox",
)
COMMAND, FORKS, FIRST, LINK = "grade", "judging", "first processes of sandboxes", "link"
FORK_SERVER, UNSEEN = "fork server", "too short to be seen"
#: Names of the grader's own processes in a sandbox; each other one is a reference node.
_OWN = {
    "session": FIRST,
    "sandbox": FIRST,
    "fork server": FORK_SERVER,
    "director": "director",
    "cpu watch": "CPU watch",
    "link": LINK,
    "link-receiver": LINK,
    "link-sender": LINK,
}


@dataclass(frozen=True)
class Process:
    """A process at the last look; its CPU time is without its children."""

    pid: int
    parent: int
    name: str
    command: str
    cpu_s: float


def read_process(pid: int, stat: str, command: str) -> Process:
    """Read a line of /proc/PID/stat, such as `7 (cpu watch) S 3 ...`; a name may hold brackets."""
    before, _, after = stat.rpartition(")")
    name = before.partition("(")[2]
    words = after.split()
    parent = int(words[1])
    ticks = int(words[11]) + int(words[12])
    return Process(pid, parent, name, command.replace("\0", " ").strip(), ticks * _TICK_S)


def _present() -> Iterator[Process]:
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            stat = (folder / "stat").read_text(encoding="utf-8", errors="replace")
            command = (folder / "cmdline").read_text(encoding="utf-8", errors="replace")
            yield read_process(int(folder.name), stat, command)


def _line(process: Process, known: Mapping[int, Process]) -> list[Process]:
    """Return a process, its parent, and so on, as far as they are known."""
    line = [process]
    while line[-1].parent in known:
        line.append(known[line[-1].parent])
    return line


def with_command(process: Process, seen: Mapping[int, Process]) -> Process:
    """Return a process with the command of its last look; one that has ended shows none."""
    if process.command:
        return process
    before = seen.get(process.pid, process)
    return replace(process, command=before.command)


def kind_of(process: Process, known: Mapping[int, Process]) -> str:
    """Return the kind of a process of a grading."""
    line = _line(process, known)
    names = set()
    commands = ""
    for each in line:
        names.add(each.name)
        commands += each.command
    if _EVALUATION in commands:
        return LAUNCH
    if "bwrap" in names:
        return STUDENTS if "session" in names else PROBES
    if process.name in _OWN:
        return _OWN[process.name]
    if "session" in names:
        return f"reference node {process.name}"
    return _kind_outside(commands, len(line))


def _kind_outside(commands: str, depth: int) -> str:
    """Return the kind of a process outside of all sandboxes."""
    if _SERVER in commands:
        return FORK_SERVER
    if depth == 1:
        return COMMAND
    return FORKS


def by_kind(
    processes: Iterable[Process], whole_s: float, students_s: float = 0.0
) -> dict[str, float]:
    """Return the CPU time of each kind of process; the rest of the whole belongs to unseen ones.

    The student's programs have `students_s` at least, because their last moments are not seen.
    """
    known = {process.pid: process for process in processes}
    found: dict[str, float] = {}
    for process in known.values():
        kind = kind_of(process, known)
        found[kind] = found.get(kind, 0.0) + process.cpu_s
    found[STUDENTS] = max(students_s, found.get(STUDENTS, 0.0))
    found[UNSEEN] = max(0.0, whole_s - sum(found.values()))
    return found


def graded(results: Path) -> dict[str, float]:
    """Grade the solution, and return the CPU time of each kind of process, in s.

    Raises
    ------
    RuntimeError
        If the command fails.
    """
    command = [sys.executable, "-I", "-m", "grader.cli", str(SOLUTION), "-o", str(results)]
    seen: dict[int, Process] = {}
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as running:
        while os.waitid(os.P_PID, running.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
            present = {process.pid: process for process in _present()}
            for process in present.values():
                if present.get(running.pid) in _line(process, present):
                    seen[process.pid] = with_command(process, seen)
            time.sleep(_PERIOD_S)
        _, status, used = os.wait4(running.pid, 0)
        running.returncode = os.waitstatus_to_exitcode(status)
    if running.returncode != 0:
        raise RuntimeError(f"grade ended with status {running.returncode}")
    whole_s = used.ru_utime + used.ru_stime
    return by_kind(seen.values(), whole_s, recorded_s(results / SOLUTION.name / RECORDINGS))


def recorded_s(recordings: Path) -> float:
    """Return the CPU time of the student's programs until their ends by the recordings, in s."""
    total_ns = 0
    for file in recordings.glob(f"*/{SESSION_FILE}"):
        for run in read_session(file.parent).processes:
            if run.role == "student":
                for last in run.usage[-1:]:
                    total_ns += last.cpu_ns
    return total_ns / 1e9


def table_rows(runs: Sequence[Mapping[str, float]]) -> list[list[str]]:
    """Return the rows of the table: process, CPU time (median of the runs), ratio to the student's CPU time."""
    medians: dict[str, float] = {}
    for kind in {STUDENTS, LAUNCH}.union(*runs):
        medians[kind] = statistics.median(run.get(kind, 0.0) for run in runs)
    students_s = medians[STUDENTS] + medians[LAUNCH]
    ours_s = sum(medians.values()) - students_s
    ours = sorted(medians.keys() - {STUDENTS, LAUNCH}, key=lambda kind: -medians[kind])
    sums = {"**the student's**": students_s, "**the grader's**": ours_s}
    all_s = {**medians, **sums}
    found = []
    for kind in [STUDENTS, LAUNCH, *ours, *sums]:
        cpu_s = all_s[kind]
        ratio = cpu_s / max(students_s, _TICK_S)
        found.append([kind, f"{cpu_s:.2f} s", f"{ratio:.2f}"])
    return found


def rows(runs: int) -> list[list[str]]:
    """Grade the solution repeatedly, and return the rows of the table."""
    with tempfile.TemporaryDirectory(prefix="bench-processes-") as scratch:
        return table_rows([graded(Path(scratch)) for _ in range(runs)])
