"""Annotations: each line is one command as the runner reads it, ten of a kind, the costliest first."""

from __future__ import annotations

import re

from hypothesis import HealthCheck, given, settings

from tests.report.exports.sample_results import (
    check,
    criterion,
    every_outcome,
    exported,
    hostile_results,
    result,
)
from tests.report.runner_commands import Command, bracket_command, colon_command


def commands_of(text: str) -> list[Command]:
    """Read all commands; every line must be one."""
    commands = [colon_command(line) for line in text.splitlines()]
    assert None not in commands
    return [command for command in commands if command is not None]


def test_outcomes_are_kinds_on_lines_of_files() -> None:
    """Failed is an error, partial a warning, unreached or undecided a notice; passed has none."""
    commands = commands_of(exported("github-annotations", every_outcome(), path_prefix="ann"))
    assert [(c.name, c.properties.get("file"), c.properties.get("line")) for c in commands] == [
        ("error", None, None),
        ("warning", "ann/a.partial.py", "3"),
        ("notice", None, None),
        ("notice", "ann/b.open.py", "3"),
        ("notice", "ann/b.broken.py", "3"),
    ]
    assert commands[0].properties["title"] == "Title of b.failed (failed, −3 points)"
    assert commands[3].properties["title"] == "Title of b.open (undecided, costs nothing)"
    assert "Undecided, 3 points are not earned before somebody has decided." in commands[3].data
    assert commands[1].data.splitlines()[:3] == [
        "Reason of a.partial.",
        "Expected: 100 Hz",
        "Measured: 90 Hz",
    ]


def test_ten_of_a_kind_the_costliest_first() -> None:
    """The costliest ten annotations of a kind come first, and the rest is counted.

    GitHub drops more than ten of a kind.
    """
    checks = [check(f"a.{n}", "failed", 0, n + 1) for n in range(13)]
    checks += [check(f"b.{n}", "partial", 1, n + 2) for n in range(11)]
    lines = exported("github-annotations", result(criterion("a", *checks))).splitlines()
    errors = [line for line in lines if line.startswith("::error ")]
    assert len(errors) == 10
    assert [re.findall(r"−(\d+) points", line)[0] for line in errors] == [
        str(n) for n in range(13, 3, -1)
    ]
    assert len([line for line in lines if line.startswith("::warning ")]) == 10
    rest = [line for line in lines if not line.startswith("::")]
    assert rest == [
        "(3 more of the kind error are in the report.)",
        "(1 more of the kind warning are in the report.)",
    ]


def require_harmless(command: Command) -> None:
    """Fail unless a command has the export's properties alone, within GitHub's limits."""
    assert set(command.properties) <= {"file", "line", "title"}
    assert command.properties.get("line", "1").isdecimal()
    assert ".." not in command.properties.get("file", "").split("/")
    assert len(command.properties["title"]) <= 255
    assert len(command.data.encode()) < 64 * 1024
    assert bracket_command(command.data) is None


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(hostile_results())
def test_hostile_texts_issue_no_command(plain: dict[str, object]) -> None:
    """The same commands as with harmless texts come out, with our properties alone, within GitHub's limits."""
    text = exported("github-annotations", plain)
    commands = commands_of(text)
    assert len(commands) == len(text.splitlines()) == 4
    assert [command.name for command in commands] == ["error", "notice", "notice", "notice"]
    for command in commands:
        require_harmless(command)
    for line in text.splitlines():
        assert colon_command(line) is not None or bracket_command(line) is None
