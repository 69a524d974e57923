"""Judges recordings by a rubric and by people's decisions, and renders the page, within a bound."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from grader.bounded import Bound, in_process
from grader.errors import BoundError
from grader.files import text_of
from grader.judging.adjust import adjust
from grader.judging.judge import FULL, Effort, Recordings, judge, open_recordings
from grader.lab.overrides import Overrides
from grader.lab.patterns import patterns_bounded
from grader.lab.rubric import Rubric
from grader.recording.bag import Stream
from grader.recording.definitions import DefinitionNotFound, definition_of
from grader.recording.elements import MOST_VALUES
from grader.recording.submission import ArtifactFact, FileFact, SubmissionRecord
from grader.report.foxglove import layout_of
from grader.result import Result, result_of_text, to_json
from grader.result_folder import EARLIER_FILE
from grader.submission.submission_time import submission_time_of

if TYPE_CHECKING:
    from grader.report.figures.svg import Figure

T = TypeVar("T")

#: Limits of judging one submission. The solution takes 0.25 s and 0.1 GiB on a core of today; more than a hundred
#: times that is no fair wait. In a class, a process that says nothing is given up in any case (`classroom.worker`).
JUDGING_BOUND = Bound(
    what="judging the submission", cpu_s=30.0, wall_s=100.0, memory_bytes=2 * 1024**3
)
#: Limits of the attempts after that, on all sessions or one, with a tenth of the values of each topic.
SPARING_BOUND = replace(JUDGING_BOUND, cpu_s=10.0, wall_s=40.0)
_SPARING = Effort(most_values=MOST_VALUES // 10)


@dataclass(frozen=True)
class Judgement:
    """The judgement of recordings: by the rubric alone, and after people's decisions and the rubric's policy.

    `text` is `result.json`. `page` is the report, and `layouts` has a layout for Foxglove for each session; both are
    empty where no page was wanted.
    """

    by_rubric: Result
    result: Result
    page: str
    text: str
    layouts: Mapping[str, str] = field(default_factory=dict)


def judge_recordings(
    folder: Path,
    rubric: Rubric,
    overrides: Overrides,
    *,
    page: bool = True,
    earlier: Result | None = None,
    effort: Effort = FULL,
) -> Judgement:
    """Judge recordings in this process; raises RecordingError if there are none that can be judged.

    With an earlier result, nothing is judged again: it gets the adjustments that it has now.
    """
    recordings = open_recordings(folder, rubric, effort)
    by_rubric, submission = earlier or judge(recordings, rubric), recordings.submission
    submission_time = rubric.policy.zoned(submission_time_of(submission))
    result = adjust(by_rubric, overrides.of(submission.name), rubric.policy.late, submission_time)
    if not page:
        return Judgement(by_rubric, result, "", to_json(result))
    layouts = {name: layout_of(recorded) for name, recorded in recordings.sessions.items()}
    shown = report_page(result, recordings, rubric, result_of_text(text_of(folder / EARLIER_FILE)))
    return Judgement(by_rubric, result, shown, to_json(result), layouts)


def judge_bounded(
    folder: Path,
    rubric: Rubric,
    overrides: Overrides,
    *,
    page: bool = True,
) -> Judgement:
    """Do as `judge_recordings` in a process of its own, and leave out what takes more than it may.

    Raises
    ------
    BoundError
        Even without the sessions that take too much, it takes more than it may.
    """

    def work(effort: Effort) -> Judgement:
        return judge_recordings(folder, rubric, overrides, page=page, effort=effort)

    try:
        return in_process(partial(work, FULL), JUDGING_BOUND)
    except BoundError:
        return judge_sparingly(work, rubric)


def judge_sparingly(work: Callable[[Effort], T], rubric: Rubric) -> T:
    """Return what work makes of recordings that are too much: first with fewer values, then without some sessions.

    Each session is tried by itself, so that one that takes too much costs the others nothing.
    """
    try:
        return in_process(partial(work, _SPARING), SPARING_BOUND)
    except BoundError:
        pass
    names = frozenset(rubric.sessions)
    too_much = set()
    for name in sorted(names):
        alone = replace(_SPARING, too_much=names - {name})
        try:
            in_process(partial(_done, work, alone), SPARING_BOUND)
        except BoundError:
            too_much.add(name)
    try:
        return in_process(
            partial(work, replace(_SPARING, too_much=frozenset(too_much))), SPARING_BOUND
        )
    except BoundError:
        return in_process(partial(work, replace(_SPARING, too_much=names)), SPARING_BOUND)


def _done(work: Callable[[Effort], object], effort: Effort) -> None:
    work(effort)


_SAMPLE = "# Arm\n\nRun `ros2 run arm node`, because best effort loses messages.\n\n- `node.py`: reliable, so slower.\n"


def prepare(rubric: Rubric, naming_types: Iterable[Path] = ()) -> None:
    """Judge the submission of nobody, so that what is imported and compiled for it is there for those that follow.

    Copies of this process have it: judging the solution takes 0.3 s of a core then, and 0.5 s without. So they have
    what decodes messages of the installed types that the rubric names, or some files, as of a recording of its lab.
    """
    for module in ("mcap.stream_reader", "numpy.ma"):  # imported where they are first used
        import_module(module)
    spelled = [
        str(step.parameters) for session in rubric.sessions.values() for step in session.steps
    ]
    spelled.append("rcl_interfaces/msg/Log rcl_interfaces/msg/ParameterEvent")  # of every node
    spelled += [file.read_text("utf-8") for file in naming_types]
    none = np.empty(0, np.int64)
    for name in sorted({name for text in spelled for name in re.findall(r"\b\w+/msg/\w+", text)}):
        with suppress(DefinitionNotFound):
            _ = Stream("", name, none, none, none, (b"\0\1\0\0",), definition_of(name)).messages
    texts = {"README.md": _SAMPLE, "node.py": f'"""{_SAMPLE}"""\n'}
    artifacts = [ArtifactFact(name, "node.py", "node.py", "name") for name in rubric.artifacts]
    files = [FileFact(path, len(text), "") for path, text in texts.items()]
    nobody = Recordings(
        SubmissionRecord("nobody", files=files, texts=texts, artifacts=artifacts), {}
    )
    result = judge(nobody, rubric)
    result_of_text(to_json(result))
    report_page(result, nobody, rubric)


def evidence_of(result: Result, folder: Path, rubric: Rubric, what: str) -> str:
    """Return the page of all evidence about a check, a criterion, or the whole; within the bound of judging."""
    work = partial(_evidence_of, result, folder, rubric, what)
    try:
        return in_process(partial(work, FULL), JUDGING_BOUND)
    except BoundError:
        return judge_sparingly(work, rubric)


def _evidence_of(result: Result, folder: Path, rubric: Rubric, what: str, effort: Effort) -> str:
    from grader.report.evidence_page import render

    recordings = open_recordings(folder, rubric, effort)
    return render(
        result, what, _figures(recordings, rubric), recordings.sessions, recordings.submission
    )


def report_page(
    result: Result, recordings: Recordings, rubric: Rubric, before: Result | None = None
) -> str:
    """Return the HTML report of a result, with what changed since the student's result before."""
    from grader.report.submission_page import render

    return render(
        result, _figures(recordings, rubric), recordings.sessions, recordings.submission, before
    )


def _figures(recordings: Recordings, rubric: Rubric) -> dict[str, list[Figure]]:
    """Draw the figures of each criterion, by its id."""
    from grader.report.figures import draw

    figures = {}
    with patterns_bounded():
        for criterion in (*rubric.criteria, *rubric.bonus):
            there = [s for s in criterion.figures if s.session in recordings.sessions]
            drawn = [draw(spec, recordings.sessions[spec.session], rubric.folder) for spec in there]
            figures[criterion.id] = [figure for figure in drawn if figure is not None]
    return figures
