"""A process that hangs, breaks or is killed costs its submission's place, for a time, and nothing else."""

from __future__ import annotations

import asyncio
import base64
import os
import pickle
import re
import signal
import sys
import tempfile
import uuid
from contextlib import suppress
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("rclpy")

sys.path.append(str(Path(__file__).parents[2]))

from confine.isolation import Level
from grader.classroom.job import Ending, Job
from grader.classroom.scheduler import Machine
from grader.classroom.worker import Workers, grade_in_process
from grader.errors import GraderError
from grader.judging.rubrics import read_rubric
from grader.live.sandbox.probing import probe_isolation
from grader.pipeline import Options
from grader.result import Result, Score
from grader.submission.extraction import SubmissionSource
from tests.classroom.small_class import SLEEPS, Family, SmallClass, make_class
from tests.live.small_lab import TALKER, name_of, remains, until
from tests.thorough import EVERY_ATTACK, part

pytestmark = pytest.mark.live


@dataclass
class Case:
    """A submission to be graded in a process of its own."""

    small: SmallClass
    job: Job
    family: Family
    temporary: Path
    phases: list[str] = field(default_factory=list)

    def ends(self, kill_at: str = "", after_another: bool = False, **limits: Any) -> Ending:
        """Grade the submission, and check for leftovers; `kill_at` is the phase to kill it from.

        After another submission, the process that forks has imported the needed modules.
        """
        phases = self.phases

        async def watch() -> None:
            while True:
                self.family.look()
                for pid, _ in self.family.members:
                    if kill_at in phases and name_of(pid) == "worker":
                        with suppress(ProcessLookupError):
                            os.kill(pid, signal.SIGKILL)
                await asyncio.sleep(0.02)

        async def scenario() -> Ending:
            watching = asyncio.ensure_future(watch())
            job = replace(self.job, **limits)
            with Workers() as workers:
                if after_another:
                    nobody = SubmissionSource.of(self.small.folder / "nobody")
                    await grade_in_process(
                        replace(job, source=nobody, silence_s=300.0), workers, lambda _: None
                    )
                ending = await grade_in_process(
                    job, workers, lambda phase: phases.append(phase.text)
                )
            watching.cancel()
            assert job.machine is not None
            (await asyncio.wait_for(job.machine.take(1), 120))()
            return ending

        ending = asyncio.run(scenario())
        assert self.family.members
        until(lambda: not self.family.left(), 30)
        assert remains(self.temporary) == []
        return ending


@pytest.fixture
def case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Case:
    """Give a submission with a session that waits for a minute."""
    isolation = probe_isolation(Path(sys.executable))
    if not isolation.level.at_least(Level.NO_CGROUP):
        pytest.skip(f"no sandboxes here: {isolation.remedy}")
    small = make_class(tmp_path, {"ann": SLEEPS})
    monkeypatch.setattr(tempfile, "tempdir", str(small.temporary))
    monkeypatch.setenv("TMPDIR", str(small.temporary))
    options = Options(Path(sys.executable), seed=1)
    source = SubmissionSource.of(small.submissions / "ann")
    machine = Machine(2, f"grade-test-{uuid.uuid4().hex}")
    job = Job(source, small.results / "ann", read_rubric(small.rubric), options, isolation, machine)
    return Case(small, job, Family(os.getpid()), small.temporary)


def test_a_submission_gets_its_points(case: Case) -> None:
    """A correct talker is graded, and its seed is the one that was asked for."""
    case.small.hand_in("ann", TALKER)
    ending = case.ends()
    assert isinstance(ending, Result)
    assert ending.score == Score(Decimal(1), Decimal(1), Decimal(0))
    assert case.small.result("ann")["provenance"]["sessions"]["only"]["seed"] == 1


@pytest.mark.parametrize(("silence_s", "phase"), [(15.0, "waiting for"), (0.05, "reading")])
def test_a_process_that_says_nothing_is_ended(case: Case, silence_s: float, phase: str) -> None:
    """One that hangs, be it in a session or as it starts, costs its places until then."""
    ending = case.ends(
        after_another=phase != "reading",
        silence_s=silence_s - case.job.rubric.sessions["only"].timeout_s,
    )
    assert isinstance(ending, GraderError)
    assert ending.problem == f"the grader's process reported nothing for {silence_s:g} s"
    assert case.phases == [] if phase == "reading" else phase in case.phases[-1]


@pytest.mark.parametrize("phase", ["reading", "starting"])
def test_a_process_that_is_killed_is_reported(case: Case, phase: str) -> None:
    """A process that the system kills, as for want of memory, becomes a problem with a remedy."""
    ending = case.ends(kill_at=phase)
    assert isinstance(ending, GraderError)
    assert "SIGKILL" in ending.problem
    assert "memory" in ending.remedy


def test_what_is_wrong_with_a_submission_is_reported(case: Case) -> None:
    """A submission that is refused has the same words and status as alone."""
    case.job = replace(case.job, source=SubmissionSource.of(case.small.folder / "nobody"))
    ending = case.ends()
    assert isinstance(ending, GraderError)
    assert (ending.problem, ending.exit_status) == ("there is no such submission", 3)


def test_results_that_cannot_be_written_are_reported(case: Case) -> None:
    """Where a file stands in place of the results' folder, that is the problem."""
    case.small.results.write_text("in the way")
    ending = case.ends()
    assert isinstance(ending, GraderError)
    assert ending.exit_status == 70
    assert str(case.small.results) in ending.location


#: Starts rclpy in another domain, past the tap, which keeps programs in the session's.
ELSEWHERE = (
    "rclpy.get_default_context().init.__wrapped__(rclpy.get_default_context(), **{'domain_id': 7})"
)


BESIDE_FEW = "waits to run beside few others, to retry undecided checks"
ALONE = "waits to run alone, to retry undecided checks"


@pytest.mark.parametrize(
    ("alone_s", "third"),
    part([(60.0, ALONE), (0.0, BESIDE_FEW)], 2, EVERY_ATTACK),
)
def test_what_stays_undecided_is_recorded_in_an_ever_calmer_machine(
    case: Case, alone_s: float, third: str
) -> None:
    """Again beside few others, then alone, but not once that took its time: the others wait for it."""
    # Its publisher is never seen, and no cause of that either; neither one recording nor two are proof of that.
    case.small.hand_in("ann", TALKER.replace("rclpy.init()", ELSEWHERE))
    text = case.small.rubric.read_text(encoding="utf-8")
    patient = re.compile(r"(timeout_s\W+)[26]0\b")
    assert len(patient.findall(text)) == 2
    case.small.rubric.write_text(patient.sub(r"\g<1>4", text), encoding="utf-8")
    case.job = replace(case.job, rubric=read_rubric(case.small.rubric))
    ending = case.ends(alone_s=alone_s)
    assert isinstance(ending, Result)
    # The machine, busy with other tests, decides if the last recording does.
    assert (ending.score.earned, ending.score.possible) == (Decimal(0), Decimal(1))
    waits = dict.fromkeys(phase for phase in case.phases if phase.startswith("waits"))
    assert list(waits) == list(dict.fromkeys(["waits for a free slot", BESIDE_FEW, third]))


class Harmful:
    """Makes a folder when it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the call that unpickling makes."""
        return os.mkdir, (str(self.folder),)


def test_what_a_labs_own_check_prints_is_no_message(case: Case) -> None:
    """Processes speak to the class in pickled lines: a student's line that a check prints must not be one."""
    case.small.hand_in("ann", TALKER)
    line = base64.b64encode(pickle.dumps(Harmful(case.small.folder / "harmed"))).decode()
    (case.small.submissions / "ann" / "notes.txt").write_text(f"{line}\n", encoding="utf-8")
    check = """
def quotes(submission: Submission) -> Finding:
    print(submission.text("notes.txt"), flush=True)
    return passed("", "")
"""
    (case.small.rubric.parent / "own.py").write_text(
        f"from grader.own_checks import Finding, Submission, passed\n{check}", encoding="utf-8"
    )
    plain = yaml.safe_load(case.small.rubric.read_text(encoding="utf-8"))
    plain["criteria"][0]["checks"].append({"id": "quotes", "points": 1, "check": "own.py:quotes"})
    plain["criteria"][0]["points"] = plain["lab"]["points"] = 2
    case.small.rubric.write_text(yaml.safe_dump(plain), encoding="utf-8")
    case.job = replace(case.job, rubric=read_rubric(case.small.rubric))
    ending = case.ends()
    assert not (case.small.folder / "harmed").exists()
    assert isinstance(ending, Result)
    assert ending.score.earned == 2
