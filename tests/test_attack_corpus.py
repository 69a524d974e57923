"""The attack corpus itself: every attack can be laid out, and states its expected result."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT))

from grader.judging import rubrics  # noqa: E402
from grader.lab.rubric import Rubric  # noqa: E402
from tests.live.attacks import HONEST, SOLUTION, Attack, read_corpus  # noqa: E402

PARTS = {"results", "processes", "network", "ros", "intake", "report"}
LEAST_ATTACKS = 55
LIMITS = {"memory", "processes", "disk", "files", "output", "recording", "computing", "time"}


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return rubrics.read_rubric(None)


def test_all_parts_are_attacked() -> None:
    """The corpus has attacks on each part of the grader, and not few."""
    corpus = read_corpus()
    assert len(corpus) >= LEAST_ATTACKS
    assert {attack.part for attack in corpus} == PARTS


@pytest.mark.parametrize("attack", read_corpus(), ids=lambda attack: attack.name)
def test_an_attack_is_reported_so_that_it_can_be_judged(attack: Attack, rubric: Rubric) -> None:
    """Named sessions and checks exist, the points are possible, and the attack describes itself."""
    assert len(attack.about) > 40
    assert set(attack.sessions) <= set(rubric.sessions)
    judged = {c.id for c in rubric.checks() if c.session in attack.sessions}
    assert set(attack.expect.checks) <= judged
    assert attack.expect.all in (None, "passed", "failed")
    assert set((attack.expect.limit or "").split(" or ")) <= {"", *LIMITS}
    assert 0 < attack.most_points(rubric) <= 100


@pytest.mark.parametrize("attack", read_corpus(), ids=lambda attack: attack.name)
def test_the_files_of_an_attack_exist(attack: Attack) -> None:
    """The twin and all files exist; an archive is made by a program."""
    assert attack.twin == SOLUTION or (ROOT / "fixtures" / attack.twin / "expected.yaml").is_file()
    assert all((ROOT / folder).is_dir() for folder in attack.files_of)
    is_made = (attack.folder / "make.py").is_file()
    is_handed_in = (attack.folder / "submission").is_dir()
    assert is_made or is_handed_in or attack.named
    assert is_made or attack.archive is None


@pytest.mark.parametrize("attack", read_corpus(), ids=lambda attack: attack.name)
def test_an_attacks_own_python_is_python(attack: Attack) -> None:
    """An attack that fails for a slip of the pen attacks nothing; it finds the honest file that it builds on."""
    own = sorted((attack.folder / "submission").rglob("*.py"))
    for path in own:
        text = path.read_text(encoding="utf-8")
        compile(text, path.name, "exec")
        if f"{HONEST}{path.stem}" in text:
            assert any((ROOT / folder / path.name).is_file() for folder in attack.files_of)
