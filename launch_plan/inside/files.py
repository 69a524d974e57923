"""Files of a plan: those written by `launch` for its nodes, and those written by the launch file."""

from __future__ import annotations

import os
import re
import time
from pathlib import Path
from typing import Any

from launch_plan.format import PARAMETERS_PLACEHOLDER

#: Most files written by the launch file, and most bytes of one of them.
FILE_LIMIT, FILE_BYTES = 50, 256 * 1024
#: Lag of file times behind the clock, in ns.
_CLOCK_GRAIN_NS = 10_000_000
_NOT_IN_NAMES = re.compile(r"[^\w-]")
_FOLDER = f"{PARAMETERS_PLACEHOLDER}/"


class PlanFiles:
    """Texts by file name; a runner writes the files before it starts the processes."""

    def __init__(self, root: str) -> None:
        self.root = root
        self.texts: dict[str, str] = {}
        #: Paths of the files that `launch` writes from the values for one node.
        self.of_nodes: set[str] = set()
        #: Name of the node by path of a parameter file.
        self.labels: dict[str, str] = {}
        self._names: dict[str, int] = {}
        self._began_ns = time.time_ns() - _CLOCK_GRAIN_NS

    def add(self, name: str, suffix: str, text: str, *, of_node: bool = False) -> str:
        """Keep the text of a file; return its path in the command line, e.g. `{parameters}/arm_1.yaml`."""
        stem = _NOT_IN_NAMES.sub("_", name) or "node"
        number = self._names.get(stem, 0) + 1
        self._names[stem] = number
        file_name = f"{stem}_{number}{suffix}"
        self.texts[file_name] = text
        path = _FOLDER + file_name
        if of_node:
            self.of_nodes.add(path)
        return path

    def text_of(self, path: str) -> str:
        """Return the text of a file of the plan or of the disk."""
        kept = self.texts.get(path.removeprefix(_FOLDER))
        return Path(path).read_text() if kept is None else kept

    def carry_written(self, processes: list[dict[str, Any]]) -> None:
        """Move files into the plan if the launch file wrote them and a process is given their paths."""
        places: dict[str, str] = {}
        for process in processes:
            for path in _possible_paths(process):
                if path in places or len(places) >= FILE_LIMIT:
                    continue
                written = self._written(path)
                if written is not None:
                    places[path] = self._added(path, written)
        if not places:
            return
        for process in processes:
            self._replace(process, places)

    def _added(self, path: str, text: str) -> str:
        stem, suffix = os.path.splitext(os.path.basename(path))  # noqa: PTH119, PTH122
        if not suffix[1:].isalnum():
            suffix = ""
        if stem.startswith("launch_params_") and path in self.labels:
            stem = self.labels[path]
            suffix = ".yaml"
        return self.add(stem, suffix, text)

    def _written(self, path: str) -> str | None:
        """Return the text of a file that exists only during the evaluation."""
        if not path.startswith("/"):
            return None
        # Parameter files of the ROS installation are missing where the processes run.
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
        """Write the new paths into a process, and give it the files that it refers to."""
        longest_first = sorted(places, key=len, reverse=True)

        def replaced(text: str) -> str:
            for path in longest_first:
                text = text.replace(path, places[path])
            return text

        process["path"] = replaced(process["path"])
        process["argv"] = [replaced(word) for word in process["argv"]]
        process["env"] = {name: replaced(value) for name, value in process["env"].items()}
        files = process.get("parameter_files", {})
        own = {name: replaced(text) for name, text in files.items()}
        given = [process["path"], *process["argv"], *process["env"].values(), *own.values()]
        for place in places.values():
            if any(place in text for text in given):
                name = place.removeprefix(_FOLDER)
                own[name] = self.texts[name]
        process["parameter_files"] = own
        self.texts.update(own)


def _possible_paths(process: dict[str, Any]) -> list[str]:
    """Return the texts given to a process, and their parts behind `=`, e.g. `/tmp/a.txt` of `--file=/tmp/a.txt`."""
    texts = [process["path"], *process["argv"], *process["env"].values()]
    for parameter in process["parameters"]:
        if isinstance(parameter.get("value"), str):
            texts.append(parameter["value"])
    paths: list[str] = []
    for text in texts:
        paths.append(text)
        paths.extend(text.split("=")[1:])
    return paths
