"""Grades a submission: `Grading` records and judges it, a method a stage; `grade` reads it and writes the results."""

from __future__ import annotations

import random
import shutil
import tempfile
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial
from pathlib import Path

from confine.isolation import Isolation, Level
from confine.scratch import scratch_prefix
from grader.bounded import Bound
from grader.errors import UsageError, described
from grader.evidence.environment_gap import modules_to_look_for
from grader.files import atomic_replacement, replace_files, text_of
from grader.judging.attempts import retry_undecided
from grader.judging.judgement import Judgement, judge_bounded, load
from grader.judging.result_files import files_of
from grader.judging.rubrics import rubric_files
from grader.lab import kept_lab
from grader.lab.overrides import Overrides
from grader.lab.rubric import Rubric
from grader.lab.similar_words import meant
from grader.live.builds.build import build_packages, can_build
from grader.live.interfaces.build import parts_in
from grader.live.interfaces.needs import Needed, needed_interfaces, provide_interfaces
from grader.live.sandbox.environment import (
    NativeLaunch,
    absent_modules,
    find_native_launch,
    require_platform,
    versions,
)
from grader.live.sandbox.installation import Installation, wheels_of
from grader.live.sandbox.probing import require
from grader.live.session.built import note_installed
from grader.live.session.program import StudentProgram
from grader.live.session.runner import Progress, SessionRunner, likely_used
from grader.live.session.scheduler import LocalScheduler, Scheduler
from grader.live.session.stage import stage
from grader.live_exports import LiveExports
from grader.recording.session import STUDENTS_ROS
from grader.recording.submission import SubmissionRecord, write_submission
from grader.report.exports.writing import ExportTarget
from grader.result import Result, result_of_text
from grader.result_folder import (
    EARLIER_FILE,
    RECORDINGS,
    REPORT_FILE,
    RESULT_FILE,
    RUBRIC_COPY,
)
from grader.submission.artifacts import read_submission
from grader.submission.extraction import Intake, SubmissionSource, in_bounds, open_submission
from grader.timings import Stopwatch

#: Files and folders that a grading makes. The last one marks the grading as complete.
PARTS = (RUBRIC_COPY, kept_lab.KEPT, RECORDINGS, REPORT_FILE, RESULT_FILE)
#: Marks recordings as incomplete until all sessions have been recorded.
_BEGUN = ".begun"
#: Time in s after which sessions have started, and leave a core some time.
_LOADED_AFTER_S = 3.0
#: Limits of each step of reading and staging a submission. The solution takes 0.02 s.
_READING_BOUND = Bound(
    what="reading the submission", cpu_s=20.0, wall_s=100.0, memory_bytes=1024**3
)

#: Function called with each change of a session's progress.
Listener = Callable[[Progress], None]


class Scope(Enum):
    """Chosen sessions that a grading records."""

    #: All; then again those with undecided checks.
    ALL = "all"
    #: All, once.
    ONCE = "once"
    #: Sessions with undecided checks in the recordings of an earlier grading. The other recordings stay.
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Options:
    """Choices of the user; by default all sessions, a new seed, and as many at a time as the cores allow."""

    #: Python that runs students' code.
    interpreter: Path
    sessions: Sequence[str] | None = None
    scope: Scope = Scope.ALL
    #: Seed of the stimuli.
    seed: int | None = None
    #: Sessions side by side.
    jobs: int | None = None
    #: Evaluator of launch files, see `find_native_launch`; None for "auto" with an installation, and else the stand-in.
    launch: str | None = None
    #: Installation of ROS of students' programs; None for the wheels of the interpreter.
    ros: Installation | None = None
    #: Level of confinement below which nothing is run, see `Level`.
    least_isolation: str = "reduced"
    #: Decisions of people about single submissions.
    overrides: Overrides = field(default_factory=Overrides)
    #: Exports for other systems, written again after each session.
    exports: Sequence[ExportTarget] = ()
    #: Folder of the submission in its repository.
    path_prefix: str = ""
    #: Texts of the earlier results, see `earlier_results`; None for those in the folder of results.
    earlier: tuple[str, ...] | None = None

    @property
    def evaluator(self) -> str:
        """Evaluator of launch files."""
        if self.launch is not None:
            return self.launch
        if self.ros is None:
            return "standin"
        return "auto"

    @property
    def installation(self) -> Installation:
        """Installation of ROS for students' programs."""
        if self.ros is None:
            return wheels_of(self.interpreter)
        return self.ros

    def sessions_of(self, rubric: Rubric) -> list[str]:
        """Return the names of the chosen sessions, in order."""
        return list(rubric.sessions if self.sessions is None else self.sessions)


def earlier_results(results: Path) -> tuple[str, ...]:
    """Return the texts of a submission's result, and of the result of the previous submission, if they exist."""
    files = (results / RESULT_FILE, results / RECORDINGS / EARLIER_FILE)
    return tuple(text for text in map(text_of, files) if text is not None)


def result_before(texts: Sequence[str], sha256: str) -> str | None:
    """Return the first text of a result that belongs to another submission than the one with this hash."""
    for text in texts:
        result = result_of_text(text)
        if result is None:
            continue
        if result.provenance.get("submission_sha256") not in (None, sha256):
            return text
    return None


def require_sessions(names: Sequence[str], rubric: Rubric) -> None:
    """Raise UsageError unless the rubric has all of these sessions."""
    for name in names:
        if name not in rubric.sessions:
            remedy = f"Sessions of this rubric are {', '.join(rubric.sessions)}."
            near = meant(name, list(rubric.sessions))
            raise UsageError(f"there is no session {name!r}{near}", remedy=remedy)


def chosen_sessions(rubric: Rubric, options: Options, submission: SubmissionRecord) -> list[str]:
    """Return the chosen sessions with a submitted first file; raises UsageError for unknown sessions."""
    require_sessions(options.sessions or (), rubric)
    submitted = {artifact.name for artifact in submission.artifacts if artifact.path is not None}
    chosen = []
    for name in options.sessions_of(rubric):
        first = rubric.sessions[name].needs[:1]
        if submitted.issuperset(first):
            chosen.append(name)
    return chosen


def grade(
    source: SubmissionSource | Path | Intake,
    rubric: Rubric,
    results: Path,
    options: Options,
    on_progress: Listener,
    scheduler: Scheduler | None = None,
    watch: Stopwatch | None = None,
) -> Result:
    """Grade one submission: record its sessions, judge them, repeat undecided sessions, write the report.

    Results of an earlier grading stay until all sessions have been recorded.

    Parameters
    ----------
    source
        Folder, archive, a find of `grader.submission.discovery`, or a submission that is extracted already.
    scheduler
        None for a `LocalScheduler` of this grading alone.

    Raises
    ------
    GraderError
        If no fair score exists. Then no result is written, but complete recordings are kept.
    """
    # An installation was probed when it was found.
    if options.ros is None:
        require_platform(options.interpreter)
    watch = watch or Stopwatch()
    earlier = earlier_results(results) if options.earlier is None else options.earlier
    with ExitStack() as stack:
        with watch.stage("unpacking the submission"):
            intake = stack.enter_context(_opened(source))
            reading = partial(read_submission, intake, rubric)
            submission = in_bounds(reading, intake.source.location, _READING_BOUND)
        if options.sessions is not None:
            submission.sessions = list(options.sessions)
        exports = stack.enter_context(LiveExports(options.exports, results, options.path_prefix))
        with _new_recordings(results, options.scope) as new:
            grading = Grading(
                folder=intake.folder,
                submission=submission,
                rubric=rubric,
                results=new,
                options=options,
                on_progress=exports.follow(on_progress),
                before=result_before(earlier, submission.sha256),
                scheduler=scheduler,
                watch=watch,
            )
            judgement = grading.record()
        with _naming_kept(results, results):
            replace_files(files_of(judgement, results, rubric))
    with _naming_kept(results, results):
        exports.write(judgement.result)
    return judgement.result


def _opened(source: SubmissionSource | Path | Intake) -> AbstractContextManager[Intake]:
    if isinstance(source, Intake):
        return nullcontext(source)
    return open_submission(source, prefix=scratch_prefix())


@contextmanager
def _new_recordings(results: Path, scope: Scope) -> Iterator[Path]:
    """Give a folder for new recordings, which replaces the old ones even if a stage after the sessions fails."""
    keeping = atomic_replacement(results, PARTS, lambda new: _is_recorded(new / RECORDINGS))
    with keeping as new, _naming_kept(new, results):
        if scope is Scope.UNDECIDED:
            shutil.copytree(results / RECORDINGS, new / RECORDINGS)
        yield new


@contextmanager
def _naming_kept(folder: Path, results: Path) -> Iterator[None]:
    """Add to an error in a later stage that the recordings in a folder are kept, and the command that continues."""
    try:
        yield
    except (Exception, KeyboardInterrupt) as error:
        if not _is_recorded(folder / RECORDINGS):
            raise
        kept = f"The recordings are kept; `grade regrade {results}` continues from there."
        if isinstance(error, KeyboardInterrupt):
            raise KeyboardInterrupt(kept) from error
        failure = described(error)
        failure.remedy = f"{failure.remedy} {kept}".lstrip()
        cause = error.__cause__ if failure is error else error
        raise failure from cause


def _is_recorded(recordings: Path) -> bool:
    return recordings.is_dir() and not (recordings / _BEGUN).exists()


@dataclass(frozen=True)
class Grading:
    """A grading of one submission from a folder; each method is a stage of `record`."""

    folder: Path
    submission: SubmissionRecord
    rubric: Rubric
    #: Folder of the recordings and of the copy of the rubric.
    results: Path
    options: Options
    on_progress: Listener
    #: Text of the result of the previous submission, kept with the recordings.
    before: str | None = None
    #: None for a `LocalScheduler` of this grading alone.
    scheduler: Scheduler | None = None
    watch: Stopwatch = field(default_factory=Stopwatch)

    def record(self) -> Judgement:
        """Record the chosen sessions, and repeat sessions with undecided checks; returns the final judgement."""
        chosen = chosen_sessions(self.rubric, self.options, self.submission)
        with ExitStack() as stack:
            scheduler = self.scheduler
            if scheduler is None:
                local = LocalScheduler(self.options.interpreter, self.options.jobs)
                scheduler = stack.enter_context(local)
            sessions = self._sessions(chosen, scheduler, stack)
            chosen = self._startable(chosen, sessions.programs)
            judge = _Judge(self.recordings, self.rubric, self.options.overrides)
            judge.load_later()
            if self.options.scope is not Scope.UNDECIDED:
                self._record_sessions(sessions, chosen)
            judged = partial(self._judged, judge, scheduler)
            if self.options.scope is Scope.ONCE or sessions.lacking:
                return judged()
            retry = partial(self._retry, sessions, scheduler)
            return retry_undecided(self.recordings, chosen, retry, judged)

    @property
    def recordings(self) -> Path:
        """Folder of the recorded sessions."""
        return self.results / RECORDINGS

    def _sessions(
        self, chosen: Sequence[str], scheduler: Scheduler, stack: ExitStack
    ) -> SessionRunner:
        """Prepare the sessions: sandbox, interfaces, workspace. All of it ends with the stack."""
        isolation = self._isolation(scheduler)
        forks = stack.enter_context(scheduler.fork_server(likely_used(self.rubric, chosen)))
        native = self._native_launch()
        self._note_left_out(chosen)
        needs = self._needs(chosen)
        interfaces = _scratch(stack)
        prefixes = _scratch(stack)
        staged = _scratch(stack)
        lacking = self._build_interfaces(needs, interfaces, isolation, scheduler)
        self._build_packages(isolation, scheduler, prefixes)
        if self.options.scope is not Scope.UNDECIDED:
            self._begin_recordings()
        programs = self._stage(staged, scheduler, prefixes)
        return SessionRunner(
            rubric=self.rubric,
            submission=self.submission,
            staged=staged,
            programs=programs,
            recordings=self.recordings,
            isolation=isolation,
            installation=self.options.installation,
            seed=self._seed(),
            versions=self._versions(native, interfaces),
            forks=forks,
            slots=scheduler.slots,
            native=native,
            interfaces=interfaces,
            lacking=lacking,
        )

    def _startable(self, chosen: Sequence[str], programs: Collection[str]) -> list[str]:
        """Return the sessions with a first program; a compiled one that was not built cannot be started."""
        found = []
        for name in chosen:
            first = self.rubric.sessions[name].needs[:1]
            if set(programs).issuperset(first):
                found.append(name)
        return found

    def _isolation(self, scheduler: Scheduler) -> Isolation:
        with self.watch.stage("testing the sandbox"):
            isolation = scheduler.isolation
        require(isolation, Level.of(self.options.least_isolation))
        return isolation

    def _native_launch(self) -> NativeLaunch | None:
        sources = []
        if self.submission.source:
            sources.append(Path(self.submission.source))
        return find_native_launch(self.options.installation, self.options.evaluator, sources)

    def _note_left_out(self, chosen: Sequence[str]) -> None:
        for name in self.options.sessions_of(self.rubric):
            if name not in chosen and name not in self.rubric.bonus_sessions:
                text = "left out, since its file is missing"
                self.on_progress(Progress(name, text, ended=True))

    def _needs(self, chosen: Sequence[str]) -> Needed:
        """Find the modules that are missing here, and the interfaces that the sessions need."""

        def look() -> tuple[list[str], Needed]:
            modules = modules_to_look_for(self.submission)
            return modules, needed_interfaces(self.rubric, self.submission, chosen)

        modules, needs = in_bounds(look, self.submission.source, _READING_BOUND)
        self.submission.absent_modules = absent_modules(self.options.installation, modules)
        return needs

    def _build_interfaces(
        self, needs: Needed, folder: Path, isolation: Isolation, scheduler: Scheduler
    ) -> Mapping[str, str]:
        """Build the interface packages; returns the reason for each session that cannot have its packages."""
        what = "building interfaces"

        def still_building() -> None:
            """Tell the scheduler, which ends gradings that report nothing for too long."""
            with scheduler.work(what):
                pass

        with ExitStack() as stack:
            if needs.packages:
                stack.enter_context(self._work(what, scheduler))
            return provide_interfaces(
                needs,
                self.rubric,
                self.submission,
                folder,
                isolation,
                self.options.interpreter,
                still_building,
            )

    def _build_packages(self, isolation: Isolation, scheduler: Scheduler, prefixes: Path) -> None:
        """Build the submission's packages, and note the outcomes; bare files need no build."""
        submission = self.submission
        if not submission.packages:
            return
        if not can_build(isolation):
            return
        time_s = self.rubric.lab.build_timeout_s
        with self._work("building packages", scheduler):
            builds = build_packages(
                self.folder, submission, isolation, time_s, prefixes, self.options.installation
            )
        submission.builds = builds
        note_installed(submission, prefixes)

    def _begin_recordings(self) -> None:
        """Remove an earlier recording, and begin with the submission and the rubric."""
        recordings, submission, rubric = self.recordings, self.submission, self.rubric
        shutil.rmtree(recordings, ignore_errors=True)
        recordings.mkdir(parents=True)
        (recordings / _BEGUN).touch()
        files = kept_lab.files_of(rubric)
        kept_lab.trust(files)
        submission.lab_folder = str(rubric.folder)
        submission.lab_files = kept_lab.sha256s(files)
        submission.lab_id = rubric.lab.id
        submission.lab_sha256 = kept_lab.identity_of(rubric)
        write_submission(recordings, submission)
        replace_files(rubric_files(recordings, rubric))
        replace_files({recordings / EARLIER_FILE: self.before})

    def _stage(
        self, staged: Path, scheduler: Scheduler, prefixes: Path
    ) -> dict[str, StudentProgram]:
        python = str(self.options.interpreter)
        staging = partial(
            stage, self.folder, self.submission, self.rubric, staged, python, prefixes
        )
        with self._work("staging", scheduler):
            return in_bounds(staging, self.submission.source, _READING_BOUND)

    def _seed(self) -> int:
        if self.options.seed is not None:
            return self.options.seed
        return random.SystemRandom().randrange(2**31)

    def _versions(self, native: NativeLaunch | None, interfaces: Path) -> dict[str, str]:
        launch = "stand-in" if native is None else "native"
        found = {**versions(), "launch": launch, **parts_in(interfaces)}
        if self.options.ros is not None:
            found[STUDENTS_ROS] = str(self.options.ros)
        return found

    def _record_sessions(self, sessions: SessionRunner, chosen: Sequence[str]) -> None:
        with self.watch.stage("sessions"):
            sessions.record(chosen, self.watch.follow(self.on_progress))
        (self.recordings / _BEGUN).unlink()

    def _retry(
        self,
        sessions: SessionRunner,
        scheduler: Scheduler,
        undecided: Sequence[str],
        folder: Path,
        attempt: int,
        disturbed: frozenset[str],
    ) -> None:
        again = replace(sessions, recordings=folder, attempt=attempt, disturbed=disturbed)
        with self.watch.stage("waiting for a calmer machine"):
            scheduler.await_calm(attempt)
        with self.watch.stage(f"repeating sessions, attempt {attempt}"):
            again.record(undecided, self.watch.follow(self.on_progress))

    def _judged(self, judge: _Judge, scheduler: Scheduler) -> Judgement:
        with self._work("judging", scheduler):
            return judge.judged()

    @contextmanager
    def _work(self, what: str, scheduler: Scheduler) -> Iterator[None]:
        """Measure the grader's own work, which first waits for its slot."""
        with scheduler.work(what), self.watch.stage(what):
            yield


class _Judge:
    """Judges recordings, after loading everything for it while sessions run."""

    def __init__(self, recordings: Path, rubric: Rubric, overrides: Overrides) -> None:
        self._recordings = recordings
        self._rubric = rubric
        self._overrides = overrides
        self._loading = threading.Timer(_LOADED_AFTER_S, load, [rubric])
        self._loading.daemon = True

    def load_later(self) -> None:
        """Load once the sessions have started and leave a core some time."""
        self._loading.start()

    def judged(self) -> Judgement:
        """Judge the recordings as they are now."""
        self._loading.cancel()
        self._loading.join()
        return judge_bounded(self._recordings, self._rubric, self._overrides)


def _scratch(stack: ExitStack) -> Path:
    folder = tempfile.TemporaryDirectory(prefix=scratch_prefix())
    return Path(stack.enter_context(folder))
