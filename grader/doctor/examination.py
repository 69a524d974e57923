"""Examination of this machine: its ability to grade, the confinement of students' code, and its noise."""

from __future__ import annotations

import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

from confine.helpers import find_tool, python, run_helper
from confine.isolation import Isolation, Level
from confine.machine import stolen_ns
from confine.priority import WATCHING
from grader import pipeline, result_folder
from grader.doctor.status import Status, Verdict
from grader.errors import PlatformError
from grader.evidence.cpu_delay import Span
from grader.evidence.recorded import Recorded
from grader.evidence.timing import timing_of
from grader.extras import missing_extra
from grader.judging import rubrics
from grader.lab.rubric import Rubric
from grader.lab.shipped_labs import require_extras
from grader.lab.steps.wait_for import WaitForResult
from grader.live.builds.build import can_build, lacking_compiler
from grader.live.builds.colcon import lacking_builder
from grader.live.interfaces.build import lacking_toolchain
from grader.live.sandbox.environment import ask_interpreter, require_platform
from grader.live.sandbox.probing import probe_isolation
from grader.live.sandbox.students_python import has_libraries_of_jazzy
from grader.live.session.scheduler import sessions_at_a_time
from grader.result import Outcome
from grader.submission.artifacts import read_submission_folder

_LAB = Path(__file__).parent / "lab"
#: Rate of the lab's node.
_RATE_HZ = 100.0
_TOPIC = "/beat"
_NODE = "beat"
_SESSION = "beat"
#: Largest relative error of the rate.
_RATE_OFF = 0.01
_JITTER_S = 0.006
_SLOW_DISCOVERY_S = 2.0
#: Time to keep a core busy, in s.
_BUSY_S = 1.0
#: Largest share of that time for others.
_BUSY_SHARE = 0.10
#: Largest share of a session that a student's process may wait for a core.
_UNSTEADY_SHARE = 0.05
#: Least free space of the disk, and of the memory.
_LEAST_BYTES = 2 * 1024**3


def _status(good: bool, subject: str, found: str, remedy: str) -> Status:
    if good:
        return Status(Verdict.PASS, subject, found)
    return Status(Verdict.WARNING, subject, found, remedy)


def examine(interpreter: Path) -> Iterator[Status]:
    """Examine one thing after another; ends early if the remaining ones need a failed one."""
    platform_status = _platform(interpreter)
    yield platform_status
    isolation = probe_isolation(interpreter)
    yield from _confinement(isolation)
    cores = len(os.sched_getaffinity(0))
    slots = sessions_at_a_time(isolation)
    at_a_time = "one session at a time"
    if slots > 1:
        at_a_time = f"{slots} sessions side by side"
    found = f"{cores} for this process; {at_a_time}"
    yield _status(cores >= 2, "cores", found, "Two cores or more make grading faster and surer.")
    yield _real_time()
    yield _noise()
    yield _space()
    yield _toolchain()
    yield _builder(isolation)
    if platform_status.verdict is Verdict.PASS:
        yield students_libraries(interpreter)
        yield from _traffic(interpreter)


def _platform(interpreter: Path) -> Status:
    found = f"{platform.system()} {platform.machine()}, kernel {platform.release()}, Python {platform.python_version()}"
    try:
        require_platform(interpreter)
        ask_interpreter(interpreter, "import rclpy, std_msgs.msg, std_srvs.srv")
    except PlatformError as error:
        return Status(Verdict.FAIL, "platform", f"{found}; {error.problem}", error.remedy)
    except ValueError as problem:
        remedy = "Reinstall: pip install 'ros-jazzy-rclpy[fastrtps]' ros-jazzy-common-interfaces"
        return Status(Verdict.FAIL, "platform", f"{found}; no node can be run: {problem}", remedy)
    for name in ("ros-jazzy-rclpy", "ros-fastrtps"):
        found += f", {name} {version(name)}"
    return Status(Verdict.PASS, "platform", found)


#: Versions of the libraries that students' programs import.
_LIBRARIES = """
import numpy
try:
    from scipy import __version__ as scipy
except ImportError:
    scipy = "missing"
print(f"NumPy {numpy.__version__}, SciPy {scipy}")
"""


def students_libraries(interpreter: Path) -> Status:
    """State the libraries of students' programs, and the way to the libraries of their own machines."""
    subject = "students' libraries"
    try:
        found = ask_interpreter(interpreter, _LIBRARIES).strip()
    except ValueError as problem:
        return Status(Verdict.PASS, subject, str(problem), "")
    if found.endswith("missing"):
        return Status(Verdict.WARNING, subject, found, missing_extra("scipy").remedy)
    if found.startswith("NumPy 1."):
        return Status(Verdict.PASS, subject, found)
    if has_libraries_of_jazzy():
        remedy = "ROS 2 Jazzy has NumPy 1.26: `--python lab` makes an environment with that."
    else:
        remedy = "ROS 2 Jazzy has NumPy 1.26, which needs a grader on Python 3.12 or older."
    return Status(Verdict.PASS, subject, found, remedy)


def _confinement(isolation: Isolation) -> Iterator[Status]:
    if find_tool("bwrap") is None:
        yield Status(
            Verdict.WARNING, "bubblewrap", "not installed", "sudo apt-get install bubblewrap"
        )
    else:
        output = run_helper(["bwrap", "--version"]).stdout.strip()
        if isolation.old_bubblewrap:
            output += " (old: nested user namespaces are left to the system call filter)"
        yield Status(Verdict.PASS, "bubblewrap", output)
    how = "as root, a user id for each sandbox" if isolation.own_uid else "in a user namespace"
    found = f"network, processes, mounts: {how}" if isolation.namespaces else "not available"
    yield _status(isolation.namespaces, "namespaces", found, isolation.remedy)
    if isolation.groups is not None:
        yield Status(
            Verdict.PASS,
            "control groups",
            f"version {isolation.groups.version}: memory and processes",
        )
    elif isolation.namespaces:
        found = "not available; the grader watches memory instead, which suffices for a class"
        yield Status(Verdict.PASS, "control groups", found)
    found = isolation.level.value
    if isolation.level.at_least(Level.NO_CGROUP):
        yield Status(Verdict.PASS, "confinement", found)
        return
    verdict = Verdict.FAIL if isolation.level is Level.NONE else Verdict.WARNING
    found += f"; lacks: {', '.join(isolation.describe()['lacks'])}"
    yield Status(verdict, "confinement", found, isolation.remedy)


def _real_time() -> Status:
    """Try real-time scheduling in an idle process, as the grader's own processes use it."""
    tried = f"import os; os.sched_setscheduler(0, os.SCHED_RR, os.sched_param({WATCHING}))"
    is_permitted = run_helper(python(sys.executable, "-c", tried)).returncode == 0
    found = (
        "permitted" if is_permitted else "not permitted; on a busy machine more is left undecided"
    )
    remedy = f"Run as root (in a container: --cap-add SYS_NICE), or allow the user: rtprio {WATCHING} in limits.conf."
    return _status(
        is_permitted, "real-time scheduling of the grader's own processes", found, remedy
    )


def _noise() -> Status:
    """Keep a core busy for a second; the share that went to others, on this machine or beside it, is noise."""
    steal_before = stolen_ns()
    stat = _own_wait_ns()
    started = time.monotonic()
    while time.monotonic() - started < _BUSY_S:
        pass
    waited_s = (_own_wait_ns() - stat) / 1e9
    steal_s = (stolen_ns() - steal_before) / 1e9
    found = f"{waited_s * 1000:.0f} ms of {_BUSY_S:g} s waiting for a core, {steal_s * 1000:.0f} ms taken by the host"
    remedy = (
        "End other programs; what the machine delays is undecided and repeated, which takes longer."
    )
    return _status(max(waited_s, steal_s) <= _BUSY_SHARE * _BUSY_S, "noise", found, remedy)


def _own_wait_ns() -> int:
    return int(Path("/proc/self/schedstat").read_text().split()[1])


def _space() -> Status:
    disk = shutil.disk_usage(tempfile.gettempdir()).free
    lines = Path("/proc/meminfo").read_text().splitlines()
    memory = 0
    for line in lines:
        if line.startswith("MemAvailable"):
            memory = int(line.split()[1]) * 1024
    found = (
        f"{disk / 1024**3:.1f} GiB free for temporary files, {memory / 1024**3:.1f} GiB of memory"
    )
    remedy = "End what takes memory, or grade with --jobs 1."
    if disk < _LEAST_BYTES:
        remedy = "Make room, or set TMPDIR to a larger disk."
    return _status(min(disk, memory) >= _LEAST_BYTES, "space", found, remedy)


def _toolchain() -> Status:
    lacks = lacking_toolchain()
    remedy = "sudo apt-get install gcc g++ libc6-dev python3-dev; without them, what needs such interfaces is undecided."
    found = (
        f"not here: {lacks}"
        if lacks
        else "a compiler and rosidl are here, for labs and students with .msg files"
    )
    return _status(not lacks, "interfaces of one's own", found, remedy)


def _builder(isolation: Isolation) -> Status:
    """Examine whether the packages of students can be built."""
    if can_build(isolation):
        return _compiler()
    lacks = lacking_builder()
    if lacks:
        found = f"not here: {lacks}"
        remedy = "pip install colcon-core colcon-ros 'setuptools<80'"
    else:
        found = "the sandbox here has no namespaces, in which colcon would be confined"
        remedy = "Install bubblewrap, and run as root or with user namespaces"
    remedy += "; until then, setup.py and CMakeLists.txt are read without being run."
    return Status(Verdict.WARNING, "packages", found, remedy)


def _compiler() -> Status:
    """Examine whether packages in C and C++ can be built too."""
    found = "colcon and a sandbox are here, for packages of students"
    lacks = lacking_compiler()
    if not lacks:
        return Status(Verdict.PASS, "packages", found)
    remedy = "sudo apt-get install cmake g++ gcc libssl-dev make; pip install ros-jazzy-ament-cmake"
    found += f"; for those of ament_cmake, this machine lacks {lacks}"
    return Status(Verdict.WARNING, "packages", found, remedy)


def _traffic(interpreter: Path) -> Iterator[Status]:
    """Record the examination's node in a real sandbox, and examine its discovery and its 100 messages per second."""
    with tempfile.TemporaryDirectory(prefix="grade-doctor-") as scratch:
        started = time.monotonic()
        recorded = _record(interpreter, Path(scratch))
        took_s = time.monotonic() - started
        step = recorded.step("heard")
        window = recorded.window("watched")
        if step is None or step.outcome != "done" or window is None:
            problems = [*recorded.record.problems, "the node was not heard"]
            output = "; ".join(problems)
            yield Status(
                Verdict.FAIL,
                "discovery",
                output[:300],
                "Look for a firewall on the loopback interface.",
            )
            return
        waited_s = WaitForResult.of(step).waited_s
        assert waited_s is not None
        found = f"a node in a real sandbox was heard {waited_s:.2f} s after its start, by unicast on loopback"
        remedy = "The machine is slow to start programs; expect longer gradings."
        yield _status(waited_s < _SLOW_DISCOVERY_S, "discovery", found, remedy)
        yield _rate(recorded, window, took_s)


def _rate(recorded: Recorded, window: Span, took_s: float) -> Status:
    """Examine the rate, jitter and losses of the recorded messages."""
    timing = timing_of(recorded.stream(_TOPIC), window)
    if timing is None:
        return Status(
            Verdict.FAIL, "100 Hz", "almost nothing was recorded", "Run `grade doctor` again."
        )
    process = recorded.process(_NODE)
    delay_s = 0.0
    if process is not None:
        delay_s = recorded.machine_delay_s(process, window)
    jitter_s = timing.deviation_s(0.99)
    found = (
        f"{timing.rate_hz:.2f} Hz, {jitter_s * 1000:.1f} ms of jitter (99 %), {timing.lost} of {timing.written} "
        f"lost, {delay_s * 1000:.0f} ms of machine delay; the session took {took_s:.1f} s"
    )
    rate_is_off = abs(timing.rate_hz / _RATE_HZ - 1) >= _RATE_OFF
    is_uneven = jitter_s >= _JITTER_S
    good = not any((rate_is_off, is_uneven, timing.lost))
    remedy = "Grade when less is running; timing that a busy machine disturbs is undecided."
    return _status(good, "100 Hz", found, remedy)


def calibrate(interpreter: Path, rubric: Rubric) -> Iterator[Status]:
    """Grade the lab's own solution, and report checks that this machine cannot decide, and its steadiness."""
    solution = _solution_of(rubric)
    if solution is None:
        yield Status(
            Verdict.WARNING,
            "solution",
            "the rubric names none that is here",
            "Set lab.solution in the rubric.",
        )
        return
    require_extras(rubric)
    with tempfile.TemporaryDirectory(prefix="grade-doctor-") as scratch:
        options = pipeline.Options(interpreter, least_isolation="none")
        started = time.monotonic()
        result = pipeline.grade(solution, rubric, Path(scratch), options, lambda progress: None)
        took_s = time.monotonic() - started
        recordings = Path(scratch) / result_folder.RECORDINGS
        sessions = [Recorded.open(recordings / name) for name in rubric.sessions]
    score = result.score
    found = (
        f"{score.earned} of {score.possible} points, {score.undecided} undecided, in {took_s:.1f} s"
    )
    remedy = "Grade when less is running, or on a faster machine; what it cannot decide costs nobody points."
    yield _status(score.earned == score.possible, "solution", found, remedy)
    for recorded in sessions:
        yield _steadiness(recorded)
    for check in result.checks:
        if check.outcome is not Outcome.PASSED:
            output = f"{check.outcome.value}: {check.measured}. {check.reason}"
            yield Status(
                Verdict.WARNING,
                check.id,
                output,
                "This check cannot be trusted on this machine as it is now.",
            )


def _solution_of(rubric: Rubric) -> Path | None:
    """Return the folder of the lab's solution; None if it is missing."""
    if rubric.lab.solution is None:
        return None
    folder = rubric.folder / rubric.lab.solution
    if folder.is_dir():
        return folder
    return None


def _steadiness(recorded: Recorded) -> Status:
    """Examine the waits of a session's student's processes for a core."""
    record = recorded.record
    span = Span(record.started_ns, record.ended_ns)
    longest_s = 0.0
    for run in recorded.students:
        longest_s = max(longest_s, recorded.machine_delay_s(run, span))
    share = longest_s / max(span.duration_s, 1e-9)
    again = f", recorded {record.attempt} times" if record.attempt > 1 else ""
    found = f"a student's process waited for a core {share:.1%} of {span.duration_s:.1f} s at most{again}"
    remedy = "Timing may be undecided; end other programs."
    return _status(share <= _UNSTEADY_SHARE, f"session {record.session}", found, remedy)


def _record(interpreter: Path, scratch: Path) -> Recorded:
    rubric = rubrics.read_rubric(_LAB / "rubric.yaml")
    submission = read_submission_folder(_LAB / "submission", rubric)
    options = pipeline.Options(interpreter, least_isolation="none")
    pipeline.Grading(
        _LAB / "submission", submission, rubric, scratch, options, lambda progress: None
    ).record()
    return Recorded.open(scratch / result_folder.RECORDINGS / _SESSION)
