"""Commands with which students see a fault by themselves: from the kind of a check, its parameters and its steps."""

from __future__ import annotations

import itertools
import json
import shlex
import string
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from typing import Any

from grader.lab.rubric import CheckSpec, Rubric, StepSpec
from grader.recording.submission import SubmissionRecord
from grader.result import Finding, Outcome

#: Of the four profiles of a comparison, each.
_MOST = 4

#: Parameters that name a file of the submission.
_FILES = ("artifact", "launch")
#: Plays what the grader sent once more, from the folder of the report.
_ECHO, _STEP = ("ros2 topic echo {topic}",), ("{step}",)
_REPLAY = ("ros2 bag play recordings/{session} --topics {streams}",)
#: Kind of a check -> commands that show its fault while the program runs. `{name}` is a parameter, a name within one,
#: or what does the same as the step that a parameter names.
_COMMANDS: Mapping[str, tuple[str, ...]] = {
    "topic_published": ("ros2 topic list -t",),
    **dict.fromkeys(
        ("topic_rate", "topic_jitter", "topics_carry_traffic"), ("ros2 topic hz {topic}",)
    ),
    "message_values": ("ros2 topic echo --once {topic}",),
    **dict.fromkeys(
        ("sinusoids", "field_range", "field_matches", "reaches", "topic_equals_oracle"), _ECHO
    ),
    **dict.fromkeys(("silent_until", "stops_publishing"), _ECHO),
    **dict.fromkeys(
        ("requested_qos", "offered_qos", "qos_profiles"), ("ros2 topic info -v {topic}",)
    ),
    "topics_subscribed": ("ros2 node info {node}",),
    **dict.fromkeys(("reported_series", "reported_statistics"), _REPLAY),
    **dict.fromkeys(
        ("survives", "call_answered", "parameters_declared", "calls_in_time", "call_value"), _STEP
    ),
    **dict.fromkeys(("parameter_rejected", "launch_loads"), _STEP),
    "service_offered": ("ros2 service list -t",),
    "call_gated": ("{set_step}", "{refused_step}"),
    "action_server": ("ros2 action info -t {action}", "{step}"),
    "parameter_effect": ("{set_step}",),
    "lifecycle": ("ros2 lifecycle nodes",),
    "transform_tree": ("ros2 topic echo {topic}", "ros2 run tf2_tools view_frames"),
    "launch_arguments": ("{step} --show-args",),
    **dict.fromkeys(("launch_nodes", "launch_parameters"), ("{step} --print",)),
    **dict.fromkeys(("ends_by_itself", "reported_traffic"), ("python3 {artifact}",)),
}


def commands_of(
    spec: CheckSpec,
    rubric: Rubric,
    submission: SubmissionRecord,
    used: Mapping[str, str],
    finding: Finding,
) -> tuple[str, ...]:
    """Return the commands that show what a check lost points for; empty where it lost none, or its kind has none.

    `used` are the names that the student uses, by those that the rubric gives.
    """
    scope = _Scope(spec, rubric, submission, used, finding.reason)
    templates = (
        _COMMANDS.get(spec.check, ())
        if finding.outcome in (Outcome.FAILED, Outcome.PARTIAL)
        else ()
    )
    lines = (line for template in templates for line in scope.filled(template))
    return tuple(itertools.islice(dict.fromkeys(lines), _MOST))


class _Scope:
    """What stands for the names in the templates of a check's commands."""

    def __init__(
        self,
        spec: CheckSpec,
        rubric: Rubric,
        submission: SubmissionRecord,
        used: Mapping[str, str],
        reason: str,
    ) -> None:
        self._own = {**spec.parameters.model_dump(by_alias=True), "session": spec.session}
        steps = rubric.sessions[spec.session].steps if spec.session else ()
        self._steps = {step.label: step for step in steps if step.label is not None}
        self._paths = {
            fact.name: fact.path for fact in submission.artifacts if fact.path is not None
        }
        self._used, self._reason = used, reason

    def filled(self, template: str) -> Iterator[str]:
        """Give the template with each combination of values for its names; nothing where one has none."""
        names = list(
            dict.fromkeys(name for _, name, _, _ in string.Formatter().parse(template) if name)
        )
        for values in itertools.product(*map(self._values, names)):
            yield template.format(**dict(zip(names, values, strict=True)))

    def _values(self, name: str) -> Sequence[str]:
        """Return what stands for a name.

        It is the command of the step that the parameter names, its value, or the values within others of that name: of
        several, those that the reason mentions.
        """
        value = self._own.get(name)
        if (step := self._steps.get(value) if isinstance(value, str) else None) is not None:
            return self._lines(step)
        if value is not None:
            return [
                shlex.quote(self._paths.get(value, value))
                if name in _FILES
                else self._quoted(value)
            ]
        all_of_them = list(dict.fromkeys(_within(self._own, name)))
        if steps := [self._steps[label] for label in all_of_them if label in self._steps]:
            return [line for step in steps for line in self._lines(step)]
        named = [
            v for v in all_of_them if v in self._reason or self._used.get(v, v) in self._reason
        ]
        return [self._quoted(v) for v in named or all_of_them]

    def _lines(self, step: StepSpec) -> list[str]:
        """Return what does the same as a step in a terminal."""
        inner = copy(self)
        inner._own = {
            k: json.dumps(v) if isinstance(v, Mapping) else v for k, v in step.parameters.items()
        }
        return [line for template in step.step.commands() for line in inner.filled(template)]

    def _quoted(self, value: Any) -> str:
        """Write a value as a word of a command, those of a mapping or a list as several."""
        if isinstance(value, (Mapping, list, tuple)):
            return " ".join(
                map(self._quoted, value.values() if isinstance(value, Mapping) else value)
            )
        return shlex.quote(self._used.get(str(value), str(value)))


def _within(value: Any, name: str) -> Iterator[str]:
    """Give the texts of a name, or of its plural, in parameters within parameters."""
    numbered = enumerate(value) if isinstance(value, (list, tuple)) else ()
    for key, inner in value.items() if isinstance(value, Mapping) else numbered:
        if key == name and isinstance(inner, str):
            yield inner
        elif key == f"{name}s" and not isinstance(inner, Mapping):
            yield from (text for text in inner if isinstance(text, str))
        yield from _within(inner, name)
