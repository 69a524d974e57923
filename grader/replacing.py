"""Replaces the results of a submission in one go: what is new lies beside what is there until all of it is whole."""

from __future__ import annotations

import shutil
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

#: Within a folder of results: those that are being made.
UNFINISHED = ".unfinished"
_PARTIAL, _BEFORE = ".partial", ".before"
_ASKING = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let a request to end (Ctrl-C, SIGTERM, SIGHUP) wait until a few files are in their places."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        received.append(number)

    heeded = {number: before for number in _ASKING if (before := signal.getsignal(number)) != signal.SIG_IGN}
    for number in heeded:
        signal.signal(number, note)
    try:
        yield
    finally:
        for number, before in heeded.items():
            signal.signal(number, before)
        for number in received[:1]:
            signal.raise_signal(number)


def replace_file(path: Path, text: str) -> None:
    """Write a file in one step, so that nobody reads half of it."""
    replace_files({path: text})


def replace_files(texts: Mapping[Path, str | None]) -> None:
    """Write files that belong together: all are written before the first is put in its place, or none is.

    None stands for a file that is to be there no longer.
    """
    partials = {path: path.with_suffix(path.suffix + _PARTIAL) for path in texts}
    try:
        for path, text in texts.items():
            if text is not None:
                partials[path].write_text(text, encoding="utf-8", newline="\n")
        with uninterrupted():
            for path, partial in partials.items():
                if texts[path] is None:
                    path.unlink(missing_ok=True)
                else:
                    partial.replace(path)
    finally:
        for partial in partials.values():
            partial.unlink(missing_ok=True)


@contextmanager
def beside(results: Path, parts: Sequence[str]) -> Iterator[Path]:
    """Give an empty folder within a folder of results to make new ones in; its parts take their places in the end.

    If the work is broken off, what was there before stays as it was.

    Parameters
    ----------
    parts : sequence of str
        Files and folders that make up the results, the one that says that they are whole last.
    """
    new = results / UNFINISHED
    shutil.rmtree(new, ignore_errors=True)
    new.mkdir(parents=True)
    try:
        yield new
        with uninterrupted():
            # Who is killed in between must not leave beside new parts what says that all is whole.
            if (results / parts[-1]).exists():
                (results / parts[-1]).replace(new / (parts[-1] + _BEFORE))
            for part in parts:
                _put(new / part, results / part, new / (part + _BEFORE))
    finally:
        shutil.rmtree(new, ignore_errors=True)
        with suppress(OSError):  # It is not empty, as a rule.
            results.rmdir()


def _put(new: Path, place: Path, before: Path) -> None:
    """Put a file or a folder in its place; a folder that is there moves aside first, and what is not new goes."""
    if place.is_dir():
        place.rename(before)
    if new.exists():
        new.replace(place)
    else:
        place.unlink(missing_ok=True)
