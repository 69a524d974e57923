"""Replaces files, and the results of a submission, in one step: new files are next to the old ones until all are complete.

All files are replaced by this module: nothing is written through another user's link.
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

#: Folder of unfinished results within a folder of results.
UNFINISHED = ".unfinished"
#: Suffixes of the names of files that are being written, and of parts that are being replaced.
_PARTIAL = ".partial"
_BEFORE = ".before"
_ASKING = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay a request to end (Ctrl-C, SIGTERM, SIGHUP) until a few files are in their places."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    # None is a handler of another library, which could not be restored.
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
    """Write a file in one step; no reader sees half of it."""
    replace_files({path: text})


def replace_files(texts: Mapping[Path, str | bytes | None]) -> None:
    """Write files that belong together: all are written before the first is put in its place, or none is.

    None stands for a file to be removed. A submission may have laid out links in the folder, and nothing is written through
    a link: each text goes to a new file under a name that cannot be guessed.
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
        # The user knows the file by its final name.
        error.filename = known.get(str(error.filename), error.filename)
        raise
    finally:
        for partial in partials.values():
            partial.unlink(missing_ok=True)


@contextmanager
def atomic_replacement(
    results: Path, parts: Sequence[str], keep: Callable[[Path], bool] = lambda new: False
) -> Iterator[Path]:
    """Yield an empty folder within a folder of results for new ones; its parts take their places in the end.

    The part that marks the results as complete is the last of `parts`, and a process that is killed before leaves
    results without the mark. If the work is broken off, or a part cannot be put in its place, the old results stay
    unchanged, unless `keep` returns True for the new folder: then its parts take their places nevertheless.
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
        with suppress(OSError):  # The folder is usually not empty.
            results.rmdir()


def _exchange(new: Path, results: Path, parts: Sequence[str]) -> None:
    """Move the old parts aside, the last one first, and the new ones in their places; undo all moves if one fails."""
    moved: list[tuple[Path, Path]] = []
    moves = [(results / part, new / (part + _BEFORE)) for part in reversed(parts)]
    moves += [(new / part, results / part) for part in parts]
    try:
        for source, target in moves:
            if os.path.lexists(source):
                # A folder in a lower layer of a container's file system can only be copied.
                shutil.move(source, target)
                moved.append((source, target))
    except BaseException:
        for source, target in reversed(moved):
            shutil.move(target, source)
        raise
