"""Commands that show a fault to students, made from the kind of a check, its parameters and its steps."""

from __future__ import annotations

import itertools
import json
import shlex
import string
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from pathlib import PurePosixPath
from typing import Any

from grader.lab.lab_code import OwnParameters
from grader.lab.rubric import CheckSpec, Rubric, StepSpec
from grader.recording.submission import SubmissionRecord
from grader.result import Finding, Outcome

#: Greatest number of commands, one for each of the four profiles of a comparison.
_MOST = 4

#: Parameters that name a file of the submission.
_FILES = ("artifact", "launch")
#: Commands that show messages, and that do the same as a step.
_ECHO, _STEP = ("ros2 topic echo {topic}",), ("{step}",)
#: Command for an ended program, and the rule for findings about one.
_RUN, _ENDED = ("python3 {artifact}",), "explained"
#: Kind of a check -> commands that show its fault while the program runs. `{name}` is a parameter, a name within one,
#: or a command that does the same as the step that a parameter names.
_COMMANDS: Mapping[str, tuple[str, ...]] = {
    "topic_published": ("ros2 topic list -t",),
    **dict.fromkeys(("topic_rate", "topic_jitter"), ("ros2 topic hz {topic}",)),
    **dict.fromkeys(("field_range", "field_matches", "reaches", "topic_equals_oracle"), _ECHO),
    "silent_until": _ECHO,
    **dict.fromkeys(("requested_qos", "offered_qos"), ("ros2 topic info -v {topic}",)),
    "topics_subscribed": ("ros2 node info {node}",),
    **dict.fromkeys(("survives", "call_answered", "parameters_declared", "call_value"), _STEP),
    **dict.fromkeys(("parameter_rejected", "launch_loads"), _STEP),
    "package_builds": ("colcon build",),
    "service_offered": ("ros2 service list -t",),
    "action_server": ("ros2 action info -t {action}", "{step}"),
    "parameter_effect": ("{set_step}",),
    "lifecycle": ("ros2 lifecycle nodes",),
    "transform_tree": ("ros2 topic echo {topic}", "ros2 run tf2_tools view_frames"),
    "launch_arguments": ("{step} --show-args",),
    "launch_nodes": ("{step}", "ros2 node list"),
    "launch_parameters": ("{step}", "ros2 param dump {node}"),
}


def commands_of(
    spec: CheckSpec,
    rubric: Rubric,
    submission: SubmissionRecord,
    used: Mapping[str, str],
    finding: Finding,
) -> tuple[str, ...]:
    """Return the commands that show the fault of a check; empty if it lost no points.

    Parameters
    ----------
    used
        Names that the student uses, by those of the rubric.
    """
    if finding.outcome not in (Outcome.FAILED, Outcome.PARTIAL):
        return ()
    if _is_missing(spec, submission):
        return ()
    scope = _Scope(spec, rubric, submission, used, finding.reason)
    lines: dict[str, None] = {}
    for template in _templates(spec, finding):
        for line in scope.filled(template):
            lines.setdefault(line)
            if len(lines) == _MOST:
                return tuple(lines)
    return tuple(lines)


def _is_missing(spec: CheckSpec, submission: SubmissionRecord) -> bool:
    """Return whether the file that a check is about was not handed in, so that there is nothing to run."""
    missing = {fact.name for fact in submission.artifacts if fact.path is None}
    return any(getattr(spec.parameters, name, None) in missing for name in _FILES)


def _templates(spec: CheckSpec, finding: Finding) -> tuple[str, ...]:
    """Return the templates of a check, which a lab's own check states itself.

    The list of topics holds a silent publisher too, so an echo shows that one. An ended program shows its
    traceback.
    """
    if finding.is_silent:
        return _ECHO
    if isinstance(spec.parameters, OwnParameters):
        templates = spec.parameters.traits.commands
    else:
        templates = _COMMANDS.get(spec.check, ())
    if finding.decided_by == _ENDED:
        return (*_RUN, *templates)
    return templates


class _Scope:
    """Values for the names in the templates of a check's commands."""

    def __init__(
        self,
        spec: CheckSpec,
        rubric: Rubric,
        submission: SubmissionRecord,
        used: Mapping[str, str],
        reason: str,
    ) -> None:
        self._own = {**spec.parameters.model_dump(by_alias=True), "session": spec.session}
        if spec.session:
            steps = rubric.sessions[spec.session].steps
        else:
            steps = ()
        self._steps = {step.label: step for step in steps if step.label is not None}
        self._paths = {
            fact.name: fact.path for fact in submission.artifacts if fact.path is not None
        }
        self._used = used
        self._reason = reason
        self._package = _package_with(submission, self._paths.get("launch", ""))
        self._build = _BUILD if self._package else ""

    def filled(self, template: str) -> Iterator[str]:
        """Yield the template with each combination of values for its names; nothing if a name has no value."""
        fields = string.Formatter().parse(template)
        names = list(dict.fromkeys(name for _, name, _, _ in fields if name))
        for values in itertools.product(*map(self._values, names)):
            yield template.format(**dict(zip(names, values, strict=True)))

    def _values(self, name: str) -> Sequence[str]:
        """Return the values for a name.

        They are the command of the step that the parameter of this name refers to, the parameter's
        value, or the values within other parameters. If the reason mentions some of the latter,
        only these.
        """
        value = self._own.get(name)
        if isinstance(value, str) and value in self._steps:
            return self._lines(self._steps[value])
        if value is not None:
            if name in _FILES:
                return [self._file(name, value)]
            return [self._quoted(value)]
        within = list(dict.fromkeys(_within(self._own, name)))
        lines: list[str] = []
        labels = [label for label in within if label in self._steps]
        for label in self._failed(labels):
            lines += self._lines(self._steps[label])
        if labels:
            return lines
        mentioned = [each for each in within if self._is_mentioned(each)]
        return [self._quoted(each) for each in mentioned or within]

    def _failed(self, labels: Sequence[str]) -> Sequence[str]:
        """Return the labels of the steps that the reason mentions, or else all of them."""
        mentioned = [label for label in labels if self._names_step(label)]
        return mentioned or labels

    def _names_step(self, label: str) -> bool:
        """Tell whether the reason mentions a step, as in `'enable'`, `"enable"` or `enable: No answer ...`."""
        quoted = (f"'{label}'", f'"{label}"', f"{label}: ")
        return any(text in self._reason for text in quoted)

    def _is_mentioned(self, name: str) -> bool:
        used = self._used.get(name, name)
        return name in self._reason or used in self._reason

    def _lines(self, step: StepSpec) -> list[str]:
        """Return the commands that do the same as a step in a terminal."""
        inner = copy(self)
        inner._own = {}
        for name, value in step.parameters.items():
            if isinstance(value, Mapping):
                value = json.dumps(value)
            inner._own[name] = value
        lines: list[str] = []
        for template in step.step.commands():
            lines += inner.filled(template)
        if "launch" not in inner._own:
            return lines
        return [f"{self._build}{line}" for line in lines]

    def _file(self, name: str, value: str) -> str:
        """Return the path of a file, or the package and the name of a launch file that a package installs."""
        path = self._paths.get(value, value)
        if name != "launch":
            return shlex.quote(path)
        if not self._package:
            return shlex.quote(path)
        return f"{self._package} {shlex.quote(PurePosixPath(path).name)}"

    def _quoted(self, value: Any) -> str:
        """Return a value as a word of a command, or the values of a mapping or list as several words."""
        if isinstance(value, Mapping):
            return " ".join(map(self._quoted, value.values()))
        if isinstance(value, (list, tuple)):
            return " ".join(map(self._quoted, value))
        return shlex.quote(self._used.get(str(value), str(value)))


#: Commands after which ROS finds a package of the submission.
_BUILD = "colcon build && . install/setup.bash && "


def _package_with(submission: SubmissionRecord, path: str) -> str:
    """Return the name of the built package that installs a launch file; empty without one.

    By its path alone, `ros2 launch` would find the executables of no such package.
    """
    for package in submission.packages:
        if package.shared is None:
            continue
        if submission.build_of(package) is None:
            continue
        if path in package.shared.values():
            return package.name
    return ""


def _within(value: Any, name: str) -> Iterator[str]:
    """Yield the texts of a name, or of its plural, in nested parameters."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key == name and isinstance(inner, str):
                yield inner
            elif key == f"{name}s" and not isinstance(inner, Mapping):
                yield from (text for text in inner if isinstance(text, str))
            yield from _within(inner, name)
    elif isinstance(value, (list, tuple)):
        for inner in value:
            yield from _within(inner, name)
