"""`journal.jsonl` in a results folder: the list of graded submissions, with which an interrupted run continues.

Lines are only appended, and each is on the disk before the run continues. A result is complete if the journal lists
it, and if its folder has the recordings that the journal names. The file can end anywhere: an incomplete line does
not count.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import random
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from grader.errors import GraderError
from grader.recording.session import SESSION_FILE
from grader.recording.submission import read_submission
from grader.result_folder import JOURNAL_FILE, LAYOUT_FILE, RECORDINGS

#: Folder for earlier results of submissions that could not be graded again.
OUTDATED = ".outdated"
#: Mark instead of the hash of a policy: the recordings are not judged yet.
UNJUDGED = ""
_SCHEMA = "ros-lab-grader/journal/v1"


@dataclass(frozen=True)
class Entry:
    """A line of the journal about a graded submission."""

    #: Hash of all sources of the recordings and their judgement.
    key: str
    #: Hash of all sources of the judgement alone, such as overrides.
    policy: str
    #: Level at which students' code was confined.
    isolation: str
    #: Hash of the recordings; see `recordings_sha256`.
    recordings: str


class Journal:
    """The journal of one run; a results folder belongs to one run at a time."""

    def __init__(self, results: Path, file: int, *, afresh: bool) -> None:
        self.results = results
        self._file = file
        self._entries: dict[str, Entry] = {}
        self._seed: int | None = None
        self._read()
        if afresh or self._seed is None:
            self._append({"journal": _SCHEMA, "run_seed": random.SystemRandom().randrange(2**31)})
            self._read()

    @property
    def run_seed(self) -> int:
        """The number that determines the seeds of this class, until it is graded afresh."""
        assert self._seed is not None
        return self._seed

    @classmethod
    @contextmanager
    def open(cls, results: Path, *, afresh: bool = False) -> Iterator[Journal]:
        """Open a results folder for a run; raises GraderError if another run is at work there.

        A run that grades `afresh` ignores earlier results.
        """
        results.mkdir(parents=True, exist_ok=True)
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC
        file = os.open(results / JOURNAL_FILE, flags, 0o644)
        try:
            _lock(file, results)
            yield cls(results, file, afresh=afresh)
        finally:
            os.close(file)

    def holds(self, name: str, key: str) -> Entry | None:
        """Return the entry of a submission with the same sources, if its recordings still exist."""
        entry = self._entries.get(name)
        there = False
        if entry is not None and entry.key == key:
            there = recordings_sha256(self.results / name) == entry.recordings
        return entry if there else None

    def knows(self, name: str) -> bool:
        """Return whether a submission was graded in any way, and has not failed since."""
        if name in self._entries:
            return True
        return (self.results / name / RECORDINGS).is_dir()

    def note(self, name: str, key: str, policy: str, isolation: str) -> None:
        """Sync the results of a submission to the disk, and note that they are complete; raises OSError."""
        folder = self.results / name
        for path in [*folder.rglob("*"), folder, self.results]:
            _sync(path)
        entry = Entry(key, policy, isolation, recordings_sha256(folder))
        self._entries[name] = entry
        self._append({"graded": name, **asdict(entry)})

    def abandon(self, name: str, why: GraderError) -> None:
        """Note that a submission could not be graded; the next run tries again.

        Earlier results of the submission are moved away, because they belong to other files.
        """
        shutil.rmtree(self.results / OUTDATED / name, ignore_errors=True)
        if (self.results / name).is_dir():
            (self.results / OUTDATED).mkdir(exist_ok=True)
            (self.results / name).rename(self.results / OUTDATED / name)
        self._entries.pop(name, None)
        self._append({"not graded": name, **vars(why), "exit_status": why.exit_status})

    def _read(self) -> None:
        content = (self.results / JOURNAL_FILE).read_bytes()
        for line in content.split(b"\n"):
            with suppress(ValueError, KeyError, TypeError, AttributeError):
                self._take(json.loads(line))
        if content and not content.endswith(b"\n"):
            os.write(self._file, b"\n")

    def _take(self, line: Mapping[str, Any]) -> None:
        if "journal" in line:
            self._seed = None
            if line["journal"] == _SCHEMA:
                self._seed = int(line["run_seed"])
            self._entries.clear()
        elif "graded" in line:
            name = str(line["graded"])
            values = [str(line[field.name]) for field in fields(Entry)]
            self._entries[name] = Entry(*values)
        elif "not graded" in line:
            self._entries.pop(str(line["not graded"]), None)

    def _append(self, line: Mapping[str, Any]) -> None:
        at = datetime.now(UTC).isoformat(timespec="seconds")
        os.write(self._file, (json.dumps({**line, "at": at}) + "\n").encode())
        os.fsync(self._file)


def _lock(file: int, results: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        remedy = "Wait until it has ended, or give another folder by -o."
        problem = "another run of grade is writing to this results folder"
        raise GraderError(problem, location=str(results), remedy=remedy) from None


def recordings_sha256(folder: Path) -> str:
    """Return a hash that identifies the recordings of a submission's results; empty without recordings.

    The records contain their own times, and no two are equal. Bags are large, and only their sizes enter. Layouts are
    left out, because every judgement writes them anew.
    """
    recordings = folder / RECORDINGS
    try:
        digest = hashlib.sha256(read_submission(recordings).sha256.encode())
        for path in sorted(recordings.glob("*/*")):
            if path.name == LAYOUT_FILE or not path.is_file():
                continue
            if path.name == SESSION_FILE:
                content = path.read_bytes()
            else:
                size = path.stat().st_size
                content = str(size).encode()
            digest.update(f"\0{path.relative_to(recordings)}\0".encode() + content)
    except (OSError, ValueError, KeyError):
        return ""
    return digest.hexdigest()


def _sync(path: Path) -> None:
    file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
    try:
        os.fsync(file)
    finally:
        os.close(file)
