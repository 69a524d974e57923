"""Replaces files, and the results of a submission, in one go: what is new lies beside what is there until it is whole.

This is the one place where files are replaced: nothing is written through a link that somebody else has laid out.
"""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

#: Within a folder of results: those that are being made.
UNFINISHED = ".unfinished"
_PARTIAL, _BEFORE = ".partial", ".before"
_ASKING = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let a request to end (Ctrl-C, SIGTERM, SIGHUP) wait until a few files are in their places."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    # None is a handler that is not Python's, and could not be put back.
    heeded = {
        n: before for n in _ASKING if (before := signal.getsignal(n)) not in (signal.SIG_IGN, None)
    }
    for number in heeded:
        signal.signal(number, lambda received_one, frame: received.append(received_one))
    try:
        yield
    finally:
        for number, before in heeded.items():
            signal.signal(number, before)
        for number in received[:1]:
            signal.raise_signal(number)


def text_of(path: Path) -> str | None:
    """Return a file's text; None if there is none, or none that can be read as text."""
    try:
        return path.read_text(encoding="utf-8")
    except (FileNotFoundError, UnicodeDecodeError):
        return None


def replace_file(path: Path, text: str | bytes) -> None:
    """Write a file in one step, so that nobody reads half of it."""
    replace_files({path: text})


def replace_files(texts: Mapping[Path, str | bytes | None]) -> None:
    """Write files that belong together: all are written before the first is put in its place, or none is.

    None stands for a file that is to be there no longer. In a folder in which a submission may have laid out links,
    nothing is written through one: each text goes to a new file under a name that cannot be guessed.
    """
    partials = {path: path.with_name(f".{secrets.token_hex(8)}{_PARTIAL}") for path in texts}
    known = {str(partial): str(path) for path, partial in partials.items()}
    try:
        for path, text in texts.items():
            if text is not None:
                with partials[path].open("xb") as file:
                    file.write(text.encode() if isinstance(text, str) else text)
        with uninterrupted():
            for path, partial in partials.items():
                if texts[path] is None:
                    path.unlink(missing_ok=True)
                else:
                    partial.replace(path)
    except OSError as error:
        # The user knows the file by the name that it was to have.
        error.filename = known.get(str(error.filename), error.filename)
        raise
    finally:
        for partial in partials.values():
            partial.unlink(missing_ok=True)


@contextmanager
def atomic_replacement(
    results: Path, parts: Sequence[str], keep: Callable[[Path], bool] = lambda new: False
) -> Iterator[Path]:
    """Give an empty folder within a folder of results to make new ones in; its parts take their places in the end.

    The part that says that they are whole comes last: who is killed in the midst leaves no results that say so. If the
    work is broken off, or a part cannot be put in its place, what was there before stays as it was, unless `keep` says
    of the new folder that what is in it takes its place nevertheless.
    """
    new = results / UNFINISHED
    shutil.rmtree(new, ignore_errors=True)
    new.mkdir(parents=True)
    is_whole = False
    try:
        try:
            yield new
            is_whole = True
        finally:
            with uninterrupted():
                if is_whole or keep(new):
                    _exchange(new, results, parts)
    finally:
        shutil.rmtree(new, ignore_errors=True)
        with suppress(OSError):  # It is not empty, as a rule.
            results.rmdir()


def _exchange(new: Path, results: Path, parts: Sequence[str]) -> None:
    """Move what is there aside, the last part first, and what is new in its place; or undo all of it."""
    moved: list[tuple[Path, Path]] = []
    replaced = [(results / part, new / (part + _BEFORE)) for part in reversed(parts)]
    try:
        for source, target in (*replaced, *((new / part, results / part) for part in parts)):
            if os.path.lexists(source):
                # A folder may lie where it can be copied only, as in a lower layer of a container's file system.
                shutil.move(source, target)
                moved.append((source, target))
    except BaseException:
        for source, target in reversed(moved):
            shutil.move(target, source)
        raise
