"""A class run: several submissions at a time; each complete result is kept, and reused while nothing changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from confine.isolation import Isolation, Level
from confine.scratch import scratch_prefix
from grader.classroom import audit, fingerprint
from grader.classroom.cluster import Cluster, cluster
from grader.classroom.job import Ending, Job, Row, problem_of
from grader.classroom.journal import UNJUDGED, Entry, Journal, recordings_sha256
from grader.classroom.progress import RunProgress
from grader.classroom.regrade import regrade_all
from grader.classroom.scheduler import Machine
from grader.classroom.worker import Here
from grader.cohort.entries import ClassEntry, entries_in
from grader.errors import GraderError, RecordingError
from grader.files import text_of
from grader.judging.attempts import undecided_sessions
from grader.lab.policy import SubmissionTime
from grader.lab.rubric import Rubric
from grader.live.process.waiting import side_by_side
from grader.live.session.runner import Progress, run_to_an_end
from grader.pipeline import Options, Scope, earlier_results
from grader.recording.submission import read_submission, write_submission
from grader.result import Result, load_result
from grader.result_folder import RECORDINGS, REPORT_FILE, RESULT_FILE
from grader.submission.extraction import SubmissionSource, open_submission
from grader.submission.submission_time import set_submission_time


@dataclass(frozen=True)
class _Task:
    """A submission, and the hashes of its result's sources."""

    source: SubmissionSource
    submission: str
    submission_time: SubmissionTime
    key: str
    policy: str


@dataclass
class ClassRun:
    """One run over the submissions of a class."""

    rubric: Rubric
    options: Options
    journal: Journal
    machine: Machine
    display: RunProgress
    #: Finished submissions, in the order of their endings.
    rows: list[Row] = field(default_factory=list)

    def grade(self, sources: Sequence[SubmissionSource], location: Isolation | str) -> None:
        """Grade all submissions without a valid result; a failure of one does not affect the others.

        The location is the confinement of students' code here, or the address of a Dask scheduler for other machines.
        Raises PlatformError if the scheduler cannot be reached; KeyboardInterrupt or SystemExit on a request to end,
        after all processes have ended and all results are kept.
        """
        engine = fingerprint.engine_sha256()
        recording = fingerprint.recording_sha256(self.rubric)
        options = fingerprint.options_sha256(self.options)
        common = fingerprint.sha256_of((engine, recording, options))
        lab = fingerprint.lab_sha256(self.rubric)
        if isinstance(location, Isolation):
            least = location.level
        else:
            least = Level.of(self.options.least_isolation)
        # All submissions are read, and judged if this is enough, before the first starts; no session is timed
        # meanwhile.
        tasks = [self._task(one, common, lab) for one in sources]
        kept: dict[_Task, Entry] = {}
        for task in tasks:
            entry = self._entry(task, least)
            if entry is not None:
                kept[task] = entry
        new = [task for task in tasks if task not in kept]
        if self.options.scope is Scope.UNDECIDED:
            self._note_left_out(new)
            new = []
        judged = self._judge(kept)
        undecided = self._undecided(judged)
        for task in (*new, *undecided):
            self.display.expect(task.source.name, self._work_s())
        for task, row in judged.items():
            if task not in undecided:
                self._end(row)
        run_to_an_end(self._record(new, undecided, location))

    def _work_s(self) -> float:
        """Return the time that the sessions of one submission typically take together."""
        sessions = self.rubric.sessions
        chosen = self.options.sessions or sessions
        return sum(sessions[name].typical_s for name in chosen if name in sessions)

    def _note_left_out(self, tasks: Sequence[_Task]) -> None:
        """Name the submissions without valid recordings, apart from submissions that were never graded."""
        graded = [task.source.name for task in tasks if self.journal.knows(task.source.name)]
        never = [task.source.name for task in tasks if task.source.name not in graded]
        if never:
            self.display.note(
                f"Not graded yet, and left out: {', '.join(never)}. Grade them without --undecided."
            )
        if graded:
            self.display.note(
                f"Graded before, and left out: {', '.join(graded)}. The submission, the lab's "
                "sessions or programs, the options or the version of grade have changed since, "
                "or it was graded by itself. Grade them without --undecided."
            )

    def _undecided(self, judged: Mapping[_Task, Row]) -> dict[_Task, Result]:
        """Return the results with undecided sessions that must be recorded once more."""
        found: dict[_Task, Result] = {}
        if self.options.scope is Scope.UNDECIDED:
            for task, row in judged.items():
                if isinstance(row.ending, Result) and self._is_undecided(row.ending):
                    found[task] = row.ending
        return found

    def _task(self, source: SubmissionSource, common: str, lab: str) -> _Task:
        submission, submission_time = "", source.submission_time
        # A problem with the submission is reported later, in its turn.
        with suppress(Exception), open_submission(source, prefix=scratch_prefix()) as intake:
            submission = fingerprint.submission_sha256(intake)
            submission_time = intake.source.submission_time
        policy = fingerprint.judging_sha256(self.options, source.name, repr(submission_time), lab)
        key = fingerprint.sha256_of((common, submission))
        return _Task(source, submission, submission_time, key, policy)

    def _entry(self, task: _Task, least: Level) -> Entry | None:
        """Return the journal's entry of valid recordings."""
        entry = None
        if task.submission:
            entry = self.journal.holds(task.source.name, task.key)
        enough = [level.value for level in Level if level.at_least(least)]
        if entry is not None and entry.isolation in enough:
            return entry
        return None

    def _is_undecided(self, result: Result) -> bool:
        return bool(undecided_sessions(result, list(self.rubric.sessions)))

    def _end(self, row: Row) -> None:
        self.rows.append(row)
        self.display.ended(row)

    # -- what was recorded before ----------------------------------------------------------------

    def _judge(self, kept: Mapping[_Task, Entry]) -> dict[_Task, Row]:
        """Reuse valid results, and judge recordings again if their rubric or policy has changed."""
        rows: dict[_Task, Row] = {}
        others: dict[str, _Task] = {}
        for task, entry in kept.items():
            self._state_intake(task)
            result = None
            if entry.policy == task.policy:
                result = self._result(task)
            if result is not None:
                rows[task] = Row(task.source, result, reused=True)
            else:
                others[task.source.name] = task
        results = self.journal.results
        measure = self.rubric, self.options.overrides
        found = regrade_all(results, {results / name: measure for name in others}, pages=True)
        found.apply("grade")
        for name, task in others.items():
            if name in found.judged:
                self.journal.note(name, task.key, task.policy, kept[task].isolation)
                rows[task] = Row(task.source, found.judged[name].result)
            else:
                rows[task] = Row(task.source, problem_of(found.failed[name]))
        return rows

    def _result(self, task: _Task) -> Result | None:
        """Return the complete result of a submission by this rubric, or None if there is none."""
        folder = self.journal.results / task.source.name
        with suppress(FileNotFoundError, RecordingError):
            result = load_result(folder / RESULT_FILE)
            whole = result.rubric_sha256 == self.rubric.sha256 and (folder / REPORT_FILE).is_file()
            return result if whole else None
        return None

    def _state_intake(self, task: _Task) -> None:
        """Write the known identity and time of submission into the recordings."""
        recordings = self.journal.results / task.source.name / RECORDINGS
        record, source = read_submission(recordings), task.source
        known = replace(record, student_id=source.student_id, identity=source.identity)
        set_submission_time(known, task.submission_time)
        if known != record:
            write_submission(recordings, known)

    # -- what is to be recorded ------------------------------------------------------------------

    async def _record(
        self, tasks: Sequence[_Task], undecided: Mapping[_Task, Result], location: Isolation | str
    ) -> None:
        async with AsyncExitStack() as stack:
            opened: Here | Cluster
            if isinstance(location, str):
                opened = await stack.enter_async_context(cluster(location, self.display.note))
                scope = Scope.ALL
            else:
                opened = stack.enter_context(Here(location, self.machine))
                # Undecided sessions are recorded again after the first recordings of all submissions.
                scope = Scope.ONCE
            every = (*tasks, *undecided)
            await side_by_side(
                self._finish(task, undecided.get(task), opened, scope) for task in every
            )

    async def _finish(
        self, task: _Task, earlier: Result | None, site: Here | Cluster, scope: Scope
    ) -> None:
        """Grade a submission, and record undecided sessions of its result, or of an earlier one, again."""
        if (left := earlier or await self._first(task, site, scope)) is not None:
            await self._again(task, left, site)

    async def _first(self, task: _Task, site: Here | Cluster, scope: Scope) -> Result | None:
        """Grade a submission; returns a result with undecided sessions that must be recorded again."""
        name = task.source.name
        try:
            ending = await self._grade(task, site, scope)
        except Exception as error:
            ending = self._abandoned(task, problem_of(error))
        if scope is Scope.ONCE and isinstance(ending, Result) and self._is_undecided(ending):
            waits = Progress("", "waits for the other submissions, to retry undecided checks")
            self.display.phase(name, waits)
            return ending
        self._end(Row(task.source, ending, took_s=self.display.took_s(name)))
        return None

    async def _again(self, task: _Task, earlier: Result, site: Here | Cluster) -> None:
        """Record undecided sessions of a result again; the result stays if this fails."""
        name = task.source.name
        try:
            ending = await self._grade(task, site, Scope.UNDECIDED)
        except Exception as error:
            ending = problem_of(error)
        if isinstance(ending, GraderError):
            self.display.note(f"{name}: not recorded again: {ending.problem}")
            ending = earlier
        self._end(Row(task.source, ending, took_s=self.display.took_s(name)))

    async def _grade(self, task: _Task, site: Here | Cluster, scope: Scope) -> Ending:
        name, decided_by, seed = task.source.name, self.options.overrides.sha256, self.options.seed
        if seed is None:
            seed = fingerprint.seed_for(task.submission, self.journal.run_seed)
        earlier = earlier_results(self.journal.results / name)
        options = replace(self.options, seed=seed, scope=scope, earlier=earlier)
        job = Job(task.source, self.journal.results / name, self.rubric, options)
        before, recorded = text_of(job.results / RESULT_FILE), recordings_sha256(job.results)
        ending, isolation = await site.grade(job, partial(self.display.phase, name))
        if not isinstance(ending, GraderError):
            audit.note_replaced(
                self.journal.results, name, before, "grade", overrides_sha256=decided_by
            )
            self.journal.note(name, task.key, task.policy, isolation.value)
            return ending
        if (
            recordings_sha256(job.results) in ("", recorded)
            or ending.exit_status == RecordingError.exit_status
        ):
            if scope is Scope.UNDECIDED:
                return ending
            return self._abandoned(task, ending)
        # The recordings could not be judged; the next run tries again.
        if before is not None:
            audit.keep(self.journal.results, name, before)
        self.journal.note(name, task.key, UNJUDGED, isolation.value)
        return ending

    def _abandoned(self, task: _Task, why: GraderError) -> GraderError:
        # A full disk, for example, is probably the reason itself.
        with suppress(OSError):
            self.journal.abandon(task.source.name, why)
        return why


def entries_of(results: Path, rows: Sequence[Row]) -> list[ClassEntry]:
    """Return an entry for each submission of the run, and for each other result in the folder."""
    entries = {entry.name: entry for entry in entries_in(results)}
    for row in rows:
        source = row.source
        name = source.name
        entry = entries.get(name, ClassEntry(name, None, "There are no results of it."))
        if isinstance(row.ending, GraderError):
            entry = ClassEntry(name, None, row.ending.problem)
        # The record has the facts of the archive.
        if source.submitted_at is not None:
            entry = replace(entry, submitted_at=source.submitted_at, time_source=source.time_source)
        student_id = source.student_id or entry.student_id
        identity = source.identity.completed(entry.identity)
        entries[name] = replace(entry, student_id=student_id, identity=identity)
    return sorted(entries.values(), key=lambda entry: entry.name)
