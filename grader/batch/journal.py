"""`journal.jsonl` in a results folder: what has been graded there, so that an interrupted run goes on where it stopped.

Only ever appended to, a line at a time, each on the disk before the run goes on. A result counts as whole if the
journal says so, and if the recordings in its folder are those of which the journal speaks. It may end anywhere:
half a line is no line.
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
from dataclasses import asdict, dataclass, fields, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from grader.errors import GraderError
from grader.recording.session import SESSION_FILE
from grader.recording.submission import read_submission
from grader.result_folder import RECORDINGS

JOURNAL_FILE = "journal.jsonl"
#: Where results stand until they are whole.
UNFINISHED = ".unfinished"
#: Earlier results of submissions whose present state could not be graded.
OUTDATED = ".outdated"
#: In place of the hash of a policy: another needs another judgement.
_UNJUDGED = ""
_SCHEMA = "ros-lab-grader/journal/v1"


@dataclass(frozen=True)
class Entry:
    """What the journal says of a submission that was graded.

    Attributes
    ----------
    key : str
        Hash of all that the recordings and their judgement depend on.
    policy : str
        Hash of what people decided since, such as overrides; another needs another judgement only.
    isolation : str
        Level at which students' code was confined.
    recordings : str
        Hash of the recordings; see `recordings_sha256`.
    """

    key: str
    policy: str
    isolation: str
    recordings: str


class Journal:
    """The journal of one run, which has the results folder for itself."""

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
        """The number from which the seeds of this class come, until it is graded afresh."""
        assert self._seed is not None
        return self._seed

    @classmethod
    @contextmanager
    def open(cls, results: Path, *, afresh: bool = False) -> Iterator[Journal]:
        """Open a results folder for a run, and remove what an interrupted one left half done.

        Parameters
        ----------
        afresh : bool
            Whether what was graded before shall not count.

        Raises
        ------
        GraderError
            If another run is at work there.
        """
        results.mkdir(parents=True, exist_ok=True)
        file = os.open(results / JOURNAL_FILE, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        try:
            _lock(file, results)
            shutil.rmtree(results / UNFINISHED, ignore_errors=True)
            try:
                yield cls(results, file, afresh=afresh)
            finally:
                shutil.rmtree(results / UNFINISHED, ignore_errors=True)
        finally:
            os.close(file)

    def holds(self, name: str, key: str) -> Entry | None:
        """Return the entry of a submission that was graded from the same, if its recordings are still there."""
        entry = self._entries.get(name)
        if entry is None or entry.key != key:
            return None
        try:
            return entry if recordings_sha256(self.results / name) == entry.recordings else None
        except (OSError, ValueError, KeyError):
            return None

    def unfinished(self, name: str) -> Path:
        """Return an empty folder for a submission's results until they are whole."""
        folder = self._new(name)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        return folder

    def finish(self, name: str, key: str, policy: str, isolation: str) -> None:
        """Put a submission's whole results, which are on the disk, in their place, and note that.

        Raises
        ------
        OSError
            If they are not whole, or cannot be put there.
        """
        new, before = self._new(name), self.results / UNFINISHED / "before" / name
        entry = Entry(key, policy, isolation, recordings_sha256(new))
        before.parent.mkdir(exist_ok=True)
        with suppress(FileNotFoundError):
            (self.results / name).rename(before)
        new.rename(self.results / name)
        _sync(self.results)
        self._note(name, entry)
        shutil.rmtree(before, ignore_errors=True)

    def judged_again(self, name: str, policy: str) -> None:
        """Note that a submission's recordings, which the journal holds, were judged by another policy."""
        self._note(name, replace(self._entries[name], policy=policy))

    def abandon(self, name: str, why: GraderError) -> None:
        """Note that a submission could not be graded; the next run tries again.

        Earlier results of it are put aside, since they are not of what was handed in.
        """
        shutil.rmtree(self._new(name), ignore_errors=True)
        self._put_outdated(name)
        self._entries.pop(name, None)
        self._append({"not graded": name, **vars(why), "exit_status": why.exit_status})

    def keep_unjudged(self, name: str, key: str, isolation: str) -> None:
        """Put recordings in their place that could not be judged; the next run judges them.

        Raises
        ------
        OSError
            If they are not whole, or cannot be put there.
        """
        new = self._new(name)
        entry = Entry(key, _UNJUDGED, isolation, recordings_sha256(new))
        self._put_outdated(name)
        new.rename(self.results / name)
        _sync(self.results)
        self._note(name, entry)

    def _put_outdated(self, name: str) -> None:
        shutil.rmtree(self.results / OUTDATED / name, ignore_errors=True)
        if (self.results / name).is_dir():
            (self.results / OUTDATED).mkdir(exist_ok=True)
            (self.results / name).rename(self.results / OUTDATED / name)

    def _note(self, name: str, entry: Entry) -> None:
        self._entries[name] = entry
        self._append({"graded": name, **asdict(entry)})

    def _new(self, name: str) -> Path:
        return self.results / UNFINISHED / "new" / name

    def _read(self) -> None:
        with (self.results / JOURNAL_FILE).open("rb") as file:
            content = file.read()
        for line in content.split(b"\n"):
            with suppress(ValueError, KeyError, TypeError, AttributeError):
                self._take(json.loads(line))
        if content and not content.endswith(b"\n"):
            os.write(self._file, b"\n")

    def _take(self, line: Mapping[str, Any]) -> None:
        if "journal" in line:
            self._seed = int(line["run_seed"]) if line["journal"] == _SCHEMA else None
            self._entries.clear()
        elif "graded" in line:
            self._entries[str(line["graded"])] = Entry(*(str(line[field.name]) for field in fields(Entry)))
        elif "not graded" in line:
            self._entries.pop(str(line["not graded"]), None)

    def _append(self, line: Mapping[str, Any]) -> None:
        at = datetime.now(timezone.utc).isoformat(timespec="seconds")
        os.write(self._file, (json.dumps({**line, "at": at}) + "\n").encode())
        os.fsync(self._file)


def _lock(file: int, results: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise GraderError(
            "another run of grade is at work in this results folder",
            where=str(results),
            remedy="Wait until it has ended, or give another folder by -o.",
        ) from None


def recordings_sha256(folder: Path) -> str:
    """Return the hash that tells the recordings of a submission's results from any others.

    The records hold their own times, so no two are equal; of the bags, which are large, the sizes must do.

    Raises
    ------
    OSError
        If there are none.
    ValueError
        If they are damaged.
    """
    recordings = folder / RECORDINGS
    digest = hashlib.sha256(read_submission(recordings).sha256.encode())
    for path in sorted(path for path in recordings.glob("*/*") if path.is_file()):
        content = path.read_bytes() if path.name == SESSION_FILE else str(path.stat().st_size).encode()
        digest.update(f"\0{path.relative_to(recordings)}\0".encode() + content)
    return digest.hexdigest()


def _sync(folder: Path) -> None:
    file = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)
