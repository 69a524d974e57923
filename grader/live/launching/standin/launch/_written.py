"""Files that a launch file writes while it is read: nothing else of the evaluation stays, so they go with the plan."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ._session import Session

MOST_BYTES = 256 * 1024
MOST_FILES = 50


def carry_written_files(session: Session, since_ns: int) -> None:
    """Put the files that processes are given, and that were written since a time, where the nodes will find them.

    Parameters
    ----------
    session : Session
        Its processes are changed: instead of the path, a place among the plan's own files is given.
    since_ns : int
        Time of the system's clock; what is older lies in the workspace, and stays there.
    """
    places: dict[str, str] = {}
    for process in session.processes:
        for path in _paths_given_to(process):
            if path not in places and len(places) < MOST_FILES and (text := _written(path, since_ns)) is not None:
                stem, suffix = os.path.splitext(os.path.basename(path))  # noqa: PTH119, PTH122
                places[path] = session.add_file(stem, suffix, text)
    for process in session.processes if places else ():
        _replace(process, places, session)


def _paths_given_to(process: dict[str, Any]) -> Iterator[str]:
    values = [p["value"] for p in process.get("parameters", ()) if isinstance(p.get("value"), str)]
    for text in [process["path"], *process["argv"], *process["env"].values(), *values]:
        for part in (text, *text.split("=")[1:]):
            if part.startswith("/"):
                yield part


def _written(path: str, since_ns: int) -> str | None:
    try:
        status = os.stat(path)  # noqa: PTH116
        new = os.path.isfile(path) and status.st_mtime_ns >= since_ns  # noqa: PTH113
        return Path(path).read_text(encoding="utf-8") if new and status.st_size <= MOST_BYTES else None
    except (OSError, ValueError):
        return None


def _replace(process: dict[str, Any], places: dict[str, str], session: Session) -> None:
    def replaced(text: str) -> str:
        for path in sorted(places, key=len, reverse=True):
            text = text.replace(path, places[path])
        return text

    process["path"] = replaced(process["path"])
    process["argv"] = [replaced(word) for word in process["argv"]]
    process["env"] = {name: replaced(value) for name, value in process["env"].items()}
    own = {name: replaced(text) for name, text in process.get("parameter_files", {}).items()}
    given = [process["path"], *process["argv"], *process["env"].values(), *own.values()]
    for place in places.values():
        if any(place in text for text in given):
            name = place.removeprefix("{parameters}/")
            own[name] = session.parameter_files[name]
    process["parameter_files"] = own
    session.parameter_files.update(own)
