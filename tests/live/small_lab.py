"""Labs of a few lines: students' nodes as text, steps as data, recorded in real sandboxes by the real grader."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from grader import pipeline, result_folder
from grader.evidence.recorded import Recorded
from grader.judging import rubrics
from grader.lab.rubric import Rubric
from grader.live.session.runner import Progress
from grader.submission.artifacts import read_submission_folder
from tests.live.shared_server import scheduler

ROOT = Path(__file__).parents[2]
#: A rubric has a check at least; this one costs nothing.
FREE: dict[str, Any] = {
    "id": "explained",
    "points": 0,
    "check": "code_explained",
    "with": {"artifacts": [], "full_from": 0},
}
FLOATS, TEXT, SET_BOOL = (
    "std_msgs/msg/Float64MultiArray",
    "std_msgs/msg/String",
    "std_srvs/srv/SetBool",
)

#: A correct node that publishes a text of its own process at 50 Hz.
TALKER = """
import uuid
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

class Talker(Node):
    def __init__(self):
        super().__init__('talker')
        self.publisher = self.create_publisher(String, '/chatter', 10)
        self.text = String(data=uuid.uuid4().hex)
        self.create_timer(0.02, lambda: self.publisher.publish(self.text))

rclpy.init()
node = Talker()
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    print('stopped by Ctrl-C', flush=True)
finally:
    rclpy.try_shutdown()
"""


@dataclass(frozen=True)
class Lab:
    """A rubric and a submission on disk, and where their results go."""

    rubric_file: Path
    submission: Path
    results: Path

    @property
    def recordings(self) -> Path:
        """Folder of the recorded sessions."""
        return self.results / result_folder.RECORDINGS

    def rubric(self) -> Rubric:
        """Load the rubric."""
        return rubrics.read_rubric(self.rubric_file)

    def record(
        self,
        on_progress: Callable[[Progress], None] = lambda progress: None,
        own_server: bool = False,
    ) -> dict[str, Recorded]:
        """Record all sessions as `grade` does, by the module's server or one of their own, and open them."""
        rubric = self.rubric()
        submission = read_submission_folder(self.submission, rubric)
        options = pipeline.Options(Path(sys.executable))
        pipeline.Grading(
            self.submission,
            submission,
            rubric,
            self.results,
            options,
            on_progress,
            scheduler=None if own_server else scheduler(),
        ).record()
        return {name: Recorded.open(self.recordings / name) for name in rubric.sessions}


def published(topic: str) -> dict[str, Any]:
    """Make the check that something is published on a topic, worth 1 point."""
    parameters = {"artifact": "talker", "topic": topic, "type": TEXT}
    return {
        "id": "publishes",
        "points": 1,
        "session": "only",
        "check": "topic_published",
        "with": parameters,
    }


def make_lab(
    folder: Path,
    sources: Mapping[str, str],
    sessions: Mapping[str, Sequence[Mapping[str, Any]]],
    *,
    timeout_s: float = 60.0,
    checks: Sequence[Mapping[str, Any]] = (),
) -> Lab:
    """Write a lab: artifacts as name -> source text, sessions as name -> steps.

    A session without a step that stops the students leaves that to the grader.
    """
    submission = folder / "submission"
    submission.mkdir()
    for name, source in sources.items():
        (submission / f"{name}.py").write_text(source, encoding="utf-8")
    checks = checks or [FREE]
    points = sum(check["points"] for check in checks)
    plain = {
        "lab": {"id": "T", "title": "A test", "points": points},
        "artifacts": {name: {"file": f"{name}.py"} for name in sources},
        "sessions": {
            name: {"steps": [dict(step) for step in steps], "timeout_s": timeout_s}
            for name, steps in sessions.items()
        },
        "criteria": [
            {"id": "all", "title": "All", "points": points, "checks": [dict(c) for c in checks]}
        ],
    }
    rubric = folder / "rubric.yaml"
    rubric.write_text(yaml.safe_dump(plain, sort_keys=False), encoding="utf-8")
    return Lab(rubric, submission, folder / "results")


def record_one(
    folder: Path, source: str, steps: Sequence[Mapping[str, Any]], *, timeout_s: float = 60.0
) -> Recorded:
    """Record one session of one artifact, `node`, that is started first and interrupted at the end."""
    whole = [
        {"start": {"student": "node"}},
        *steps,
        {"interrupt": {"process": "node", "timeout_s": 30}},
    ]
    return make_lab(folder, {"node": source}, {"only": whole}, timeout_s=timeout_s).record()["only"]


def texts(recorded: Recorded, process: str = "node") -> list[str]:
    """Return the lines that a process wrote to standard output."""
    run = recorded.process(process)
    assert run is not None, f"there is no process {process}"
    return [line.text for line in run.output if line.stream == "stdout"]


def until(condition: Callable[[], Any], timeout_s: float = 20.0) -> Any:
    """Wait for a fact and return it; fails when it has not come true by the deadline."""
    end_s = time.monotonic() + timeout_s
    while not (found := condition()):
        assert time.monotonic() < end_s, f"not so within {timeout_s:g} s"
        time.sleep(0.02)
    return found


def own_temporary_folder(folder: Path) -> Path:
    """Make a temporary folder for the traces of a single grading."""
    mine = folder / "tmp"
    mine.mkdir()
    return mine


def remains(temporary: Path) -> list[str]:
    """Return the names that a grading left in its temporary folder."""
    return [path.name for path in temporary.iterdir()]


# -- processes --------------------------------------------------------------------------------


def pids() -> list[int]:
    """Return all process ids."""
    return [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]


def command_of(pid: int) -> str:
    """Return a process's command line, empty if it is gone."""
    try:
        return (
            Path(f"/proc/{pid}/cmdline")
            .read_bytes()
            .replace(b"\0", b" ")
            .decode("utf-8", "replace")
        )
    except OSError:
        return ""


def name_of(pid: int) -> str:
    """Return a process's own name, empty if it is gone."""
    try:
        return Path(f"/proc/{pid}/comm").read_text(encoding="utf-8").strip()
    except OSError:
        return ""


def network_of(pid: int) -> str:
    """Return the network namespace of a process, empty if it is gone."""
    try:
        return str(Path(f"/proc/{pid}/ns/net").readlink())
    except OSError:
        return ""


def below(pid: int) -> list[int]:
    """Return the process ids below a process."""
    parents: dict[int, list[int]] = {}
    for other in pids():
        try:
            status = Path(f"/proc/{other}/stat").read_text(encoding="utf-8", errors="replace")
        except OSError:
            continue
        parents.setdefault(int(status.rsplit(")", 1)[1].split()[1]), []).append(other)
    found: list[int] = []
    queue = [pid]
    while queue:
        children = parents.get(queue.pop(), [])
        found += children
        queue += children
    return found


def students() -> list[int]:
    """Return the processes below this one that run a student's program, including its sandbox's."""
    return [pid for pid in below(os.getpid()) if "/ws/install" in command_of(pid)]


def interrupt_students() -> None:
    """Send Ctrl-C to all students' programs, and to their sandboxes, which end them."""
    for pid in students():
        with suppress(ProcessLookupError):  # The process has just ended.
            os.kill(pid, signal.SIGINT)


def look_on(duration_s: float) -> None:
    """Wait for a time without delays: a timing right after a halt of the machine shows the halt.

    A machine that never gives so much time is not waited for.
    """
    end_s = time.monotonic() + 20 * duration_s
    begun_s = last_s = time.monotonic()
    while last_s - begun_s < duration_s and last_s < end_s:
        time.sleep(0.02)
        now_s = time.monotonic()
        if now_s - last_s > 0.2:
            begun_s = now_s
        last_s = now_s


@dataclass
class Watch:
    """Notes the networks of all sandboxes of a process, to find the processes left in them.

    The object holds the networks open: the system gives the name of a vanished one to the next,
    which may be another test's.
    """

    pid: int = field(default_factory=os.getpid)
    networks: dict[str, int] = field(default_factory=dict)

    def __del__(self) -> None:
        """Let the networks go."""
        for held in self.networks.values():
            os.close(held)

    def look(self, progress: object = None) -> None:
        """Note the sandboxes that there are now."""
        for pid in below(self.pid):
            if network_of(pid) in ("", network_of(os.getpid()), *self.networks):
                continue
            with suppress(OSError):  # The process has just ended.
                held = os.open(f"/proc/{pid}/ns/net", os.O_RDONLY)
                name = str(Path(f"/proc/self/fd/{held}").readlink())
                self.networks[name] = held

    def left(self) -> list[str]:
        """Return the command lines of processes that still live in one of the cells."""
        found = []
        for pid in pids():
            if network_of(pid) in self.networks:
                found.append(command_of(pid) or f"pid {pid}")
        return found

    def until_all_ended(self) -> None:
        """Wait until nothing lives in the sandboxes any more; fails with the rest after a while."""
        with suppress(AssertionError):
            until(lambda: not self.left())
        assert self.left() == []


def mounts_below(folders: Iterable[Path]) -> list[str]:
    """Return the mounts below some folders as this process sees them."""
    prefixes = tuple(str(folder) for folder in folders)
    lines = Path("/proc/self/mountinfo").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line.split()[4].startswith(prefixes)]
