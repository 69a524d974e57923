"""The stages of grading, a line each: `record` (the live half) and what it is judged by (the judging half)."""

from __future__ import annotations

import random
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from grader.bounded import Bound
from grader.errors import UsageError, described
from grader.files import UNFINISHED, atomic_replacement, replace_files, text_of
from grader.judging.attempts import retry_undecided
from grader.judging.rubrics import (
    read_overrides,
    recorded_rubric,
    rubric_copy,
    rubric_files,
    rubric_files_of_result,
)
from grader.lab import kept_lab
from grader.lab.overrides import Overrides
from grader.lab.rubric import Rubric
from grader.recording.submission import SubmissionRecord, write_submission
from grader.report.exports.writing import ExportTarget
from grader.result import CheckResult, Result, result_of_text
from grader.result_folder import (
    EARLIER_FILE,
    LAYOUT_FILE,
    RECORDINGS,
    REPORT_FILE,
    RESULT_FILE,
    RUBRIC_COPY,
)
from grader.submission.artifacts import read_submission
from grader.submission.extraction import Intake, SubmissionSource, in_bounds, open_submission
from grader.submission.separation import made_from
from grader.timings import Stopwatch

if TYPE_CHECKING:
    from grader.judging.judgement import Judgement
    from grader.live.ahead import Ahead
    from grader.live.session.runner import Scheduler

#: What a grading makes, the file that says that it is whole last.
PARTS = (RUBRIC_COPY, kept_lab.KEPT, RECORDINGS, REPORT_FILE, RESULT_FILE)
#: Among recordings: stands there until all sessions have been recorded.
_BEGUN = ".begun"
#: When sessions have started, and leave a core some time, what judging needs is imported.
_PREPARED_AFTER_S = 3.0
#: What each step of reading and staging a submission may take, which takes the solution 0.02 s.
_READING_BOUND = Bound(
    what="reading the submission", cpu_s=20.0, wall_s=100.0, memory_bytes=1024**3
)


class Scope(Enum):
    """Which of the chosen sessions a grading records."""

    #: All, and again those that leave something undecided.
    ALL = "all"
    #: All, once.
    ONCE = "once"
    #: Those that leave something undecided in the recordings of an earlier grading, which go on counting otherwise.
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Options:
    """What the user chose for the live half; by default all sessions, with a new seed, as many as the cores allow."""

    #: Python that runs students' code.
    interpreter: Path
    sessions: Sequence[str] | None = None
    scope: Scope = Scope.ALL
    #: For the stimuli.
    seed: int | None = None
    #: Sessions side by side.
    jobs: int | None = None
    #: What evaluates launch files, see `find_native_launch`.
    launch: str = "standin"
    #: The level of confinement below which nothing is run, see `Level`.
    least_isolation: str = "reduced"
    #: What people decided about single submissions.
    overrides: Overrides = field(default_factory=Overrides)
    #: Forms for other systems in which the result is written too; anew after each session, with what is known.
    exports: Sequence[ExportTarget] = ()
    #: Folder of the submission in its repository.
    path_prefix: str = ""
    #: Texts of the results that were there, see `earlier_results`; None for those in the folder of results.
    earlier: tuple[str, ...] | None = None

    def sessions_of(self, rubric: Rubric) -> list[str]:
        """Return the sessions that were chosen, in order."""
        return list(rubric.sessions if self.sessions is None else self.sessions)


def earlier_results(results: Path) -> tuple[str, ...]:
    """Return the texts of a submission's result, and of that of the submission before, as far as they are there."""
    texts = (text_of(results / RESULT_FILE), text_of(results / RECORDINGS / EARLIER_FILE))
    return tuple(text for text in texts if text is not None)


def result_before(texts: Sequence[str], sha256: str) -> str | None:
    """Return the first text of a result that is not of the submission with this hash."""
    found = ((text, result_of_text(text)) for text in texts)
    submitted = (
        (text, result.provenance.get("submission_sha256"))
        for text, result in found
        if result is not None
    )
    return next((text for text, of in submitted if of not in (None, sha256)), None)


def require_sessions(names: Sequence[str], rubric: Rubric) -> None:
    """Raise UsageError unless the rubric has all of these sessions."""
    for name in names:
        if name not in rubric.sessions:
            remedy = f"Sessions of this rubric are {', '.join(rubric.sessions)}."
            raise UsageError(f"there is no session {name!r}", remedy=remedy)


def chosen_sessions(rubric: Rubric, options: Options, submission: SubmissionRecord) -> list[str]:
    """Return the sessions to run: those chosen whose first file was handed in; raises UsageError for unknown ones."""
    require_sessions(options.sessions or (), rubric)
    there = {a.name for a in submission.artifacts if a.path is not None}
    return [
        s for s in options.sessions_of(rubric) if there.issuperset(rubric.sessions[s].needs[:1])
    ]


def grade(
    source: SubmissionSource | Path | Intake,
    rubric: Rubric,
    results: Path,
    options: Options,
    on_progress: Callable[..., None],
    scheduler: Scheduler | None = None,
    watch: Stopwatch | None = None,
    ahead: Ahead | None = None,
) -> Result:
    """Grade one submission: record, judge, run undecided sessions again, report.

    It is a folder, an archive, what `grader.submission.discovery` made of more, or one that is extracted already.
    Results of an earlier grading stay until all sessions have been recorded. Raises GraderError if no fair score
    exists: no result is written then, but once all is recorded, the recordings are kept.
    """
    from confine.scratch import scratch_prefix
    from grader.live.sandbox.environment import require_platform
    from grader.live_exports import LiveExports

    require_platform(options.interpreter)
    watch = watch or Stopwatch()
    earlier = options.earlier if options.earlier is not None else earlier_results(results)
    opening = (
        nullcontext(source)
        if isinstance(source, Intake)
        else open_submission(source, prefix=scratch_prefix())
    )
    with ExitStack() as stack:
        with watch.stage("unpacking the submission"):
            intake = stack.enter_context(opening)
            submission = in_bounds(
                partial(read_submission, intake, rubric), intake.source.location, _READING_BOUND
            )
        submission.sessions = list(options.sessions) if options.sessions is not None else None
        with LiveExports(options.exports, results, options.path_prefix) as exports:
            follow = exports.follow(on_progress)
            # The recordings take their place first: no fault in what comes after them throws them away.
            with (
                atomic_replacement(
                    results, PARTS, lambda new: _is_recorded(new / RECORDINGS)
                ) as new,
                _naming_kept(new, results),
            ):
                if options.scope is Scope.UNDECIDED:
                    shutil.copytree(results / RECORDINGS, new / RECORDINGS)
                before = result_before(earlier, submission.sha256)
                judgement = record(
                    intake.folder,
                    submission,
                    rubric,
                    new,
                    options,
                    follow,
                    scheduler,
                    watch,
                    before,
                    ahead,
                )
            with _naming_kept(results, results):
                replace_files(files_of(judgement, results, rubric))
    with _naming_kept(results, results):
        exports.write(judgement.result)
    return judgement.result


@contextmanager
def _naming_kept(folder: Path, results: Path) -> Iterator[None]:
    """Where a stage fails once all is recorded in a folder, say that this is kept, and what continues from there."""
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
        raise failure from (error if failure is not error else error.__cause__)


def _is_recorded(recordings: Path) -> bool:
    return recordings.is_dir() and not (recordings / _BEGUN).exists()


def record(
    folder: Path,
    submission: SubmissionRecord,
    rubric: Rubric,
    results: Path,
    options: Options,
    on_progress: Callable[..., None],
    scheduler: Scheduler | None = None,
    watch: Stopwatch | None = None,
    before: str | None = None,
    ahead: Ahead | None = None,
) -> Judgement:
    """Run the live half, and sessions again whose checks are undecided; returns the judgement of what is kept.

    `before` is the text of the result of what the student handed in before this, and kept with the recordings. Without
    a scheduler, what was begun `ahead` is used, and ends with this.
    """
    from confine.isolation import Level
    from confine.machine import wait_for_calm
    from confine.scratch import scratch_prefix
    from grader.evidence.environment_gap import modules_to_look_for
    from grader.live.ahead import Ahead
    from grader.live.interfaces.build import parts_in
    from grader.live.interfaces.needs import needed_interfaces, provide_interfaces
    from grader.live.sandbox.environment import absent_modules, find_native_launch, versions
    from grader.live.sandbox.probing import require
    from grader.live.session.runner import Progress, SessionRunner, given_in_steps
    from grader.live.session.stage import stage

    watch = watch or Stopwatch()

    @contextmanager
    def work(what: str) -> Iterator[None]:
        """Measure a piece of work, and have it wait for its slot where the machine is shared."""
        with scheduler.work(what) if scheduler is not None else nullcontext(), watch.stage(what):
            yield

    def still_building() -> None:
        """Say so where it is counted for how long nothing is said."""
        if scheduler is not None:
            with scheduler.work("building interfaces"):
                pass

    chosen = chosen_sessions(rubric, options, submission)
    with ExitStack() as stack:
        if scheduler is None:
            begun = stack.enter_context(ahead or Ahead(options.interpreter))
            forks, isolation_of = begun.forks, begun.isolation
            forks.types = given_in_steps(rubric, "type", sessions=chosen)
        else:
            forks, isolation_of = (
                stack.enter_context(scheduler.fork_server()),
                lambda: scheduler.isolation,
            )
        interfaces = stack.enter_context(tempfile.TemporaryDirectory(prefix=scratch_prefix()))
        with watch.stage("testing the sandbox"):
            isolation = isolation_of()
        require(isolation, Level.of(options.least_isolation))
        if scheduler is None:  # Meanwhile it loads what every sandbox needs.
            forks = stack.enter_context(forks.branch(isolation.form))
        sources = list(map(Path, filter(None, [submission.source])))
        native = find_native_launch(options.interpreter, options.launch, sources)
        recordings = results / RECORDINGS
        for name in [
            name
            for name in options.sessions_of(rubric)
            if name not in {*chosen, *rubric.bonus_sessions}
        ]:
            on_progress(Progress(name, "left out, since its file is missing", ended=True))
        read = partial(in_bounds, location=submission.source, bound=_READING_BOUND)
        wanted, needed = read(
            lambda: (modules_to_look_for(submission), needed_interfaces(rubric, submission, chosen))
        )
        submission.absent_modules = absent_modules(options.interpreter, wanted)
        with work("building interfaces") if needed.packages else nullcontext():
            lacking = provide_interfaces(
                needed,
                rubric,
                submission,
                Path(interfaces),
                isolation,
                options.interpreter,
                still_building,
            )
        if options.scope is not Scope.UNDECIDED:
            _start_afresh(recordings, submission, rubric)
            replace_files({recordings / EARLIER_FILE: before})
        with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as scratch:
            with work("staging"):
                executables = read(
                    partial(
                        stage, folder, submission, rubric, Path(scratch), str(options.interpreter)
                    )
                )
            sessions = SessionRunner(
                rubric,
                submission,
                Path(scratch),
                executables,
                recordings,
                isolation,
                options.interpreter,
                options.seed
                if options.seed is not None
                else random.SystemRandom().randrange(2**31),
                versions()
                | {"launch": "native" if native is not None else "stand-in"}
                | parts_in(Path(interfaces)),
                forks,
                native,
                scheduler=scheduler,
                interfaces=Path(interfaces),
                lacking=lacking,
            )
            on_progress = watch.follow(on_progress)
            judging = partial(
                import_module, "grader.judging.judgement"
            )  # Nothing waits for it until then.
            preparing = threading.Timer(_PREPARED_AFTER_S, lambda: judging().prepare(rubric))
            preparing.daemon = True
            preparing.start()
            if options.scope is not Scope.UNDECIDED:
                at_a_time = options.jobs if sessions.isolation.namespaces else None
                with watch.stage("sessions"):
                    sessions.record(chosen, on_progress, at_a_time=at_a_time)
                (recordings / _BEGUN).unlink()

            def retry(
                undecided: Sequence[str], folder: Path, attempt: int, disturbed: frozenset[str]
            ) -> None:
                alone = replace(sessions, recordings=folder, attempt=attempt, disturbed=disturbed)
                with watch.stage("waiting for a calmer machine"):
                    if scheduler is not None:
                        scheduler.pause()
                    # The second time a class waits for slots beside few others: so few that they suffice, but no calm.
                    if scheduler is None or attempt > 2:
                        wait_for_calm()
                with watch.stage(f"repeating sessions, attempt {attempt}"):
                    alone.record(undecided, on_progress, at_a_time=1)

            def judged() -> Judgement:
                with work("judging"):
                    preparing.cancel()
                    preparing.join()
                    found: Judgement = judging().judge_bounded(
                        recordings, rubric, options.overrides
                    )
                    return found

            once = options.scope is Scope.ONCE or lacking
            return judged() if once else retry_undecided(recordings, chosen, retry, judged)


def _start_afresh(recordings: Path, submission: SubmissionRecord, rubric: Rubric) -> None:
    """Remove what an earlier recording left, and begin with what was handed in."""
    shutil.rmtree(recordings, ignore_errors=True)
    recordings.mkdir(parents=True)
    (recordings / _BEGUN).touch()
    files = kept_lab.files_of(rubric)
    kept_lab.trust(files)
    submission.lab_folder, submission.lab_files = str(rubric.folder), kept_lab.sha256s(files)
    submission.lab_id, submission.lab_sha256 = rubric.lab.id, kept_lab.identity_of(rubric)
    write_submission(recordings, submission)
    replace_files(rubric_files(recordings, rubric))


def files_of(judgement: Judgement, results: Path, rubric: Rubric) -> dict[Path, str | None]:
    """Return the texts of a submission's results, by their places; None for what is not to be there."""
    page, text = judgement.page, judgement.text
    layouts = {
        results / RECORDINGS / name / LAYOUT_FILE: layout
        for name, layout in judgement.layouts.items()
    }
    return {
        **rubric_files_of_result(results, rubric),
        **layouts,
        results / REPORT_FILE: page,
        results / RESULT_FILE: text,
    }


def judge_so_far(results: Path) -> Result:
    """Judge what has been recorded until now of a submission that is still being graded, and write nothing.

    Checks of sessions that have not ended are undecided, and say so. Raises RecordingError if nothing has begun there.
    """
    from grader.judging.judgement import judge_bounded

    new = results / UNFINISHED
    folder = new if (new / RECORDINGS).is_dir() else results
    rubric = recorded_rubric(rubric_copy(folder))
    overrides = read_overrides(None, results.resolve().parent, rubric, [made_from(folder)])
    result = judge_bounded(folder / RECORDINGS, rubric, overrides, page=False).result
    recorded = result.provenance["sessions"]

    def shown(check: CheckResult) -> CheckResult:
        if check.session is None or check.session in recorded or check.outcome.decided:
            return check
        return replace(check, reason=f"Not yet run: the session '{check.session}' has not ended.")

    criteria = [replace(c, checks=tuple(map(shown, c.checks))) for c in result.criteria]
    return replace(result, criteria=tuple(criteria))
