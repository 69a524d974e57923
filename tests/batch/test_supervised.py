"""A process that hangs, breaks or is killed costs its submission's place, for a time, and nothing else."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import tempfile
import uuid
from contextlib import suppress
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

sys.path.append(str(Path(__file__).parents[2]))

from grader.batch.admission import Admission, Use
from grader.batch.machine import Machine
from grader.batch.order import Ending, Order
from grader.batch.supervised import Limits, grade_in_process
from grader.errors import GraderError
from grader.intake import Handed
from grader.live.isolation import Level
from grader.live.probing import probe_isolation
from grader.pipeline import Options
from grader.result import Result, Score
from grader.rubrics import read_rubric
from tests.batch.small_class import SLEEPS, Family, SmallClass, make_class
from tests.live.small_lab import TALKER, command_of, leavings, until

pytestmark = pytest.mark.live


@dataclass
class Case:
    """A submission to be graded in a process of its own."""

    small: SmallClass
    order: Order
    admission: Admission
    family: Family
    temporary: Path
    phases: list[str] = field(default_factory=list)

    def ends(self, limits: Limits | None = None, kill_at: str = "") -> Ending:
        """Grade it, and check that nothing is left; `kill_at` is the phase from which on its process is killed."""
        phases = self.phases

        async def watch() -> None:
            while True:
                self.family.look()
                for pid, _ in self.family.members:
                    if kill_at in phases and "grader.batch.one" in command_of(pid):
                        with suppress(ProcessLookupError):
                            os.kill(pid, signal.SIGKILL)
                await asyncio.sleep(0.02)

        async def scenario() -> Ending:
            watching = asyncio.ensure_future(watch())
            ending = await grade_in_process(
                self.order, self.admission, 0, lambda phase: phases.append(phase.text), limits
            )
            watching.cancel()
            place = await asyncio.wait_for(self.admission.take(Use.CELL, 1, alone=True), 120)
            place.release()
            return ending

        ending = asyncio.run(scenario())
        assert self.family.members
        until(lambda: not self.family.left(), 30)
        assert leavings(self.temporary) == []
        return ending


@pytest.fixture
def case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Case:
    """Give a submission whose session waits for a minute."""
    isolation = probe_isolation(Path(sys.executable))
    if not isolation.level.at_least(Level.NO_CGROUP):
        pytest.skip(f"no cells here: {isolation.remedy}")
    small = make_class(tmp_path, {"ann": SLEEPS})
    monkeypatch.setattr(tempfile, "tempdir", str(small.temporary))
    monkeypatch.setenv("TMPDIR", str(small.temporary))
    options = Options(Path(sys.executable), seed=1)
    handed = Handed.of(small.submissions / "ann")
    order = Order(handed, small.results / "ann", read_rubric(small.rubric), options, isolation)
    admission = Admission(2, Machine(2, f"grade-test-{uuid.uuid4().hex}"))
    return Case(small, order, admission, Family(os.getpid()), small.temporary)


def test_a_submission_gets_its_points(case: Case) -> None:
    """A correct talker is graded, and its seed is the one that was ordered."""
    case.small.hand_in("ann", TALKER)
    ending = case.ends()
    assert isinstance(ending, Result)
    assert ending.score == Score(Decimal(1), Decimal(1), Decimal(0))
    assert case.small.result("ann")["provenance"]["sessions"]["only"]["seed"] == 1


def test_a_session_that_hangs_is_ended(case: Case) -> None:
    """A session whose process does not end it in time is killed with its submission's process."""
    spec = case.order.rubric.sessions["only"].model_copy(update={"timeout_s": 2.0})
    rubric = replace(case.order.rubric, sessions={"only": spec})
    # The supervisor is told less time than the session's own process gives itself.
    case.order = replace(case.order, rubric=rubric)
    ending = case.ends(Limits(cell_grace_s=-0.5))
    assert isinstance(ending, GraderError)
    assert ending.problem == "the session 'only' took longer than 1.5 s"


def test_reading_that_takes_too_long_is_ended(case: Case) -> None:
    """A submission that cannot be read in time costs one place until then."""
    ending = case.ends(Limits(work_s=0.05))
    assert isinstance(ending, GraderError)
    assert ending.problem == "reading the submission took longer than 0.05 s"


@pytest.mark.parametrize("phase", ["reading", "starting"])
def test_a_process_that_is_killed_is_told(case: Case, phase: str) -> None:
    """A process that the system kills, as for want of memory, becomes a problem with a remedy."""
    ending = case.ends(kill_at=phase)
    assert isinstance(ending, GraderError)
    assert "SIGKILL" in ending.problem
    assert "memory" in ending.remedy


def test_what_is_wrong_with_a_submission_is_told(case: Case) -> None:
    """A submission that is refused has the same words and status as alone."""
    case.order = replace(case.order, handed=Handed.of(case.small.folder / "nobody"))
    ending = case.ends()
    assert isinstance(ending, GraderError)
    assert (ending.problem, ending.exit_status) == ("there is no such submission", 3)


def test_results_that_cannot_be_written_are_told(case: Case) -> None:
    """Where a file stands in place of the results' folder, that is the problem."""
    case.small.results.write_text("in the way")
    ending = case.ends()
    assert isinstance(ending, GraderError)
    assert ending.exit_status == 70
    assert str(case.small.results) in ending.where


def test_a_submission_does_not_keep_the_others_from_the_machine(case: Case) -> None:
    """What stays undecided is recorded again alone, but once that took its time, beside the others."""
    # What it asks for is never seen; one recording is no proof of that, nor are two.
    case.small.hand_in("ann", TALKER.replace("rclpy.init()", "rclpy.init(domain_id=7)"))
    ending = case.ends(Limits(alone_s=1.0))
    assert isinstance(ending, Result)
    assert ending.score == Score(Decimal(0), Decimal(1), Decimal(0))
    assert [phase for phase in case.phases if phase.startswith("waits")][:2] == ["waits", "waits to run alone"]
    assert case.phases.count("waits to run alone") == 1
    assert case.phases.count("waits") == 2
