"""A recording damaged afterwards: nobody loses a point for unreadable messages."""

from __future__ import annotations

import functools
import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from grader.judging import rubrics
from grader.judging.judge import judge, open_recordings
from grader.lab.rubric import Rubric
from grader.result import CheckResult, Outcome, Result
from ros_bag.reading import Bag
from tests.thorough import examples

pytestmark = pytest.mark.slow

KEPT = Path(__file__).resolve().parents[1] / "recordings"
LOST = (Outcome.FAILED, Outcome.NOT_REACHED, Outcome.PARTIAL, Outcome.ERROR)


@functools.lru_cache(maxsize=1)
def _whole() -> Result:
    return judge(open_recordings(KEPT / "solution", _rubric()), _rubric())


@functools.lru_cache(maxsize=1)
def _rubric() -> Rubric:
    return rubrics.read_rubric(None)


def checks_of(result: Result) -> dict[str, CheckResult]:
    """Return the results of all checks by their ids."""
    found = {}
    for criterion in result.criteria:
        for check in criterion.checks:
            found[check.id] = check
    return found


def damaged(folder: Path, session: str, content: bytes) -> Result:
    """Judge the solution with another content of one session's bag."""
    copy = folder / "recordings"
    shutil.copytree(KEPT / "solution", copy)
    (copy / session / f"{session}.mcap").write_bytes(content)
    return judge(open_recordings(copy, _rubric()), _rubric())


def content_of(session: str) -> bytes:
    """Return the bag of one of the solution's sessions."""
    return (KEPT / "solution" / session / f"{session}.mcap").read_bytes()


def _flip(data: bytearray, place: int, length: int) -> None:
    data[place] ^= 1 << length % 8


def _zero(data: bytearray, place: int, length: int) -> None:
    data[place : place + length] = bytes(len(data[place : place + length]))


def _drop(data: bytearray, place: int, length: int) -> None:
    del data[place : place + length]


def _double(data: bytearray, place: int, length: int) -> None:
    data[place:place] = data[place : place + length]


def _cut(data: bytearray, place: int, length: int) -> None:
    del data[place:]


DAMAGES = {"flip": _flip, "zero": _zero, "drop": _drop, "double": _double, "cut": _cut}
SESSIONS = ("publisher", "subscriber", "service", "launch", "qos")


# Judging takes long, so that no smaller example is sought.
@settings(max_examples=examples(40), deadline=None, phases=(Phase.explicit, Phase.generate))
@example("publisher", "flip", 0.3, 1)
@example("subscriber", "cut", 0.0, 1)
@example("launch", "zero", 0.4, 100)
@example("service", "drop", 0.5, 1000)
@given(
    st.sampled_from(SESSIONS),
    st.sampled_from(sorted(DAMAGES)),
    st.floats(0, 1, exclude_max=True),
    st.integers(1, 5000),
)
def test_no_damage_costs_a_point(session: str, damage: str, place: float, length: int) -> None:
    """Whatever is done to a bag, no check that passes fails; and nobody is said to have tampered with it."""
    data = bytearray(content_of(session))
    DAMAGES[damage](data, int(place * len(data)), length)
    with tempfile.TemporaryDirectory() as folder:
        result = damaged(Path(folder), session, bytes(data))
    before, after = checks_of(_whole()), checks_of(result)
    lost = []
    for name, check in after.items():
        if before[name].outcome is Outcome.PASSED and check.outcome in LOST:
            lost.append(name)
    assert lost == []
    assert result.violations == ()


def test_a_chunk_that_fails_its_checksum_is_named() -> None:
    """The report names the damage, and the number of unreadable messages of each topic."""
    with tempfile.TemporaryDirectory() as folder:
        data = bytearray(content_of("publisher"))
        data[len(data) // 3] ^= 1
        result = damaged(Path(folder), "publisher", bytes(data))
        bag = Bag.open(Path(folder) / "recordings" / "publisher")
    whole = Bag.open(KEPT / "solution" / "publisher")
    assert bag.finished
    assert 0 < len(bag.stream("/joint_commands")) < len(whole.stream("/joint_commands"))
    assert any("messages on /joint_commands cannot be read" in words for words in bag.damage)
    assert any(
        "does not match its checksum" in words or "decompress" in words for words in bag.damage
    )
    undecided = [check for check in checks_of(result).values() if "bag is damaged" in check.reason]
    assert undecided
    assert {check.outcome for check in undecided} == {Outcome.INCONCLUSIVE}


@pytest.mark.parametrize("name", sorted(path.name for path in KEPT.iterdir()))
def test_kept_bags_are_whole(name: str) -> None:
    """The kept bags show no damage."""
    for file in sorted((KEPT / name).glob("*/*.mcap")):
        bag = Bag.open(file.parent)
        assert (bag.finished, bag.damage) == (True, ())
