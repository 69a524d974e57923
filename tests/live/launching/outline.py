"""What two evaluations of one launch file must agree on, whichever `launch` made them."""

from __future__ import annotations

import re
from typing import Any

_KEYS = ("id", "kind", "package", "name", "namespace", "when", "env", "cwd", "shell", "respawn")


def _plain(text: str) -> str:
    """A text without what differs from run to run: names of files, and addresses of objects."""
    return re.sub(r"\{parameters\}/\S+| at 0x[0-9a-f]+", "…", text)


def _process(plain: dict[str, Any], *, lines: bool) -> list[Any]:
    env = {name: _plain(value) for name, value in plain["env"].items()}
    kept = [env if key == "env" else plain.get(key) for key in _KEYS]
    return [*kept, plain.get("remappings") or [], plain["line"] if lines else None]


def outline(plan: dict[str, Any], *, lines: bool) -> dict[str, Any]:
    """Processes with what reaches them, arguments, includes, messages; lines of markup are the stand-in's alone."""
    processes = [_process(plain, lines=lines) for plain in plan["processes"]]
    kinds = {"logs": ("message", "when"), "includes": ("file", "arguments"), "shutdowns": ("reason", "when")}
    listed = {kind: [[entry[k] for k in keys] for entry in plan[kind]] for kind, keys in kinds.items()}
    declared = [(a["name"], a["default"], a["line"] if lines else None) for a in plan["arguments"]]
    return {"processes": processes, "arguments": declared, "configurations": plan["configurations"], **listed}
