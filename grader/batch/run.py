"""A class: all submissions side by side, each result kept as soon as it is whole, and reused while nothing changes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Protocol

from grader.batch import audit, fingerprint
from grader.batch.admission import Admission
from grader.batch.cluster import cluster
from grader.batch.journal import Entry, Journal
from grader.batch.one import make_durable
from grader.batch.order import Ending, Order, Phase, Row, problem_of
from grader.batch.progress import RunProgress
from grader.batch.supervised import grade_in_process
from grader.errors import GraderError, RecordingError
from grader.intake import Handed, taken_in
from grader.live.cells import run_to_an_end
from grader.live.isolation import Isolation, Level
from grader.live.scratch import scratch_prefix
from grader.pipeline import Options
from grader.result import Result, load_result
from grader.result_folder import RECORDINGS, REPORT_FILE, RESULT_FILE
from grader.rubric import Rubric


class Site(Protocol):
    """Where submissions are graded: this machine, or others."""

    @property
    def least_isolation(self) -> Level:
        """The least level of confinement that what was graded before must have had to be reused."""

    async def grade(self, order: Order, number: int, on_phase: Callable[[Phase], None]) -> tuple[Ending, Level]:
        """Grade a submission, the `number`-th in the queue; returns how it ended, and how its code was confined."""


@dataclass(frozen=True)
class Here:
    """Grading on this machine."""

    admission: Admission
    isolation: Isolation

    @property
    def least_isolation(self) -> Level:
        """What this machine gives."""
        return self.isolation.level

    async def grade(self, order: Order, number: int, on_phase: Callable[[Phase], None]) -> tuple[Ending, Level]:
        """Grade a submission in a process of its own."""
        here = replace(order, isolation=self.isolation)
        return await grade_in_process(here, self.admission, number, on_phase), self.isolation.level


@dataclass(frozen=True)
class _Task:
    """A submission, and what its result depends on."""

    handed: Handed
    number: int
    submission: str
    submitted_at: str | None
    key: str
    policy: str


@dataclass
class ClassRun:
    """One run over the submissions of a class.

    Attributes
    ----------
    rows : list of Row
        What is known so far, in the order in which it came to be.
    """

    rubric: Rubric
    options: Options
    journal: Journal
    admission: Admission
    display: RunProgress
    rows: list[Row] = field(default_factory=list)

    def grade(self, handed: Sequence[Handed], where: Isolation | str) -> None:
        """Grade what has not been graded, here or on the machines of a scheduler; whatever becomes of one submission.

        Parameters
        ----------
        where : Isolation or str
            How students' code is confined here, or the address of a Dask scheduler for other machines.

        Raises
        ------
        PlatformError
            If the scheduler is not to be reached.
        KeyboardInterrupt, SystemExit
            When asked to end; all processes have ended then, and what is graded is kept.
        """
        run_to_an_end(self._elsewhere(handed, where) if isinstance(where, str) else self._here(handed, where))

    async def _here(self, handed: Sequence[Handed], isolation: Isolation) -> None:
        await self.run(handed, Here(self.admission, isolation))

    async def _elsewhere(self, handed: Sequence[Handed], scheduler: str) -> None:
        async with cluster(scheduler, Level.of(self.options.least_isolation)) as site:
            if not await site.workers():
                self.display.note("The scheduler has no workers yet; waiting for them.")
            watching = asyncio.ensure_future(site.watch())
            try:
                await self.run(handed, site)
            finally:
                watching.cancel()

    async def run(self, handed: Sequence[Handed], site: Site) -> None:
        """Grade what has not been graded; whatever becomes of one, the others are graded."""
        # All are read before the first is started, so that no session is timed meanwhile.
        tasks = await asyncio.to_thread(self._tasks, handed)
        running = [asyncio.ensure_future(self._one(task, site)) for task in self._without_kept(tasks, site)]
        try:
            await asyncio.gather(*running)
        finally:
            # The first that is cancelled ends `gather`; the others are still cleaning up.
            if running:
                await asyncio.wait(running)

    def _tasks(self, handed: Sequence[Handed]) -> list[_Task]:
        common = fingerprint.combined(
            fingerprint.engine_sha256(), fingerprint.lab_sha256(self.rubric), fingerprint.options_sha256(self.options)
        )
        return [self._task(number, one, common) for number, one in enumerate(handed)]

    def _task(self, number: int, handed: Handed, common: str) -> _Task:
        try:
            with taken_in(handed, prefix=scratch_prefix()) as intake:
                submission = fingerprint.submission_sha256(intake)
                submitted_at = intake.submitted_at.isoformat() if intake.submitted_at is not None else None
        except Exception:
            submission, submitted_at = "", None  # What is wrong with it will be said when it is its turn.
        policy = fingerprint.policy_sha256(self.options, handed.name, submitted_at)
        return _Task(handed, number, submission, submitted_at, fingerprint.combined(common, submission), policy)

    def _without_kept(self, tasks: Sequence[_Task], site: Site) -> list[_Task]:
        """Take over the results that hold good; returns the other submissions."""
        others = []
        for task in tasks:
            kept = self._kept(task, site)
            if kept is not None:
                self._end(Row(task.handed, kept, reused=True))
            else:
                others.append(task)
                self.display.expect(task.handed.name, self._work_s())
        return others

    def _kept(self, task: _Task, site: Site) -> Result | None:
        entry = self._entry(task, site)
        folder = self.journal.results / task.handed.name
        if entry is None or entry.policy != task.policy or not (folder / REPORT_FILE).is_file():
            return None
        return _result_in(folder, self.rubric)

    def _entry(self, task: _Task, site: Site) -> Entry | None:
        entry = self.journal.holds(task.handed.name, task.key) if task.submission else None
        enough = [level.value for level in Level if level.at_least(site.least_isolation)]
        return entry if entry is not None and entry.isolation in enough else None

    def _work_s(self) -> float:
        sessions = self.rubric.sessions
        return sum(sessions[s].typical_s for s in self.options.sessions or sessions if s in sessions)

    async def _one(self, task: _Task, site: Site) -> None:
        began_s: list[float] = []

        def on_phase(phase: Phase) -> None:
            began_s[:] = began_s or [asyncio.get_running_loop().time()]
            self.display.phase(task.handed.name, phase)

        try:
            ending = await self._grade(task, site, on_phase)
        except Exception as error:
            ending = problem_of(error)
            if self._entry(task, site) is None:
                self._abandoned(task, ending)
        took_s = asyncio.get_running_loop().time() - began_s[0] if began_s else 0.0
        self._end(Row(task.handed, ending, took_s=took_s))

    async def _grade(self, task: _Task, site: Site, on_phase: Callable[[Phase], None]) -> Ending:
        name, now = task.handed.name, datetime.now(timezone.utc)
        folder = self.journal.results / name
        before = audit.text_of(folder / RESULT_FILE)
        kept = self._entry(task, site) is not None
        if kept:
            order = replace(self._order(task, folder), submitted_at=task.submitted_at, judge_only=True)
            ending, isolation = await grade_in_process(order, self.admission, task.number, on_phase), Level.NONE
        else:
            order = self._order(task, self.journal.unfinished(name))
            ending, isolation = await site.grade(order, task.number, on_phase)
        if isinstance(ending, GraderError):
            return ending if kept else self._not_judged(task, order, isolation, ending)
        after = (order.results / RESULT_FILE).read_text(encoding="utf-8")
        occasion = audit.Occasion(now, "grade", self.options.overrides.sha256)
        audit.note_replaced(self.journal.results, name, before, after, occasion)
        if kept:
            self.journal.judged_again(name, task.policy)
        else:
            self.journal.finish(name, task.key, task.policy, isolation.value)
        return ending

    def _order(self, task: _Task, results: Path) -> Order:
        seed = self.options.seed
        if seed is None:
            seed = fingerprint.seed_for(task.submission, self.journal.run_seed)
        return Order(task.handed, results, self.rubric, replace(self.options, seed=seed))

    def _not_judged(self, task: _Task, order: Order, isolation: Level, why: GraderError) -> GraderError:
        """Keep what was recorded of a submission, unless that itself cannot be read."""
        if (order.results / RECORDINGS).is_dir() and why.exit_status != RecordingError.exit_status:
            with suppress(OSError, ValueError):
                make_durable(order.results)
                self.journal.keep_unjudged(task.handed.name, task.key, isolation.value)
                final = self.journal.results / task.handed.name
                why.remedy = why.remedy.replace(str(order.results), str(final))
                return why
        return self._abandoned(task, why)

    def _abandoned(self, task: _Task, why: GraderError) -> GraderError:
        with suppress(OSError):  # Such as a full disk, which is likely to be the reason itself.
            self.journal.abandon(task.handed.name, why)
        return why

    def _end(self, row: Row) -> None:
        self.rows.append(row)
        self.display.ended(row)


def _result_in(folder: Path, rubric: Rubric) -> Result | None:
    """Return a finished result by this rubric, or None if there is no such."""
    with suppress(FileNotFoundError, RecordingError):
        result = load_result(folder / RESULT_FILE)
        return result if result.rubric_sha256 == rubric.sha256 else None
    return None
