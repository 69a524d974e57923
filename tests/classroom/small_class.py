"""Classes of a few lines, graded by the real command on a real graph."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from grader.files import UNFINISHED
from grader.result_folder import JOURNAL_FILE, RECORDINGS, RESULT_FILE
from tests.live.small_lab import TALKER, TEXT, below, command_of, make_lab, published
from tests.plain_results import checks_of

#: The talker on another topic than the rubric's, for part of the credit.
ASTRAY = TALKER.replace("/chatter", "/chitter")
CRASHES = "raise SystemExit(3)\n"
#: Keeps its session waiting for as long as that waits.
SLEEPS = "import time\ntime.sleep(600)\n"


@dataclass(frozen=True)
class SmallClass:
    """A folder of submissions with its rubric."""

    folder: Path

    @property
    def rubric(self) -> Path:
        """The rubric's file."""
        return self.folder / "lab" / "rubric.yaml"

    @property
    def submissions(self) -> Path:
        """Folder of the submissions."""
        return self.folder / "submissions"

    @property
    def results(self) -> Path:
        """Where results go."""
        return self.folder / "results"

    def hand_in(self, name: str, source: str | None) -> None:
        """Hand in a talker; None for an empty folder."""
        shutil.rmtree(self.submissions / name, ignore_errors=True)
        (self.submissions / name).mkdir(parents=True)
        if source is not None:
            (self.submissions / name / "talker.py").write_text(source, encoding="utf-8")

    def command(self, *more: str) -> list[str]:
        """Return the command that grades the class."""
        arguments = [
            "--each",
            str(self.submissions),
            "--rubric",
            str(self.rubric),
            "-o",
            str(self.results),
        ]
        return [sys.executable, "-m", "grader.cli", *arguments, *more]

    def start(self, *more: str) -> subprocess.Popen[str]:
        """Start to grade the class."""
        pipe = subprocess.PIPE
        environment = {**os.environ, "TMPDIR": str(self.temporary), "CI": ""}
        return subprocess.Popen(
            self.command(*more), stdout=pipe, stderr=pipe, text=True, env=environment
        )

    def grade(self, *more: str) -> tuple[int, str, str]:
        """Grade the class; returns exit status, output and errors."""
        with self.start(*more) as process:
            try:
                output, errors = process.communicate(timeout=240)
            finally:
                process.kill()
        assert "Traceback" not in errors, errors
        return process.returncode, output, errors

    @property
    def temporary(self) -> Path:
        """A temporary folder of this class's own."""
        (self.folder / "tmp").mkdir(exist_ok=True)
        return self.folder / "tmp"

    def result(self, name: str) -> dict[str, Any]:
        """Read a submission's result."""
        plain: dict[str, Any] = json.loads(
            (self.results / name / RESULT_FILE).read_text(encoding="utf-8")
        )
        return plain

    def outcomes(self) -> dict[str, Any]:
        """Return all that must be equal between two gradings of the class: points and outcomes, by submission."""
        found = {}
        for path in sorted(self.results.glob(f"*/{RESULT_FILE}")):
            plain = json.loads(path.read_text(encoding="utf-8"))
            checks = {check["id"]: check["outcome"] for check in checks_of(plain)}
            seeds = [session["seed"] for session in plain["provenance"]["sessions"].values()]
            found[path.parent.name] = (
                plain["score"],
                checks,
                plain["provenance"]["left_out"],
                seeds,
            )
        return found

    def files_of(self, name: str) -> dict[str, bytes]:
        """Return all files of a submission's results."""
        folder = self.results / name
        found = {}
        for p in sorted(folder.rglob("*")):
            if p.is_file():
                found[str(p.relative_to(folder))] = p.read_bytes()
        return found

    def graded(self) -> list[str]:
        """Return the graded submissions in the order of the journal."""
        path = self.results / JOURNAL_FILE
        if path.exists():
            lines = path.read_text(encoding="utf-8").split("\n")[:-1]
        else:
            lines = []
        return [line["graded"] for line in map(json.loads, lines) if "graded" in line]

    def recording(self) -> list[str]:
        """Return the submissions with sessions being recorded now."""
        return sorted(
            {p.parts[-4] for p in self.results.glob(f"*/{UNFINISHED}/{RECORDINGS}/.*.partial")}
        )


@dataclass
class Family:
    """Notes the processes below one, so that one can tell which of them outlive it."""

    pid: int
    members: set[tuple[int, str]] = field(default_factory=set)
    #: Processes from before the run, such as a helper of `multiprocessing` started by another test.
    before: set[tuple[int, str]] = field(default_factory=set)

    def __post_init__(self) -> None:
        if self.pid == os.getpid():
            self.before = self._now()

    def look(self) -> None:
        """Note the processes that there are now."""
        self.members |= self._now() - self.before

    def _now(self) -> set[tuple[int, str]]:
        return {(pid, _born(pid)) for pid in below(self.pid)}

    def left(self) -> list[str]:
        """Return the command lines of those that still live."""
        return [command_of(pid) for pid, born in self.members if born and _born(pid) == born]


def _born(pid: int) -> str:
    """Return when a process started, empty if it is gone or but a line in its parent's books."""
    try:
        status = (
            Path(f"/proc/{pid}/stat")
            .read_text(encoding="utf-8", errors="replace")
            .rsplit(")", 1)[1]
            .split()
        )
    except OSError:
        return ""
    return status[19] if status[0] not in "ZX" else ""


def make_class(folder: Path, talkers: Mapping[str, str | None]) -> SmallClass:
    """Make a class for a lab with a talker on /chatter, worth 1 point, by submissions' names."""
    steps: list[dict[str, Any]] = [
        {"start": {"student": "talker"}},
        {"wait_for": {"publisher": "/chatter", "type": TEXT, "timeout_s": 60}},
        {"observe": {"duration_s": 0.5, "first_message_on": "/chatter", "timeout_s": 20}},
        {"interrupt": {"process": "talker"}},
    ]
    (folder / "lab").mkdir()
    make_lab(
        folder / "lab",
        {"talker": TALKER},
        {"only": steps},
        timeout_s=90,
        checks=[published("/chatter")],
    )
    made = SmallClass(folder)
    for name, source in talkers.items():
        made.hand_in(name, source)
    return made
