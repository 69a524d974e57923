"""Fixtures graded side by side under the machine's admission rule, each compared with what it expects."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path

from grader.batch.admission import Admission
from grader.batch.expectations import Fixture, Verdict, compare
from grader.batch.order import Graded, NotGraded, Order
from grader.batch.supervised import Phase, grade_in_process
from grader.errors import RecordingError
from grader.intake import Handed
from grader.live.isolation import Isolation
from grader.pipeline import Options
from grader.result import load_result
from grader.result_folder import RESULT_FILE
from grader.rubric import Rubric


@dataclass(frozen=True)
class Trial:
    """What became of a fixture.

    Attributes
    ----------
    verdict : Verdict or None
        None where it was not graded.
    problem : NotGraded or None
        Why it was not graded.
    earned, possible : Decimal
        Points of what was judged.
    """

    fixture: Fixture
    verdict: Verdict | None
    problem: NotGraded | None = None
    earned: Decimal = Decimal(0)
    possible: Decimal = Decimal(0)
    took_s: float = 0.0

    @property
    def as_expected(self) -> bool:
        """Whether the fixture got the verdict that it must get."""
        return self.verdict is not None and not self.verdict.differences


@dataclass(frozen=True)
class Trials:
    """Fixtures to be graded on this machine.

    Attributes
    ----------
    folder : Path
        Where submissions are laid out and results go.
    on_phase : callable
        Called with a fixture's name and what is being done with it.
    on_trial : callable
        Called with each trial when it has ended.
    """

    rubric: Rubric
    options: Options
    admission: Admission
    isolation: Isolation
    folder: Path
    on_phase: Callable[[str, Phase], None]
    on_trial: Callable[[Trial], None]

    async def run(self, fixtures: Sequence[Fixture]) -> list[Trial]:
        """Grade the fixtures; whatever becomes of one, the others are graded."""
        running = [asyncio.ensure_future(self._one(number, fixture)) for number, fixture in enumerate(fixtures)]
        try:
            return await asyncio.gather(*running)
        finally:
            # The first that is cancelled ends `gather`; the others are still cleaning up.
            if running:
                await asyncio.wait(running)

    async def _one(self, number: int, fixture: Fixture) -> Trial:
        began_s: list[float] = []

        def on_phase(phase: Phase) -> None:
            began_s[:] = began_s or [time.monotonic()]
            self.on_phase(fixture.name, phase)

        unfit = fixture.expectation.unfit(self.rubric)
        if unfit:
            trial = Trial(fixture, Verdict(tuple(unfit), undecided=False))
        else:
            trial = await self._graded(number, fixture, on_phase)
        trial = replace(trial, took_s=time.monotonic() - began_s[0] if began_s else 0.0)
        self.on_trial(trial)
        return trial

    async def _graded(self, number: int, fixture: Fixture, on_phase: Callable[[Phase], None]) -> Trial:
        try:
            submission = fixture.lay_out(self.folder / "submissions")
        except OSError as error:
            return Trial(fixture, None, NotGraded.from_error(error))
        results = self.folder / fixture.name
        options = replace(self.options, sessions=list(fixture.expectation.sessions))
        order = Order(Handed.of(submission), results, self.rubric, options, self.isolation)
        ending = await grade_in_process(order, self.admission, number, on_phase)
        if isinstance(ending, NotGraded):
            return Trial(fixture, None, ending)
        return self._compared(fixture, results, ending)

    def _compared(self, fixture: Fixture, results: Path, graded: Graded) -> Trial:
        try:
            result = load_result(results / RESULT_FILE)
        except (OSError, RecordingError):
            return Trial(fixture, None, NotGraded("its result cannot be read", where=str(results)))
        verdict = compare(fixture.expectation, result, self.rubric)
        return Trial(fixture, verdict, None, graded.earned, graded.possible)


def quick(fixtures: Sequence[Fixture], rubric: Rubric) -> list[Fixture]:
    """Choose fixtures that say much in little time.

    These are all that state their total or need no session, and for each criterion the first one of one session
    that loses points there.
    """
    chosen = [f for f in fixtures if not f.expectation.sessions or f.expectation.total is not None]
    for criterion in rubric.criteria:
        losing = (f for f in fixtures if len(f.expectation.sessions) == 1 and f.expectation.loses_in(criterion.id))
        first = next(losing, None)
        chosen += [first] if first is not None and first not in chosen else []
    return sorted(chosen, key=list(fixtures).index)
