"""The files that a plan holds: those that `launch` writes for its nodes, and those that the launch file writes."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

FILE_LIMIT, FILE_BYTES = 50, 256 * 1024
_CLOCK_GRAIN_NS = 10_000_000  # by so much the times of files may be behind


class PlanFiles:
    """Texts by the names of the files that will hold them when the processes run."""

    def __init__(self, root: str) -> None:
        self.root = root
        self.texts: dict[str, str] = {}
        #: Files that `launch` itself writes, out of the values that one node is given.
        self.of_nodes: set[str] = set()
        #: What a file of parameters is called after, by its path.
        self.labels: dict[str, str] = {}
        self._names: dict[str, int] = {}
        self._began_ns = time.time_ns() - _CLOCK_GRAIN_NS

    def add(self, name: str, suffix: str, text: str, *, of_node: bool = False) -> str:
        """Keep the text of a file to be written when the process runs; the path as it stands in the command line."""
        stem = "".join(c if c.isalnum() or c in "_-" else "_" for c in name) or "node"
        number = self._names[stem] = self._names.get(stem, 0) + 1
        self.texts[f"{stem}_{number}{suffix}"] = text
        path = f"{{parameters}}/{stem}_{number}{suffix}"
        self.of_nodes |= {path} if of_node else set()
        return path

    def text_of(self, path: str) -> str:
        """The text of a file, whether the plan holds it or the disk."""
        kept = self.texts.get(path.removeprefix("{parameters}/"))
        return Path(path).read_text() if kept is None else kept

    def carry_written(self, processes: list[dict[str, Any]]) -> None:
        """Put the files that processes are given, and that were written meanwhile, where the nodes will find them."""
        places: dict[str, str] = {}
        for process in processes:
            values = [p["value"] for p in process["parameters"] if isinstance(p.get("value"), str)]
            for text in [process["path"], *process["argv"], *process["env"].values(), *values]:
                for path in (text, *text.split("=")[1:]):
                    written = (
                        None if path in places or len(places) >= FILE_LIMIT else self._written(path)
                    )
                    if written is not None:
                        places[path] = self._added(path, written)
        for process in processes if places else ():
            self._replace(process, places)

    def _added(self, path: str, text: str) -> str:
        stem, suffix = os.path.splitext(os.path.basename(path))  # noqa: PTH119, PTH122
        suffix = suffix if suffix[1:].isalnum() else ""
        if stem.startswith("launch_params_") and path in self.labels:
            stem, suffix = self.labels[path], ".yaml"
        return self.add(stem, suffix, text)

    def _written(self, path: str) -> str | None:
        if not path.startswith("/"):
            return None
        # A file of parameters that came with ROS is there while the file is evaluated, and not afterwards.
        foreign = path in self.labels and not Path(path).is_relative_to(Path(self.root).parent)
        try:
            status = os.stat(path)  # noqa: PTH116
            wanted = foreign or status.st_mtime_ns >= self._began_ns
            if not wanted or status.st_size > FILE_BYTES or not os.path.isfile(path):  # noqa: PTH113
                return None
            return Path(path).read_text(encoding="utf-8")
        except (OSError, ValueError):
            return None

    def _replace(self, process: dict[str, Any], places: dict[str, str]) -> None:
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
                own[name] = self.texts[name]
        process["parameter_files"] = own
        self.texts.update(own)
