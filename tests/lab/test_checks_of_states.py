"""Misspellings in a rubric of lifecycles, parameters, answers and frames, found when it loads."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from grader.errors import RubricError
from grader.judging.rubrics import read_rubric

LABS = Path(__file__).parents[1] / "labs"


@pytest.mark.parametrize(
    ("right", "wrong", "words"),
    [
        (
            "{plan.header.frame_id: map}",
            "{plan.header.frame: map}",
            "has no field 'frame'; did you mean 'frame_id'?",
        ),
        ("{plan.header.frame_id: map}", "{plan.poses.header: map}", "has no field 'header'"),
        ("step: configure, state", "step: configur, state", "no step labelled 'configur'"),
        (
            "step: configure, state",
            "step: faster, state",
            "of kind set_parameters; change_state is needed",
        ),
        ("state: finalized", "state: finalised", "'finalized'"),
        ("transition: cleanup", "transition: clean_up", "'cleanup'"),
        (
            "set_step: faster, before: slow, after: fast, topic",
            "set_step: faster, before: slow, after: fst, topic",
            "'fst'",
        ),
        ("with: {step: invalid}", "with: {step: ahead}", "set_parameters is needed"),
        ("with: {step: invalid}", "with: {step: faster}", "'faster' lacks refusal_expected: true"),
        ("text: data", "text: dat", "has no field 'dat'"),
        ("oracles.py:straight_line", "oracles.py:straight_lin", "'straight_line'"),
    ],
)
def test_a_mistake_is_reported(tmp_path: Path, right: str, wrong: str, words: str) -> None:
    """A mistake is reported with the nearest right name, if one is near."""
    lab = shutil.copytree(LABS / "lifecycle_talker", tmp_path / "lab")
    text = (lab / "rubric.yaml").read_text(encoding="utf-8")
    assert right in text
    (lab / "rubric.yaml").write_text(text.replace(right, wrong), encoding="utf-8")
    with pytest.raises(RubricError) as found:
        read_rubric(lab / "rubric.yaml")
    (mistake,) = found.value.mistakes
    assert words in mistake
