"""YAML that a student or a recording may have written is read in bounded time."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
import yaml

from grader import yaml_text
from grader.errors import RubricError
from grader.judging.rubrics import read_rubric
from grader.lab.kept_lab import lab_id
from grader.lab.yaml_with_lines import parse_yaml
from grader.submission.lms.systems import _scalar

DEPTH = 60
ALIASES = "a0: &a0 [x, x]\n" + "".join(
    f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]\n" for n in range(1, DEPTH)
)
MERGES = "a0: &a0 {x: 1}\n" + "".join(
    f"a{n}: &a{n} {{<<: [*a{n - 1}, *a{n - 1}], k{n}: 1}}\n" for n in range(1, DEPTH)
)
KEYS = "a0: &a0 [x, x]\n" + "".join(f"a{n}: &a{n} {{*a{n - 1}: *a{n - 1}}}\n" for n in range(1, 40))
ITSELF = "a: &a [*a]\n"
HOSTILE = {"aliases": ALIASES, "merges": MERGES, "keys": KEYS, "itself": ITSELF}


@pytest.mark.parametrize("name", HOSTILE)
def test_few_lines_for_very_many_values_are_refused(name: str, tmp_path: Path) -> None:
    """By every reader, at once, and with the reason."""
    began_s = time.process_time()
    with pytest.raises(yaml.YAMLError, match=r"aliases written out|contains itself"):
        yaml_text.load(HOSTILE[name])
    path = tmp_path / "rubric.yaml"
    path.write_text("lab: {id: x}\n" + HOSTILE[name])
    with pytest.raises(RubricError) as refused:
        parse_yaml(path, path.read_text(), "the rubric")
    assert any(
        "written out" in each or "contains itself" in each for each in refused.value.mistakes
    )
    with pytest.raises(RubricError):
        read_rubric(path)
    assert lab_id(path) == ""
    assert time.process_time() - began_s < 5


def test_aliases_that_people_write_are_read(tmp_path: Path) -> None:
    """A value that is named once and used again, and a mapping that is merged into another."""
    text = "a: &a {x: 1}\nb: {<<: *a, y: [*a, *a]}\n"
    expected = {"a": {"x": 1}, "b": {"x": 1, "y": [{"x": 1}, {"x": 1}]}}
    assert yaml_text.load(text) == expected
    assert parse_yaml(tmp_path / "x.yaml", text, "it")[0] == expected
    assert yaml_text.load("") is None


def test_deep_nesting_is_refused() -> None:
    """Brackets without end are no stack overflow."""
    for text in ("[" * 100_000, "{a: " * 100_000, "- " * 100_000):
        with pytest.raises(yaml.YAMLError):
            yaml_text.load(text)
        with pytest.raises(RubricError):
            parse_yaml(Path("rubric.yaml"), text, "the rubric")


def test_a_name_in_an_export_is_bounded() -> None:
    """Anything but a text in quotes stays as it is written."""
    hostile = "'a': [&a0 [x, x]" + "".join(f", &a{n} [*a{n - 1}, *a{n - 1}]" for n in range(1, 60))
    assert _scalar("'Anna'") == "Anna"
    assert _scalar(hostile + "]").startswith("'a': [")
