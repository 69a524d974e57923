"""Denials, permissions and limits of the confinement, at each level available on this machine."""

from __future__ import annotations

import json
import sys
import tempfile
from contextlib import nullcontext
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from confine.isolation import Isolation, Level
from confine.landlock import landlock_version
from confine.namespaces import Form
from confine.seccomp import DENIED
from grader.errors import IsolationError
from grader.evidence.crash.diagnosis import ended_by_limit
from grader.evidence.recorded import Recorded
from grader.live.sandbox import environment
from grader.live.sandbox.installation import wheels_of
from grader.live.sandbox.probing import require
from grader.live.session.runner import SessionRunner
from grader.live.session.stage import stage
from grader.recording.session import ProcessRun
from grader.submission.artifacts import read_submission_folder
from tests.live.shared_server import fork_server, scheduler
from tests.live.small_lab import Lab, make_lab, texts
from tests.thorough import EVERY_ATTACK, part

pytestmark = pytest.mark.live

PYTHON = Path(sys.executable)
LEVELS = [Level.FULL, Level.NO_CGROUP, Level.REDUCED]


def _named(parameter: str | Level) -> str:
    """Return the name of a parameter in a test's name."""
    return parameter.value if isinstance(parameter, Level) else parameter


#: Prints a JSON object: attempt -> "done" or the error's name.
TRIES = """
import ctypes, fcntl, json, multiprocessing, os, resource, socket, subprocess, sys, threading

libc = ctypes.CDLL(None, use_errno=True)

def system_call(number, *arguments):
    if libc.syscall(number, *arguments) < 0:
        raise OSError(ctypes.get_errno(), "refused")

def opened(family, kind):
    socket.socket(family, kind).close()

def bound():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))

def thread():
    t = threading.Thread(target=int)
    t.start()
    t.join()

def change(path):
    with open(path, "w") as file:
        file.write("x")

def cut():
    change(os.path.join(os.environ["HOME"], "cut"))
    os.open(os.path.join(os.environ["HOME"], "cut"), os.O_RDONLY | os.O_TRUNC)

def lease():
    change(os.path.join(os.environ["HOME"], "leased"))
    file = os.open(os.path.join(os.environ["HOME"], "leased"), os.O_RDONLY)
    fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_RDLCK)

denied = {
    "namespace by clone": lambda: system_call(56, 0x10000000 | 17, 0, 0, 0, 0),
    "packet socket": lambda: opened(17, 3),
    "vsock": lambda: opened(40, 1),
    "typing into the terminal": lambda: system_call(16, 0, 0x5412, b"x"),
    "all processes": lambda: os.kill(1, 9) if os.getppid() == 0 else os.kill(-1, 0) if NAMESPACES else os.kill(-1, 9),
    "a file of the system": lambda: change("/usr/made"),
    "own interpreter": lambda: change(sys.prefix + "/made"),
    "limits of others": lambda: resource.prlimit(os.getppid(), resource.RLIMIT_NOFILE, (5, 5)),
    "weight of another": lambda: os.setpriority(os.PRIO_PROCESS, os.getppid(), 19),
    "weight of all of a user's": lambda: os.setpriority(os.PRIO_USER, 0, 19),
    "secrets": lambda: open(SECRET).read(),
    "rubric": lambda: open(RUBRIC).read(),
    "services of the same user": lambda: opened(1, 1),
    "a connection": lambda: opened(2, 1),
    "a connection over several ways": lambda: socket.socket(2, 1, 262).close(),
    "cutting a file that is open for reading": cut,
    "a lease of a file": lease,
    "rights of a file": lambda: os.chmod(sys.prefix, os.stat(sys.prefix).st_mode & 0o7777),
    "times of a file": lambda: os.utime(sys.prefix, ns=(0, os.stat(sys.prefix).st_mtime_ns)),
    "another scheduling": lambda: os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0)),
    "another scheduling of others": lambda: os.sched_setscheduler(os.getppid(), os.SCHED_IDLE, os.sched_param(0)),
    **{f"call {n}": (lambda n=n: system_call(n, 0, 0, 0, 0, 0)) for n in NUMBERS},
}
permitted = {
    "thread": thread,
    "program": lambda: subprocess.run(["true"], check=True),
    "fork": lambda: os.waitpid(os.fork() or os._exit(0), 0),
    "udp": bound,
    "unix socket": lambda: opened(1, 1) if NAMESPACES else None,
    "pair of unix sockets": lambda: [s.close() for s in socket.socketpair()],
    "addresses": lambda: socket.if_nameindex(),
    "own file": lambda: change(os.path.join(os.environ["HOME"], "mine")),
    "own limits": lambda: resource.prlimit(0, resource.RLIMIT_CORE, (0, 0)),
    "own weight": lambda: os.setpriority(os.PRIO_PROCESS, 0, 19),
    "usual scheduling": lambda: os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0)),
    "flags of a descriptor": lambda: fcntl.fcntl(1, fcntl.F_SETFL, fcntl.fcntl(1, fcntl.F_GETFL)),
    "temporary file": lambda: change(os.path.join(os.environ["TMPDIR"], "mine")),
}

def outcome(try_it):
    try:
        try_it()
    except Exception as error:
        return type(error).__name__
    return "done"

print(json.dumps({"denied": {k: outcome(v) for k, v in denied.items()},
                  "permitted": {k: outcome(v) for k, v in permitted.items()}}), flush=True)
"""


def isolation_of(level: Level) -> Isolation:
    """Return this machine's confinement, brought down to a level; skip where the machine has less."""
    best = scheduler().isolation
    if not best.level.at_least(level):
        pytest.skip(f"this machine confines at the level {best.level.value} only: {best.remedy}")
    if level is Level.FULL:
        return best
    if level is Level.NO_CGROUP:
        return replace(best, level=level, groups=None)
    if landlock_version() < 1:
        pytest.skip("this kernel has no Landlock")
    return Isolation(level, Form.NONE)


def record_at(lab: Lab, isolation: Isolation) -> Recorded:
    """Record a lab's only session with a given confinement."""
    rubric = lab.rubric()
    submission = read_submission_folder(lab.submission, rubric)
    forks = fork_server(isolation.form)
    with tempfile.TemporaryDirectory() as folder, forks.branch(isolation.form) as branch:
        wrappers = stage(lab.submission, submission, rubric, Path(folder), str(PYTHON))
        sessions = SessionRunner(
            rubric,
            submission,
            Path(folder),
            wrappers,
            lab.recordings,
            isolation,
            wheels_of(PYTHON),
            1,
            environment.versions(),
            branch,
            lambda specs, attempt: lambda spec: nullcontext(),
        )
        sessions.record(["only"], lambda progress: None)
    return Recorded.open(lab.recordings / "only")


def run_at(level: Level, folder: Path, source: str, *, wait_s: float = 60.0) -> Recorded:
    """Run a program as a student's, confined at a level, until it ends or is ended."""
    steps: list[dict[str, Any]] = [
        {"start": {"student": "node"}},
        {"wait_exit": {"process": "node", "timeout_s": wait_s}},
        {"interrupt": {"process": "node", "timeout_s": 1}},
    ]
    return record_at(
        make_lab(folder, {"node": source}, {"only": steps}, timeout_s=90), isolation_of(level)
    )


def process_of(recorded: Recorded) -> ProcessRun:
    """Return the student's process."""
    run = recorded.process("node")
    assert run is not None
    return run


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.value)
def test_what_a_student_may_and_may_not_do(level: Level, tmp_path: Path) -> None:
    """Nothing that leads out of the sandbox is permitted, and all that nodes need is."""
    secret = tmp_path / "secret"
    secret.write_text("truth")
    head = f"SECRET, RUBRIC = {str(secret)!r}, {str(tmp_path / 'rubric.yaml')!r}\n"
    head += f"NUMBERS, NAMESPACES = {sorted(DENIED.values())!r}, {level is not Level.REDUCED!r}\n"
    tries = TRIES
    if level is not Level.REDUCED:  # Its own processes and sockets are all that it sees.
        elsewhere = (
            '"all processes"',
            '"services of the same user"',
            '"a connection',
            '"cutting a file',
        )
        tries = "\n".join(
            line for line in TRIES.splitlines() if not line.strip().startswith(elsewhere)
        )
    recorded = run_at(level, tmp_path, head + tries)
    said = texts(recorded)
    assert said, [line.text for line in process_of(recorded).output]
    facts = json.loads(said[0])
    assert [k for k, v in facts["denied"].items() if v == "done"] == []
    assert set(facts["permitted"].values()) == {"done"}, facts["permitted"]
    assert recorded.record.isolation["level"] == level.value


#: Prints the target of each of its open files.
OPEN_FILES = """
import json, os
print(json.dumps([os.readlink(f"/proc/self/fd/{name}") for name in os.listdir("/proc/self/fd") if int(name) < 100
                  and os.path.lexists(f"/proc/self/fd/{name}")]), flush=True)
"""


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.value)
def test_nothing_of_the_graders_is_left_open(level: Level, tmp_path: Path) -> None:
    """A student's process has its input, its two outputs and the pipe of the tap, and no other file of ours."""
    recorded = run_at(level, tmp_path, OPEN_FILES)
    said = texts(recorded)
    assert said, [line.text for line in process_of(recorded).output]
    kinds = sorted(target.split(":")[0] for target in json.loads(said[0]))
    assert kinds == ["/dev/null", "pipe", "pipe", "pipe"]


BOMBS = {
    # Each of the six stays below the limit of one process.
    "memory": """
import os, time
for _ in range(6):
    if os.fork() == 0:
        taken = bytearray(600 * 1024 * 1024)
        taken[::4096] = b"x" * len(taken[::4096])
        time.sleep(60)
        os._exit(0)
time.sleep(60)
""",
    "processes": """
import os, time
for _ in range(300):
    try:
        if os.fork() == 0:
            time.sleep(20)
            os._exit(0)
    except OSError:
        time.sleep(0.05)
time.sleep(3)
""",
    "disk": """
import os, time
block = b"x" * 1024 * 1024
for number in range(800):
    try:
        with open(os.path.join(os.environ["TMPDIR"], f"large-{number // 50}"), "ab") as file:
            file.write(block)
    except OSError:
        break
time.sleep(3)
""",
    "files": """
import os, time
folder = os.environ["TMPDIR"]
for number in range(60000):
    try:
        os.close(os.open(f"{folder}/{number}", os.O_CREAT))
    except OSError:
        break
time.sleep(3)
""",
    "output": """
import sys
while True:
    sys.stdout.write("x" * 60000 + "\\n")
""",
}


#: Ways to take memory where one does not look at once: more than a session may have, and no more than 3 GiB.
HIDDEN = {
    "a child of a thread": """
import ctypes, os, threading, time
def take():
    taken = [bytearray(64 * 1024 * 1024) for _ in range(48)]
    for block in taken:
        block[::4096] = b"x" * len(block[::4096])
    time.sleep(60)
    os._exit(0)
def child():
    if os.fork() == 0:
        threading.Thread(target=take).start()
        ctypes.CDLL(None).syscall(60, 0)
    time.sleep(60)
threading.Thread(target=child).start()
time.sleep(60)
""",
    "what lies in sockets": """
import socket, time
kept = []
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for _ in range(900):
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 256 * 1024)
    receiver.bind(("127.0.0.1", 0))
    for _ in range(8):
        sender.sendto(b"x" * 60000, receiver.getsockname())
    kept.append(receiver)
time.sleep(60)
""",
}


@pytest.mark.parametrize(
    ("place", "level"),
    part([*product(HIDDEN, [Level.FULL, Level.NO_CGROUP])], 2, EVERY_ATTACK),
    ids=_named,
)
def test_memory_is_found_where_one_does_not_look_at_once(
    place: str, level: Level, tmp_path: Path
) -> None:
    """Memory counts in whichever thread or child took it, and inside the kernel too."""
    run = process_of(run_at(level, tmp_path, HIDDEN[place]))
    assert run.limit == "memory", (
        run.limit,
        run.ended_by,
        run.exit_status,
        [line.text for line in run.output][-3:],
    )


@pytest.mark.parametrize(
    ("limit", "level"), part([*product(BOMBS, LEVELS)], 4, EVERY_ATTACK), ids=_named
)
def test_what_takes_too_much_is_stopped_and_named(limit: str, level: Level, tmp_path: Path) -> None:
    """Memory over several processes, processes, disk, files and output end at their limits, which are named."""
    recorded = run_at(level, tmp_path, BOMBS[limit])
    run = process_of(recorded)
    assert run.limit == limit, (
        run.limit,
        run.ended_by,
        run.exit_status,
        [line.text for line in run.output][-3:],
    )
    # The program ends as a whole, no matter which process killed its child for lack of memory.
    assert limit != "memory" or ended_by_limit(run), (run.ended_by, run.exit_status)
    assert recorded.record.complete
    assert recorded.record.problems == []


#: Its child takes more than a session may have, while it stays small itself.
TAKES_BY_A_CHILD = """
import os, time
if os.fork() == 0:
    taken = [bytearray(64 * 1024 * 1024) for _ in range(48)]
    for block in taken:
        block[::4096] = b"x" * len(block[::4096])
        time.sleep(0.01)
    os._exit(0)
time.sleep(60)
"""
CALM = """
import time
taken = bytearray(96 * 1024 * 1024)
taken[::4096] = b"x" * len(taken[::4096])
print("calm", flush=True)
time.sleep(60)
"""


@pytest.mark.parametrize("level", part(LEVELS, 3, EVERY_ATTACK), ids=_named)
def test_only_the_program_that_took_too_much_is_ended(level: Level, tmp_path: Path) -> None:
    """Another one goes on, although it is the larger once the child of the first is dead."""
    steps: list[dict[str, Any]] = [
        {"start": {"student": "calm"}},
        {"wait_for": {"output_of": "calm", "text": "calm", "timeout_s": 20}},
        {"start": {"student": "node"}},
        {"wait_exit": {"process": "node", "timeout_s": 40}},
    ]
    lab = make_lab(
        tmp_path, {"calm": CALM, "node": TAKES_BY_A_CHILD}, {"only": steps}, timeout_s=90
    )
    recorded = record_at(lab, isolation_of(level))
    calm, bomb = recorded.process("calm"), process_of(recorded)
    assert calm is not None
    assert (bomb.limit, ended_by_limit(bomb), calm.limit, calm.ended_by) == (
        "memory",
        True,
        None,
        "kill",
    )
    assert recorded.record.steps[-1].outcome == "done"


def test_a_run_that_requires_more_than_there_is_is_refused() -> None:
    """The refusal names both levels and the remedy; equal or better levels are let through."""
    reduced = Isolation(Level.REDUCED, remedy="Install bubblewrap.")
    with pytest.raises(
        IsolationError, match="'reduced' only, and 'no cgroup' is required"
    ) as caught:
        require(reduced, Level.NO_CGROUP)
    assert "Install bubblewrap." in caught.value.remedy
    for level in (Level.REDUCED, Level.NONE):
        require(reduced, level)
    with pytest.raises(IsolationError) as caught:
        require(Isolation(Level.NONE), Level.REDUCED)
    assert "--trust-code" in caught.value.remedy
