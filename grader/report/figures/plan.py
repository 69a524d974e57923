"""What a launch file describes, as a tree."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from grader.evidence.recorded import Recorded
from grader.recording.launch_plan import Argument, MalformedPlanError, Parameter, Plan, Process
from grader.report.figures.svg import Figure, FigureKind
from grader.report.views import fields, literal

_MOST_ITEMS = 60

#: What is called something, its value, and where it stands.
Item = tuple[str, str, str]


class PlanTree(FigureKind):
    """What a launch file describes."""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """List arguments, includes and processes with what they are given."""
        try:
            plan = Plan.from_plain(recorded.record.plan)
        except MalformedPlanError:
            return None  # The checks say so.
        processes = plan.processes[:_MOST_ITEMS]
        environments = [
            [(name, literal(value), "") for name, value in list(p.env.items())[:_MOST_ITEMS]]
            for p in processes
        ]
        shared = (
            [e for e in environments[0] if all(e in other for other in environments)]
            if processes[1:]
            else []
        )
        content = {
            "outcome": plan.outcome,
            "problem": plan.problem.message if plan.problem else "",
            "arguments": [
                (a.name, _default(a), _location(a.file, a.line))
                for a in plan.arguments[:_MOST_ITEMS]
            ],
            "includes": [
                (i.file, fields(i.arguments), _location(i.by, i.line))
                for i in plan.includes[:_MOST_ITEMS]
            ],
            "environment": shared,
            "processes": [
                {
                    "name": p.full_name or p.id,
                    "runs": _program(p),
                    "where": _location(p.file, p.line),
                    "conditions": _conditions(p),
                    # A node's own arguments are those before the ones of ROS; of an executable they are what runs.
                    "words": list(
                        itertools.takewhile(lambda word: word != "--ros-args", p.argv[:_MOST_ITEMS])
                    )
                    if p.kind != "executable"
                    else [],
                    "parameters": [
                        item for given in p.parameters[:_MOST_ITEMS] for item in _parameters(given)
                    ],
                    "environment": [e for e in environment if e not in shared],
                    "remappings": p.remappings[:_MOST_ITEMS],
                }
                for p, environment in zip(processes, environments, strict=True)
            ],
            "not_started": [
                (
                    item.get("what") or "",
                    _written(str(item.get("why") or "")),
                    _location(item.get("file"), item.get("line")),
                )
                for item in plan.not_started[:_MOST_ITEMS]
            ],
            "warnings": [
                (w.message, _location(w.file, w.line)) for w in plan.warnings[:_MOST_ITEMS]
            ],
        }
        return Figure(table="plan", content=content)


def _location(file: str | None, line: int | None) -> str:
    return f"{file}:{line}" if file and line else file or ""


def _default(argument: Argument) -> str:
    default = "must be given" if argument.default is None else literal(argument.default)
    return default + (f" (one of {', '.join(argument.choices[:20])})" if argument.choices else "")


def _program(process: Process) -> str:
    if process.kind == "executable":
        return " ".join((process.path, *process.argv[:_MOST_ITEMS]))[:300]
    return "/".join(part for part in (process.package, process.executable) if part) or process.path


def _written(condition: str) -> str:
    """`launch` itself describes a configuration by a shorter name than the one that is written."""
    return condition.replace("LaunchConfig(", "LaunchConfiguration(")


def _conditions(process: Process) -> list[str]:
    named = ((c, f" as {c.name}" if c.name else "") for c in process.components[:_MOST_ITEMS])
    found = [
        _written(process.condition_note),
        _when(process.when) if process.when else "",
        "started again whenever it ends" if process.respawn else "",
        "configured and activated at once" if process.autostart else "",
        f"not started here: {process.absent}" if process.absent else "",
        *(f"loads {component.plugin or ''}{name}" for component, name in named),
    ]
    return [text for text in found if text]


_MOMENTS = {
    "on_start_of": "starts when {} has started",
    "on_exit_of": "starts when {} has ended",
    "on_completion_of": "starts after {}",
    "on_transition_of": "starts when {} has changed its state",
    "on_shutdown": "starts at the shutdown",
}


def _when(when: Mapping[str, Any]) -> str:
    """Put what a process waits for in words: `after_s: 2` is "starts after 2 s"."""
    moments = [words.format(when[key]) for key, words in _MOMENTS.items() if key in when]
    if "state" in when:
        moments.append(f"to {when['state']}")
    if "after_s" in when:
        since = when.get("since")
        known = (
            {k: v for k, v in since.items() if k != "since"} if isinstance(since, Mapping) else {}
        )
        later = f", {_when(known).replace('starts', 'counted from', 1)}" if known else ""
        moments.append(f"starts after {when['after_s']} s{later}")
    return " ".join(moments)


def _parameters(given: Parameter) -> list[Item]:
    """Return a parameter, or those of a file with the nodes that they are for, unless for every one."""
    if given.name is not None:
        return [(given.name, literal(given.value), given.type or "")]
    inside = [
        (
            name,
            literal(value),
            f"{given.file}{'' if node.strip('/') in ('', '**') else f', for {node}'}",
        )
        for node, values in given.sections()
        for name, value in values.items()
    ]
    return inside[:_MOST_ITEMS] or [(f"file {given.file}", "", "")]
