"""The common parts of two evaluations of a launch file, by any version of `launch`."""

from __future__ import annotations

import re
from typing import Any

from launch_plan.plan import Plan

_KEYS = (
    "id",
    "kind",
    "package",
    "name",
    "namespace",
    "when",
    "env",
    "cwd",
    "shell",
    "emulate_tty",
    "respawn",
)


def _plain(text: str) -> str:
    """Return a text without parts that differ between runs: file names, and object addresses."""
    return re.sub(r"\{parameters\}/\S+|/tmp/tmp\w+|<launch[\w.]+ object at 0x[0-9a-f]+>", "…", text)


def _process(plain: dict[str, Any], parameters: dict[str, Any], *, lines: bool) -> list[Any]:
    env = {name: _plain(value) for name, value in plain["env"].items()}
    words = [_plain(word) for word in [*plain.get("prefix", ()), plain["path"], *plain["argv"]]]
    kept = [env if key == "env" else plain.get(key) for key in _KEYS]
    return [
        *kept,
        words,
        _plain(repr(parameters)),
        plain.get("remappings") or [],
        plain["line"] if lines else None,
    ]


def outline(plan: dict[str, Any], *, lines: bool) -> dict[str, Any]:
    """Return processes with their inputs, arguments, includes and messages.

    Only the stand-in gives lines of markup.
    """
    read = Plan.from_plain(plan)
    processes = []
    for plain, process in zip(plan["processes"], read.processes, strict=True):
        processes.append(_process(plain, process.effective_parameters("/node"), lines=lines))
    kinds = {
        "logs": ("message", "when"),
        "includes": ("file", "arguments"),
        "shutdowns": ("reason", "when"),
    }
    listed = {}
    for kind, keys in kinds.items():
        listed[kind] = [[entry[k] for k in keys] for entry in plan[kind]]
    declared = [(a["name"], a["default"], a["line"] if lines else None) for a in plan["arguments"]]
    return {
        "processes": processes,
        "arguments": declared,
        "configurations": plan["configurations"],
        **listed,
    }
