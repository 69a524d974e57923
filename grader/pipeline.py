"""The stages of grading, a line each: `record` (the live half) and `judge_results` (the judging half)."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import importlib.util
import platform
import random
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

import grader
from grader import kept_lab
from grader.bounded import Bound, in_process
from grader.checks import PARAMETERS_OF
from grader.cohort.adjustments import adjust
from grader.cohort.entries import ClassEntry
from grader.cohort.overrides import OVERRIDES_FILE, Overrides, load_overrides, moment_of
from grader.desk import lies_within, made_from
from grader.errors import PlatformError, RecordingError, RubricError, UsageError, described
from grader.exporting import ExportTarget
from grader.files import UNFINISHED, beside, replace_file, replace_files
from grader.intake import Handed, Intake, confined, taken_in
from grader.judging import Recordings, judge, open_recordings
from grader.patterns import patterns_bounded
from grader.recording.session import read_session, write_session
from grader.recording.submission import SubmissionRecord, write_submission
from grader.result import CheckResult, Result, to_json
from grader.rubric import Kinds, Rubric, load_rubric
from grader.submission import read_submission
from grader.timings import Stopwatch

if TYPE_CHECKING:
    from grader.cohort.summary import ClassSummary
    from grader.live.cells import Shared

RECORDINGS = "recordings"
RUBRIC_COPY = "rubric.yaml"
RESULT_FILE = "result.json"
REPORT_FILE = "report.html"
CLASS_PAGE = "index.html"
GRADES_FILE = "grades.csv"
ANONYMOUS_PAGE = "index-anonymous.html"
ANONYMOUS_GRADES_FILE = "grades-anonymous.csv"
#: What a grading makes, the file that says that it is whole last.
_PARTS = (RUBRIC_COPY, kept_lab.KEPT, RECORDINGS, REPORT_FILE, RESULT_FILE)
#: Among recordings: stands there until all sessions have been recorded.
_BEGUN = ".begun"
#: Among recordings: one that is made again, and a copy that is being made or removed.
_EARLIER, _PARTIAL = ".earlier", ".partial"
#: How often a session whose checks are undecided is recorded again, alone.
RETRIES = 2
#: What judging one submission may take. The solution takes 0.25 s and 0.1 GiB on a core of today; more than a hundred
#: times that is no fair wait. In a class, a piece of work is given up after 120 s in any case (`batch.supervised`).
JUDGING_BOUND = Bound(what="judging the submission", cpu_s=30.0, wall_s=100.0, memory_bytes=2 * 1024**3)
#: What each step of reading and staging a submission may take, which takes the solution 0.02 s.
_READING_BOUND = Bound(what="reading the submission", cpu_s=20.0, wall_s=100.0, memory_bytes=1024**3)


@dataclass(frozen=True)
class Options:
    """What the user chose for the live half.

    Attributes
    ----------
    interpreter : Path
        Python that runs students' code.
    sessions : sequence of str or None
        Sessions to run; all by default.
    seed : int or None
        For the stimuli; drawn anew by default.
    jobs : int or None
        Sessions side by side; as many as the cores allow by default.
    launch : str
        What evaluates launch files: "standin", "native" (the real `launch`, as the interpreter finds it) or
        "auto" (the real one where there is one).
    least_isolation : str
        The level of confinement below which nothing is run: "full", "no-cgroup", "reduced" or "none".
    overrides : Overrides
        What people decided about single submissions.
    exports : sequence of ExportTarget
        Forms for other systems in which the result is written too; anew after each session, with what is known.
    path_prefix : str
        Folder of the submission in its repository.
    """

    interpreter: Path
    sessions: Sequence[str] | None = None
    seed: int | None = None
    jobs: int | None = None
    launch: str = "standin"
    least_isolation: str = "reduced"
    overrides: Overrides = field(default_factory=Overrides)
    exports: Sequence[ExportTarget] = ()
    path_prefix: str = ""


def lab_folder() -> Path:
    """Return the folder of the lab that travels with the grader: the checkout's root, or inside the package."""
    package = Path(grader.__file__).parent
    inside = package / "lab"
    return inside if (inside / "rubric.yaml").is_file() else package.parent


def read_rubric(path: Path | None, kept: Path | None = None) -> Rubric:
    """Load a rubric that the user names, by default that of the lab which travels with the grader.

    A copy that lies elsewhere finds the files that it names in the folder of that lab, if it is of the same lab.

    Parameters
    ----------
    kept : Path, optional
        The copy of a rubric with its own files kept beside it, to be used before those.

    Raises
    ------
    RubricError
        With all its mistakes.
    """
    shipped = lab_folder() / "rubric.yaml"
    path = path or shipped
    if (path.parent / kept_lab.KEPT).is_dir():
        return recorded_rubric(path)
    own = kept if kept is not None and _lab_id(kept) == _lab_id(path) and kept_lab.kept_files(kept) else None
    if own is not None:
        kept_lab.require_known(own, lab_folder())
    same = path == shipped or _lab_id(path) == _lab_id(shipped)
    fallback = own.parent / kept_lab.KEPT if own is not None else lab_folder() if same else None
    rubric = load_rubric(path, rubric_kinds(), fallback)
    kept_lab.trust(kept_lab.files_of(rubric))
    return rubric


def recorded_rubric(copy: Path, *, trusted: bool = False) -> Rubric:
    """Load the copy of a rubric that lies with results, and the files that it names from beside it.

    Parameters
    ----------
    trusted : bool
        Whether these may be executed though they are not known here; see `grader.kept_lab`.

    Raises
    ------
    RecordingError
        If they may not be executed, or an earlier version of the grader has not kept them.
    RubricError
        With all mistakes of the rubric.
    """
    files = kept_lab.kept_files(copy)
    if trusted:
        kept_lab.trust(files)
    elif files:
        kept_lab.require_known(copy, lab_folder())
    # Before they were kept, those of the grader's own lab were used; for another lab they would be the wrong ones.
    shipped = not files and _lab_id(copy) == _lab_id(lab_folder() / "rubric.yaml")
    folder = lab_folder() if shipped else copy.parent / kept_lab.KEPT
    try:
        return load_rubric(copy, rubric_kinds(), folder, only=True)
    except RubricError as error:
        if not files and not shipped:
            error.remedy = "The recordings are without the files of their lab; give its rubric by --rubric."
        raise


@functools.lru_cache(maxsize=16)
def _lab_id_in(text: str) -> str:
    with suppress(yaml.YAMLError, RecursionError, TypeError, KeyError):
        found = yaml.load(text, yaml.CSafeLoader)["lab"]["id"]
        # Written out, nested aliases have no end.
        return str(found) if isinstance(found, (str, int, float)) else ""
    return ""


def _lab_id(rubric: Path) -> str:
    with suppress(OSError, UnicodeDecodeError):
        return _lab_id_in(rubric.read_text(encoding="utf-8"))
    return ""


def rubric_kinds() -> Kinds:
    """Return the checks and figures that a rubric can use."""
    from grader.evidence.figures import FIGURES

    return Kinds(PARAMETERS_OF, {name: kind.parameters for name, kind in FIGURES.items()})


def read_overrides(path: Path | None, results: Path, rubric: Rubric, sources: Iterable[str] = ()) -> Overrides:
    """Load the file of overrides that is given, or else the one beside the results, if there is one.

    Parameters
    ----------
    results : Path
        Folder with a folder of results for each submission.
    sources : iterable of str
        Where the submissions lie. If the results lie in one of them, the file beside them may be a student's, and
        does not count.

    Raises
    ------
    RubricError
        With all its mistakes.
    """
    beside = results / OVERRIDES_FILE
    if path is None and lies_within(results, sources):
        return Overrides()
    if path is None and not beside.is_file():
        misnamed = beside.with_suffix(".yml")
        if misnamed.is_file():
            problem = f"the file of overrides is called {OVERRIDES_FILE}; under this name nothing in it would count"
            raise RubricError(
                problem, [], where=str(misnamed), remedy=f"Rename it, or give it with --overrides {misnamed}."
            )
        return Overrides()
    return load_overrides(path or beside, rubric)


def require_platform(interpreter: Path | None = None) -> None:
    """Raise unless ROS 2 nodes can run here.

    Parameters
    ----------
    interpreter : Path, optional
        What runs students' code, if that is looked at too.

    Raises
    ------
    PlatformError
        With what is missing.
    """
    if platform.system() != "Linux" or platform.machine() != "x86_64":
        raise PlatformError(
            f"ROS 2 nodes cannot run on {platform.system()} {platform.machine()}",
            remedy="The ROS 2 wheels exist for Linux x86-64. Grade there or in the container; "
            "`grade regrade` works on every system.",
        )
    if importlib.util.find_spec("rclpy") is None:
        raise PlatformError(
            "the Python package rclpy is not installed",
            remedy="pip install 'ros-jazzy-rclpy[fastrtps]' ros-jazzy-common-interfaces",
        )
    if interpreter is not None:
        from grader.live.environment import require_ros

        require_ros(interpreter)


def versions() -> dict[str, str]:
    """Return the versions that a recording keeps."""
    named = {"grader": grader.__version__, "python": platform.python_version(), "kernel": platform.release()}
    for package in ("ros-jazzy-rclpy", "ros-fastrtps", "ros-rmw-fastrtps-cpp", "mcap", "rosbags", "numpy"):
        try:
            named[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            named[package] = "not installed"
    return named


def require_sessions(names: Sequence[str], rubric: Rubric) -> None:
    """Raise unless the rubric has all of these sessions.

    Raises
    ------
    UsageError
        With the sessions that there are.
    """
    for name in names:
        if name not in rubric.sessions:
            remedy = f"Sessions of this rubric are {', '.join(rubric.sessions)}."
            raise UsageError(f"there is no session {name!r}", remedy=remedy)


def chosen_sessions(rubric: Rubric, options: Options, submission: SubmissionRecord) -> list[str]:
    """Return the sessions to run: those chosen whose first file was handed in.

    Raises
    ------
    UsageError
        If a session is chosen that the rubric does not have.
    """
    require_sessions(options.sessions or (), rubric)
    there = {a.name for a in submission.artifacts if a.path is not None}
    wanted = options.sessions if options.sessions is not None else list(rubric.sessions)
    return [s for s in wanted if not rubric.sessions[s].needs or rubric.sessions[s].needs[0] in there]


def grade(
    handed: Handed | Path | Intake,
    rubric: Rubric,
    results: Path,
    options: Options,
    on_progress: Callable[..., None],
    shared: Shared | None = None,
    watch: Stopwatch | None = None,
) -> Result:
    """Grade one submission: record, judge, run undecided sessions again, report.

    Parameters
    ----------
    handed : Handed, Path or Intake
        The submission: a folder, an archive, what `grader.batch.found` made of more, or what was taken in already.
    results : Path
        Folder of this submission's results. Those of an earlier grading stay until all sessions have been recorded.
    shared : Shared, optional
        What other submissions on this machine have to do with it.
    watch : Stopwatch, optional
        Told what takes its time.

    Raises
    ------
    GraderError
        If no fair score exists; no result is written then. Once all is recorded, the recordings are kept.
    """
    from grader.live.scratch import scratch_prefix
    from grader.live_exports import LiveExports

    require_platform(options.interpreter)
    watch = watch or Stopwatch()
    taking = nullcontext(handed) if isinstance(handed, Intake) else taken_in(handed, prefix=scratch_prefix())
    with ExitStack() as stack:
        with watch.stage("taking the submission in"):
            intake = stack.enter_context(taking)
            submission = confined(partial(read_submission, intake, rubric), intake.where, _READING_BOUND)
        submission.sessions = list(options.sessions) if options.sessions is not None else None
        with LiveExports(options.exports, results, options.path_prefix) as exports:
            follow = exports.follow(on_progress)
            # The recordings take their place first: no fault in what comes after them throws them away.
            with beside(results, _PARTS, _keep_recorded) as new, _naming_kept(new, results):
                judgement = record(intake.folder, submission, rubric, new, options, follow, shared, watch)
            with _naming_kept(results, results):
                replace_files(_files_of(judgement, results, rubric))
    with _naming_kept(results, results):
        exports.write(judgement.result)
    return judgement.result


@contextmanager
def _naming_kept(folder: Path, results: Path) -> Iterator[None]:
    """Where a stage fails once all is recorded in a folder, say that this is kept, and what goes on from there."""
    try:
        yield
    except (Exception, KeyboardInterrupt) as error:
        if not _is_recorded(folder / RECORDINGS):
            raise
        kept = f"The recordings are kept; `grade regrade {results}` goes on from there."
        if isinstance(error, KeyboardInterrupt):
            raise KeyboardInterrupt(kept) from error
        told = described(error)
        told.remedy = f"{told.remedy} {kept}".lstrip()
        raise told from (error if told is not error else error.__cause__)


def _is_recorded(recordings: Path) -> bool:
    return recordings.is_dir() and not (recordings / _BEGUN).exists()


def _keep_recorded(new: Path) -> bool:
    """Whether all sessions were recorded; one that was being recorded again is as it was recorded before."""
    recordings = new / RECORDINGS
    if not _is_recorded(recordings):
        return False
    for aside in recordings.glob(f".*{_EARLIER}"):
        _put_back(recordings, aside.name[1 : -len(_EARLIER)])
    for copy in recordings.glob(f".*{_PARTIAL}"):
        shutil.rmtree(copy, ignore_errors=True)
    return True


def _work(shared: Shared | None, watch: Stopwatch) -> Callable[[str], AbstractContextManager[None]]:
    """Return what measures a piece of work, and has it wait for its turn where the machine is shared."""

    @contextmanager
    def work(what: str) -> Iterator[None]:
        with shared.turns.work(what) if shared is not None else nullcontext(), watch.stage(what):
            yield

    return work


def record(
    folder: Path,
    submission: SubmissionRecord,
    rubric: Rubric,
    results: Path,
    options: Options,
    on_progress: Callable[..., None],
    shared: Shared | None = None,
    watch: Stopwatch | None = None,
) -> Judgement:
    """Run the live half: stage, isolate, run the sessions, and again those whose checks are undecided.

    Returns
    -------
    Judgement
        What the last recordings were judged to be.
    """
    from grader.evidence.elsewhere import modules_to_look_for
    from grader.live.cells import Progress, Sessions, types_in
    from grader.live.environment import absent_modules
    from grader.live.fork_server import ForkServer
    from grader.live.isolation import Level
    from grader.live.probing import probe_isolation, require
    from grader.live.ros_launch import LaunchChoice, find_native_launch
    from grader.live.scratch import scratch_prefix
    from grader.live.stage import stage

    watch = watch or Stopwatch()
    # It begins to import while the isolation is tried.
    with ForkServer(types_in(rubric)) as forks:
        with watch.stage("trying the isolation"):
            isolation = shared.isolation if shared is not None else probe_isolation(options.interpreter)
        require(isolation, Level.of(options.least_isolation))
        native = find_native_launch(options.interpreter, LaunchChoice(options.launch))
        recordings = results / RECORDINGS
        chosen = chosen_sessions(rubric, options, submission)
        for name in options.sessions if options.sessions is not None else rubric.sessions:
            if name not in chosen:
                on_progress(Progress(name, "left out, since its file is missing", ended=True))
        wanted = confined(partial(modules_to_look_for, submission), submission.source, _READING_BOUND)
        submission.absent_modules = absent_modules(options.interpreter, wanted)
        _start_afresh(recordings, submission, rubric)
        with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as scratch:
            with _work(shared, watch)("staging"):
                staging = partial(stage, folder, submission, rubric, Path(scratch), str(options.interpreter))
                workspace = confined(staging, submission.source, _READING_BOUND)
            sessions = Sessions(
                rubric,
                submission,
                workspace.folder,
                workspace.executables,
                recordings,
                isolation,
                options.interpreter,
                options.seed if options.seed is not None else random.SystemRandom().randrange(2**31),
                versions() | {"launch": "native" if native is not None else "stand-in"},
                forks,
                native,
                turns=shared.turns if shared is not None else None,
            )
            on_progress = watch.follow(on_progress)
            with watch.stage("sessions"):
                sessions.record(chosen, on_progress, at_a_time=options.jobs if sessions.isolation.namespaces else None)
            (recordings / _BEGUN).unlink()
            judging = _work(shared, watch)
            with judging("judging"):
                judgement = judgement_of(recordings, rubric, options.overrides)
            disturbed: frozenset[str] = frozenset()
            for attempt in range(2, RETRIES + 2):
                disturbed |= {v.session for v in judgement.by_rubric.violations if v.kind.disturbs}
                if not (undecided := undecided_sessions(judgement.by_rubric, chosen)):
                    break
                set_aside(recordings, undecided)
                with watch.stage(f"sessions again, attempt {attempt}"):
                    replace(sessions, attempt=attempt, disturbed=disturbed).record(undecided, on_progress, at_a_time=1)
                with judging("judging"):
                    judgement = keep_clearer(recordings, rubric, undecided, judgement, options.overrides)
    return judgement


@dataclass(frozen=True)
class Judgement:
    """What recordings were judged to be.

    Attributes
    ----------
    by_rubric : Result
        By the rubric alone.
    result : Result
        With the points that people and the rubric's policy make of it.
    page, text : str
        The report and `result.json`.
    """

    by_rubric: Result
    result: Result
    page: str
    text: str


def judgement_of(recordings: Path, rubric: Rubric, overrides: Overrides) -> Judgement:
    """Judge recordings in a process of its own.

    Raises
    ------
    RecordingError
        If there is nothing to judge.
    BoundError
        If judging takes more time or memory than it may.
    """

    def judged() -> Judgement:
        recorded = open_recordings(recordings, rubric)
        by_rubric = judge(recorded, rubric)
        result = by_policy(by_rubric, recorded, rubric, overrides)
        return Judgement(by_rubric, result, report_page(result, recorded, rubric), to_json(result))

    return in_process(judged, JUDGING_BOUND)


def _aside(recordings: Path, session: str, suffix: str = _EARLIER) -> Path:
    return recordings / f".{session}{suffix}"


def set_aside(recordings: Path, sessions: Sequence[str]) -> None:
    """Keep recordings of sessions that are made again, beside those that take their places."""
    for session in (name for name in sessions if (recordings / name).is_dir()):
        _forget(recordings, session)
        copy = _aside(recordings, session, _PARTIAL)
        shutil.copytree(recordings / session, copy)
        copy.rename(_aside(recordings, session))


def _put_back(recordings: Path, session: str) -> None:
    shutil.rmtree(recordings / session, ignore_errors=True)
    _aside(recordings, session).rename(recordings / session)


def _forget(recordings: Path, session: str) -> None:
    """Remove what was set aside; half of it is never there under its name."""
    copy = _aside(recordings, session, _PARTIAL)
    shutil.rmtree(copy, ignore_errors=True)
    with suppress(FileNotFoundError):
        _aside(recordings, session).rename(copy)
    shutil.rmtree(copy, ignore_errors=True)


def keep_clearer(
    recordings: Path, rubric: Rubric, sessions: Sequence[str], before: Judgement, overrides: Overrides
) -> Judgement:
    """Judge sessions that were recorded again, and put a recording back that was set aside if it left less undecided.

    On a machine that is busier the second time, what was decided before must not become undecided.

    Parameters
    ----------
    before : Judgement
        What the recordings were judged to be that were set aside.
    """
    judgement = judgement_of(recordings, rubric, overrides)
    after, earlier = judgement.by_rubric, before.by_rubric
    kept = [name for name in sessions if _aside(recordings, name).is_dir()]
    worse = [name for name in kept if _undecided_points(after, name) > _undecided_points(earlier, name)]
    for name in worse:
        _put_back(recordings, name)
        _note_attempt(recordings / name)
    for name in kept:
        _forget(recordings, name)
    return judgement_of(recordings, rubric, overrides) if worse else judgement


def _note_attempt(folder: Path) -> None:
    """Note in a recording that is kept that its session was recorded once more."""
    with suppress(OSError, ValueError):
        record = read_session(folder)
        record.attempts = record.times_recorded + 1
        write_session(folder, record)


def _undecided_points(result: Result, session: str) -> Decimal:
    checks = (check for criterion in result.criteria for check in criterion.checks)
    return sum((check.undecided for check in checks if check.session == session), Decimal(0))


def _start_afresh(recordings: Path, submission: SubmissionRecord, rubric: Rubric) -> None:
    """Remove what an earlier recording left, and begin with what was handed in."""
    shutil.rmtree(recordings, ignore_errors=True)
    recordings.mkdir(parents=True)
    (recordings / _BEGUN).touch()
    files = kept_lab.files_of(rubric)
    kept_lab.trust(files)
    submission.lab_folder, submission.lab_files = str(rubric.folder), kept_lab.sha256s(files)
    write_submission(recordings, submission)
    replace_files(_rubric_and_files(recordings, rubric))


def undecided_sessions(result: Result, chosen: Sequence[str]) -> list[str]:
    """Return the recorded sessions with a check whose outcome the recording leaves open."""
    checks = [check for criterion in result.criteria for check in criterion.checks]
    undecided = {check.session for check in checks if not check.outcome.decided and check.retry}
    return [session for session in chosen if session in undecided]


def judge_results(results: Path, rubric: Rubric, overrides: Overrides | None = None) -> Result:
    """Run the judging half on a results folder and write `result.json` and `report.html`.

    The rubric is kept with them, if it is another than the submission was recorded with.

    Parameters
    ----------
    overrides : Overrides, optional
        What people decided about single submissions.

    Raises
    ------
    RecordingError
        If there is nothing to judge.
    BoundError
        If judging takes more time or memory than it may.
    """
    judgement = judgement_of(results / RECORDINGS, rubric, overrides or Overrides())
    replace_files(_files_of(judgement, results, rubric))
    return judgement.result


def _files_of(judgement: Judgement, results: Path, rubric: Rubric) -> dict[Path, str | None]:
    page, text = judgement.page, judgement.text
    return {**_rubric_of_result(results, rubric), results / REPORT_FILE: page, results / RESULT_FILE: text}


def judge_with_policy(recordings: Recordings, rubric: Rubric, overrides: Overrides) -> Result:
    """Judge one submission, and adjust the points by what people decided and by the rubric's policy."""
    return by_policy(judge(recordings, rubric), recordings, rubric, overrides)


def by_policy(result: Result, recordings: Recordings, rubric: Rubric, overrides: Overrides) -> Result:
    """Adjust the points of a result by what people decided and by the rubric's policy."""
    submission = recordings.submission
    moment = moment_of(submission.submitted_at)
    return adjust(result, overrides.of(submission.name), rubric.policy.late, moment)


def judge_so_far(results: Path) -> Result:
    """Judge what has been recorded until now of a submission that is still being graded, and write nothing.

    Checks of sessions that have not ended are undecided, and say so.

    Raises
    ------
    RecordingError
        If nothing has been begun there.
    """
    new = results / UNFINISHED
    folder = new if (new / RECORDINGS).is_dir() else results
    rubric = recorded_rubric(rubric_copy(folder))
    overrides = read_overrides(None, results.resolve().parent, rubric, [made_from(folder)])

    def judged() -> Result:
        recordings = open_recordings(folder / RECORDINGS, rubric)
        result = judge_with_policy(recordings, rubric, overrides)
        criteria = [replace(c, checks=tuple(_not_yet_run(k, recordings) for k in c.checks)) for c in result.criteria]
        return replace(result, criteria=tuple(criteria))

    return in_process(judged, JUDGING_BOUND)


def _not_yet_run(check: CheckResult, recordings: Recordings) -> CheckResult:
    if check.session is None or check.session in recordings.sessions or check.outcome.decided:
        return check
    reason = f"Not yet run: the session '{check.session}' has not ended."
    return replace(check, reason=reason)


def report_page(result: Result, recordings: Recordings, rubric: Rubric) -> str:
    """Return the HTML report of a result."""
    from grader.evidence.figures import draw
    from grader.report.html import render

    figures = {}
    with patterns_bounded():
        for criterion in rubric.criteria:
            there = [s for s in criterion.figures if s.session in recordings.sessions]
            drawn = [draw(spec, recordings.sessions[spec.session], rubric.folder) for spec in there]
            figures[criterion.id] = [figure for figure in drawn if figure is not None]
    records = {name: recorded.record for name, recorded in recordings.sessions.items()}
    return render(result, figures, records, recordings.submission)


def chosen_rubric(folders: Sequence[Path], path: Path) -> Rubric:
    """Load a rubric that the user names for results; see `read_rubric`."""
    copies = (copy for folder in folders for copy in _rubric_copies(folder))
    return read_rubric(path, next(copies, None))


def require_lab(results: Path, rubric: Rubric, remedy: str = "Name a rubric of that lab, or none.") -> None:
    """Raise if results are of another lab than a rubric.

    Parameters
    ----------
    remedy : str
        What the user can do about it.

    Raises
    ------
    UsageError
        With both labs.
    """
    recorded = next(map(_lab_id, _rubric_copies(results)), "")
    if recorded not in ("", rubric.lab.id):
        problem = f"these are results of Lab {recorded}, and the rubric is of Lab {rubric.lab.id}"
        raise UsageError(problem, where=str(results), remedy=remedy)


def lab_remarks(results: Path, rubric: Rubric) -> list[str]:
    """Say where results are judged by other files of the lab than they were made with, or the lab has others now."""
    shipped = lab_folder() if rubric.lab.id == _lab_id(lab_folder() / "rubric.yaml") else None
    return kept_lab.remarks(results / RECORDINGS, rubric, shipped)


def rubric_copy(results: Path) -> Path:
    """Return the rubric by which a results folder was judged last.

    Raises
    ------
    RecordingError
        If it is no results folder.
    """
    found = _rubric_copies(results)
    if found:
        return found[0]
    raise RecordingError(
        "there are no recordings to judge" if results.is_dir() else "there is no such folder",
        where=str(results),
        remedy="Give a folder of results, e.g. results/ for a class or results/alice for one submission.",
    )


def _rubric_copies(results: Path) -> list[Path]:
    """Return the rubric of a result, if it was judged by another since, and the one that it was recorded with."""
    return [copy for copy in (results / RUBRIC_COPY, results / RECORDINGS / RUBRIC_COPY) if copy.is_file()]


def keep_rubric(results: Path, rubric: Rubric) -> None:
    """Keep the rubric of a result beside it, if it is not the one with which the submission was recorded."""
    replace_files(_rubric_of_result(results, rubric))


def _rubric_of_result(results: Path, rubric: Rubric) -> dict[Path, str | None]:
    """Return what is to lie beside a result of its rubric, by its place; None for what is not to."""
    recorded, files = results / RECORDINGS / RUBRIC_COPY, kept_lab.files_of(rubric)
    before = {results / kept_lab.KEPT / name: None for name in kept_lab.kept_files(results / RUBRIC_COPY)}
    same = recorded.is_file() and recorded.read_bytes().decode() == rubric.text
    # Earlier versions kept no files.
    if same and kept_lab.kept_files(recorded) in (files, {}):
        return {results / RUBRIC_COPY: None, **before}
    return {**before, **_rubric_and_files(results, rubric)}


def _rubric_and_files(folder: Path, rubric: Rubric) -> dict[Path, str | None]:
    """Return the texts of a rubric and of what it names, by their places, in folders that are there."""
    files = {folder / kept_lab.KEPT / name: text for name, text in kept_lab.files_of(rubric).items()}
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
    return {folder / RUBRIC_COPY: rubric.text, **files}


def report_class(
    results: Path, entries: Sequence[ClassEntry], rubric: Rubric, *, anonymous: bool = False
) -> ClassSummary:
    """Sum up a class and write `index.html` and `grades.csv`, or both under pseudonyms and names of their own.

    Parameters
    ----------
    results : Path
        Folder with a folder of results for each submission, to which the page links.
    entries : sequence of ClassEntry
        Those of `grader.cohort.entries.entries_in`, and what else is known.
    anonymous : bool
        Whether `index-anonymous.html` and `grades-anonymous.csv` are written instead.
    """
    from grader.cohort.anonymous import anonymous as under_pseudonyms
    from grader.cohort.summary import summarise
    from grader.report import class_page, grades_csv

    summary = summarise(under_pseudonyms(entries, rubric) if anonymous else entries, rubric)
    page, grades = (ANONYMOUS_PAGE, ANONYMOUS_GRADES_FILE) if anonymous else (CLASS_PAGE, GRADES_FILE)
    replace_file(results / page, class_page.render(summary, anonymous=anonymous))
    replace_file(results / grades, grades_csv.render(summary))
    return summary


def rubric_of_class(results: Path, entries: Sequence[ClassEntry]) -> Path | None:
    """Return the copy of the rubric by which most of a class were judged; None if there is no copy of it."""
    judged_by = {entry.name: entry.result.rubric_sha256 for entry in entries if entry.result is not None}
    for sha256, _ in Counter(judged_by.values()).most_common():
        for name in (name for name, by in judged_by.items() if by == sha256):
            for copy in _rubric_copies(results / name):
                if hashlib.sha256(copy.read_bytes()).hexdigest() == sha256:
                    return copy
    return None
