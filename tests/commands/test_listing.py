"""`grade checks`, `grade steps`, `grade figures`: every parameter, and examples that can be used as they are."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from grader.checks.registry import REGISTRY
from grader.cli import main
from grader.commands.listing import Entry, entries_of
from grader.judging.rubrics import rubric_kinds
from grader.lab.rubric import load_rubric
from grader.lab.steps import STEPS
from grader.report.figures.kinds import FIGURES

KNOWN: dict[str, Any] = {"checks": REGISTRY, "steps": STEPS, "figures": FIGURES}


CASES = [(command, entry) for command in KNOWN for entry in entries_of(command)]


@pytest.mark.parametrize("command", KNOWN)
def test_everything_is_listed_with_all_its_parameters(command: str) -> None:
    """Parameters are all listed with a description, nested ones too, under a rubric's names."""
    found = {entry.name: entry for entry in entries_of(command)}
    assert found.keys() == KNOWN[command].keys()
    for name, entry in found.items():
        if command != "checks":
            model = KNOWN[command][name]
        else:
            model = REGISTRY[name].parameters
        assert [p.name for p in entry.parameters] == [
            f.alias or key for key, f in model.model_fields.items()
        ]
        assert entry.description


def test_arguments_of_a_labs_own_checks_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    """`grade checks Submission` prints the signatures and docstrings of its public members, without their bodies."""
    assert main(["checks", "Submission", "Messages"]) == 0
    shown = capsys.readouterr().out
    assert "class Submission:" in shown
    assert "def path_of(self, artifact: str) -> str | None:" in shown
    assert "def numbers(self, path: str)" in shown
    assert "_inner" not in shown


@pytest.mark.parametrize(
    ("command", "entry"), CASES, ids=[f"{command} {entry.name}" for command, entry in CASES]
)
def test_each_example_can_be_used_as_it_is(command: str, entry: Entry) -> None:
    """Each example is a YAML list with one element, with values of the right types."""
    (plain,) = yaml.safe_load(entry.example)
    if command == "steps":
        assert list(plain) == [entry.name]
        STEPS[entry.name].model_validate(plain[entry.name])
        return
    kind = plain["check" if command == "checks" else "kind"]
    if command == "checks":
        models = rubric_kinds().checks
    else:
        models = rubric_kinds().figures
    assert kind == entry.name
    models[kind].model_validate(plain["with"])


def test_the_example_of_a_rate_fits_the_new_lab(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Names in the examples have the same meaning as in the lab made by `grade lab new`."""
    assert main(["lab", "new", str(tmp_path / "lab")]) == 0
    (example,) = (entry.example for entry in entries_of("checks") if entry.name == "topic_rate")
    rubric = tmp_path / "lab/rubric.yaml"
    text = rubric.read_text(encoding="utf-8").replace("points: 10\n", "points: 15\n")
    indented = "".join(f"      {line}\n" for line in example.splitlines())
    rubric.write_text(text + indented, encoding="utf-8")
    assert len(list(load_rubric(rubric, rubric_kinds()).checks())) == 3
    capsys.readouterr()


def test_programs_get_json(capsys: pytest.CaptureFixture[str]) -> None:
    """The JSON has all parts of the text: types in words, defaults, nested values, the example."""
    assert main(["checks", "--json", "topics_subscribed"]) == 0
    (found,) = json.loads(capsys.readouterr().out)
    topics = next(p for p in found["parameters"] if p["name"] == "topics")
    assert (topics["type"], topics["required"]) == ("list (mapping each)", True)
    assert {
        key: next(p for p in topics["parameters"] if p["name"] == "type")[key]
        for key in ("name", "type", "required")
    } == {"name": "type", "type": "text", "required": True}
    assert yaml.safe_load(found["example"])[0]["check"] == "topics_subscribed"


def test_people_get_text(capsys: pytest.CaptureFixture[str]) -> None:
    """The text has a word on each entry, and one entry with its example.

    A misspelt name is answered with the nearest one.
    """
    assert main(["steps"]) == 0
    output = capsys.readouterr().out
    assert "observe: Let the system run for a time" in output
    assert "duration_s: number, required." in output
    assert main(["figures", "rate"]) == 0
    assert "kind: rate" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["checks", "topic_rat"])
    assert "did you mean 'topic_rate'?" in capsys.readouterr().err
