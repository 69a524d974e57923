"""The stages of grading, a line each: `record` (the live half) and `judge_results` (the judging half)."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import platform
import random
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import grader
from grader.checks import PARAMETERS_OF
from grader.errors import PlatformError, RecordingError, RubricError
from grader.judging import Recordings, judge, judge_checks, open_recordings
from grader.recording.submission import SubmissionRecord, write_submission
from grader.report import json as result_json
from grader.result import Result
from grader.rubric import Rubric, load_rubric
from grader.submission import read_submission_folder

RECORDINGS = "recordings"
RUBRIC_COPY = "rubric.yaml"
RESULT_FILE = "result.json"
REPORT_FILE = "report.html"
#: How often a session whose checks are undecided is recorded again, alone.
RETRIES = 2


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
    """

    interpreter: Path
    sessions: Sequence[str] | None = None
    seed: int | None = None
    jobs: int | None = None
    launch: str = "standin"


def lab_folder() -> Path:
    """Return the folder of the lab that travels with the grader: the checkout's root, or inside the package."""
    package = Path(grader.__file__).parent
    inside = package / "lab"
    return inside if (inside / "rubric.yaml").is_file() else package.parent


def read_rubric(path: Path | None) -> Rubric:
    """Load a rubric, by default that of the lab which travels with the grader.

    Raises
    ------
    RubricError
        With all its mistakes.
    """
    return load_rubric(path or lab_folder() / "rubric.yaml", PARAMETERS_OF, lab_folder())


def require_platform() -> None:
    """Raise unless ROS 2 nodes can run here.

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


def versions() -> dict[str, str]:
    """Return the versions that a recording keeps."""
    named = {"grader": grader.__version__, "python": platform.python_version(), "kernel": platform.release()}
    for package in ("ros-jazzy-rclpy", "ros-fastrtps", "ros-rmw-fastrtps-cpp", "mcap", "rosbags", "numpy"):
        try:
            named[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            named[package] = "not installed"
    return named


def chosen_sessions(rubric: Rubric, options: Options, submission: SubmissionRecord) -> list[str]:
    """Return the sessions to run: those chosen whose first file was handed in.

    Raises
    ------
    RubricError
        If a session is chosen that the rubric does not have.
    """
    unknown = [s for s in options.sessions or () if s not in rubric.sessions]
    if unknown:
        raise RubricError(
            f"there is no session {unknown[0]!r}",
            [],
            remedy=f"Sessions of this rubric are {', '.join(rubric.sessions)}.",
        )
    there = {a.name for a in submission.artifacts if a.path is not None}
    wanted = options.sessions if options.sessions is not None else list(rubric.sessions)
    return [s for s in wanted if not rubric.sessions[s].needs or rubric.sessions[s].needs[0] in there]


def grade(folder: Path, rubric: Rubric, results: Path, options: Options, on_progress: Callable[..., None]) -> Result:
    """Grade one submission: record, judge, run undecided sessions again, report.

    Parameters
    ----------
    folder : Path
        The submission.
    results : Path
        Folder of this submission's results.

    Raises
    ------
    GraderError
        If no fair score exists; nothing is written then.
    """
    require_platform()
    submission = read_submission_folder(folder, rubric)
    submission.sessions = list(options.sessions) if options.sessions is not None else None
    record(folder, submission, rubric, results, options, on_progress)
    return judge_results(results, rubric)


def record(
    folder: Path,
    submission: SubmissionRecord,
    rubric: Rubric,
    results: Path,
    options: Options,
    on_progress: Callable[..., None],
) -> None:
    """Run the live half: stage, isolate, run the sessions, and again those whose checks are undecided."""
    from grader.live.cells import Progress, Sessions
    from grader.live.isolation import probe_isolation
    from grader.live.ros_launch import LaunchChoice, find_native_launch
    from grader.live.stage import stage

    native = find_native_launch(options.interpreter, LaunchChoice(options.launch))
    recordings = results / RECORDINGS
    chosen = chosen_sessions(rubric, options, submission)
    for name in options.sessions or rubric.sessions:
        if name not in chosen:
            on_progress(Progress(name, "left out, since its file is missing", ended=True))
    _start_afresh(results, recordings, submission, rubric)
    with tempfile.TemporaryDirectory(prefix="grade-stage-") as scratch:
        workspace = stage(folder, submission, rubric, Path(scratch), str(options.interpreter))
        sessions = Sessions(
            rubric,
            submission,
            workspace.folder,
            workspace.executables,
            recordings,
            probe_isolation(options.interpreter),
            options.interpreter,
            options.seed if options.seed is not None else random.SystemRandom().randrange(2**31),
            versions() | {"launch": "native" if native is not None else "stand-in"},
            native,
        )
        sessions.record(chosen, on_progress, at_a_time=options.jobs)
        for attempt in range(2, RETRIES + 2):
            undecided = undecided_sessions(open_recordings(recordings, rubric), rubric, chosen)
            if not undecided:
                break
            replace(sessions, attempt=attempt).record(undecided, on_progress, at_a_time=1)


def _start_afresh(results: Path, recordings: Path, submission: SubmissionRecord, rubric: Rubric) -> None:
    """Remove what an earlier grading left, so that no old result can be taken for a new one."""
    for name in (RESULT_FILE, REPORT_FILE):
        (results / name).unlink(missing_ok=True)
    shutil.rmtree(recordings, ignore_errors=True)
    recordings.mkdir(parents=True)
    write_submission(recordings, submission)
    (recordings / RUBRIC_COPY).write_text(rubric.text, encoding="utf-8")


def undecided_sessions(recordings: Recordings, rubric: Rubric, chosen: Sequence[str]) -> list[str]:
    """Return the recorded sessions with a check whose outcome the recording leaves open."""
    findings = judge_checks(recordings, rubric)
    open_checks = [
        c
        for c in rubric.checks()
        if c.id in findings and not findings[c.id].outcome.decided and not _by_file(findings[c.id].reason)
    ]
    return [s for s in chosen if any(c.session == s for c in open_checks)]


def _by_file(reason: str) -> bool:
    """Whether a finding is open for a reason that another run cannot change, or only because another one is."""
    return reason.startswith(("The grader cannot evaluate", "It hangs on"))


def judge_results(results: Path, rubric: Rubric) -> Result:
    """Run the judging half on a results folder and write `result.json` and `report.html`.

    Raises
    ------
    RecordingError
        If there is nothing to judge.
    """
    recordings = open_recordings(results / RECORDINGS, rubric)
    result = judge(recordings, rubric)
    _replace(results / REPORT_FILE, report_page(result, recordings, rubric))
    _replace(results / RESULT_FILE, result_json.render(result))
    return result


def report_page(result: Result, recordings: Recordings, rubric: Rubric) -> str:
    """Return the HTML report of a result."""
    from grader.evidence.figures import draw
    from grader.report.html import render

    figures = {}
    for criterion in rubric.criteria:
        there = [s for s in criterion.figures if s.session in recordings.sessions]
        drawn = [draw(spec, recordings.sessions[spec.session], rubric.folder) for spec in there]
        figures[criterion.id] = [figure for figure in drawn if figure is not None]
    records = {name: recorded.record for name, recorded in recordings.sessions.items()}
    return render(result, figures, records, recordings.submission)


def regrade(results: Path, rubric_path: Path | None) -> Result:
    """Judge a results folder again, by default with the rubric that it was recorded with.

    Raises
    ------
    RecordingError
        If it is no results folder.
    """
    copy = results / RECORDINGS / RUBRIC_COPY
    if not copy.is_file():
        raise RecordingError(
            "there are no recordings to judge",
            where=str(results),
            remedy="Give the folder of one submission's results, e.g. results/alice.",
        )
    return judge_results(results, read_rubric(rubric_path or copy))


def _replace(path: Path, text: str) -> None:
    partial = path.with_suffix(path.suffix + ".partial")
    partial.write_text(text, encoding="utf-8", newline="\n")
    partial.replace(path)
