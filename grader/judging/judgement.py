"""Judges recordings by a rubric and by people's decisions, and renders the page, within a bound."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from grader.bounded import Bound, in_process
from grader.errors import BoundError
from grader.evidence.oracle import compiled
from grader.files import text_of
from grader.judging.adjust import adjust
from grader.judging.judge import FULL, Effort, Recordings, judge, open_recordings
from grader.judging.languages import language_of_people, languages_of
from grader.judging.past_scores import with_past
from grader.judging.warming import build_readers, keep_freed_memory
from grader.lab.overrides import Overrides
from grader.lab.patterns import patterns_bounded
from grader.lab.rubric import CriterionSpec, Rubric
from grader.recording.submission import ArtifactFact, FileFact, SubmissionRecord
from grader.report.foxglove import layout_of
from grader.result import Result, result_of_text, to_json
from grader.result_folder import EARLIER_FILE
from grader.submission.submission_time import submission_time_of
from grader.submission.texts import given_texts
from ros_bag.definitions import DefinitionNotFound, definition_of
from ros_bag.elements import MOST_VALUES
from ros_bag.reading import Stream

if TYPE_CHECKING:
    from grader.report.figures.svg import Figure

T = TypeVar("T")

#: Limits of judging one submission, a hundred times the 0.25 s and 20 times the 0.1 GiB of a solution. In a class, a
#: silent process is given up in any case (`classroom.worker`).
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
    empty if no page was wanted.
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
    """Judge recordings in this process; raises RecordingError if none can be judged.

    An earlier result is not judged again, and gets its present adjustments.
    """
    recordings = open_recordings(folder, rubric, effort)
    submission = recordings.submission
    by_rubric = earlier or judge(recordings, rubric)
    submission_time = rubric.policy.zoned(submission_time_of(submission))
    result = adjust(by_rubric, overrides.of(submission.name), rubric.policy.late, submission_time)
    previous = result_of_text(text_of(folder / EARLIER_FILE))
    result = with_past(result, previous)
    if not page:
        return Judgement(by_rubric, result, "", to_json(result))
    shown = report_page(result, recordings, rubric, previous)
    layouts = {name: layout_of(recorded) for name, recorded in recordings.sessions.items()}
    return Judgement(by_rubric, result, shown, to_json(result), layouts)


def judge_bounded(
    folder: Path,
    rubric: Rubric,
    overrides: Overrides,
    *,
    page: bool = True,
) -> Judgement:
    """Judge recordings as `judge_recordings` does, in a process of its own, without the sessions beyond its limits.

    Raises
    ------
    BoundError
        The process exceeds its limits even without these sessions.
    """

    def work(effort: Effort) -> Judgement:
        return judge_recordings(folder, rubric, overrides, page=page, effort=effort)

    try:
        return in_process(partial(work, FULL), JUDGING_BOUND)
    except BoundError:
        return judge_sparingly(work, rubric)


def judge_sparingly(work: Callable[[Effort], T], rubric: Rubric) -> T:
    """Return the work on recordings that are too large: first with fewer values, then without some sessions.

    Each session is tried by itself; a too large session costs the others nothing.
    """
    try:
        return in_process(partial(work, _SPARING), SPARING_BOUND)
    except BoundError:
        pass
    names = frozenset(rubric.sessions)
    too_much = set()
    for name in sorted(names):
        alone = replace(_SPARING, too_much=names - {name})
        if not _is_within_bound(work, alone):
            too_much.add(name)
    some = replace(_SPARING, too_much=frozenset(too_much))
    try:
        return in_process(partial(work, some), SPARING_BOUND)
    except BoundError:
        none = replace(_SPARING, too_much=names)
        return in_process(partial(work, none), SPARING_BOUND)


def _is_within_bound(work: Callable[[Effort], object], effort: Effort) -> bool:
    """Tell whether work succeeds within its limits."""
    try:
        in_process(partial(_done, work, effort), SPARING_BOUND)
    except BoundError:
        return False
    return True


def _done(work: Callable[[Effort], object], effort: Effort) -> None:
    """Do work without sending its outcome back."""
    work(effort)


_SAMPLE = "# Arm\n\nRun `ros2 run arm node`, because best effort loses messages.\n\n- `node.py`: reliable, so slower.\n"
#: Types of the topics that every node has.
_OF_EVERY_NODE = "rcl_interfaces/msg/Log rcl_interfaces/msg/ParameterEvent"
_MESSAGE_TYPE = re.compile(r"\b\w+/msg/\w+")
#: Message types that a Python file imports, such as `from std_msgs.msg import Bool, String`.
_IMPORTED = re.compile(r"^[ \t]*from (\w+)\.msg import ([\w, ]+)", re.MULTILINE)
#: Modules that are imported where they are first used.
_IMPORTED_LATE = (
    "grader.report.submission_page",
    "mcap.stream_reader",
    "numpy.ma",
)
#: Hashes of rubrics. This process, or its parent, is prepared for each.
_prepared: set[str] = set()


def load(rubric: Rubric, naming_types: Iterable[Path] = ()) -> None:
    """Import, read and compile everything that judgements by a rubric need, and judge nothing.

    A fork of this process then has it, and this process takes no more time than the fork saves. Decoders of the installed
    message types that the rubric names are compiled too.

    Parameters
    ----------
    naming_types
        Further files with names of message types, such as a recording of the lab, or its reference nodes.
    """
    for module in _IMPORTED_LATE:
        import_module(module)
    languages_of(rubric, rubric.lab.language)
    _compile_decoders(_message_types(rubric, naming_types))
    _compile_functions(rubric)
    build_readers()


def prepare(rubric: Rubric, naming_types: Iterable[Path] = ()) -> None:
    """Load everything for judgements by a rubric, and judge an empty submission for the parts that only this loads.

    The empty judgement takes 0.1 s, and is of use from the second judgement on. For `naming_types` see `load`.
    """
    if rubric.sha256 in _prepared:
        return
    load(rubric, naming_types)
    keep_freed_memory()
    empty = Recordings(_empty_submission(rubric), {})
    result = judge(empty, rubric)
    result_of_text(to_json(result))
    report_page(result, empty, rubric)
    _prepared.add(rubric.sha256)


def _message_types(rubric: Rubric, files: Iterable[Path]) -> list[str]:
    """Return the message types that are named in the steps of a rubric, and named or imported in some files."""
    texts = [_OF_EVERY_NODE]
    for session in rubric.sessions.values():
        texts += [str(step.parameters) for step in session.steps]
    texts += [file.read_text("utf-8") for file in files]
    text = "\n".join(texts)
    named = set(_MESSAGE_TYPE.findall(text))
    for package, names in _IMPORTED.findall(text):
        for name in names.split(","):
            named.add(f"{package}/msg/{name.strip()}")
    return sorted(named)


def _compile_decoders(types: Iterable[str]) -> None:
    """Decode a message of each installed type."""
    none = np.empty(0, np.int64)
    for name in types:
        with suppress(DefinitionNotFound):
            message = (b"\0\1\0\0",)
            _ = Stream("", name, none, none, none, message, definition_of(name)).messages


def _compile_functions(rubric: Rubric) -> None:
    """Compile the files with the functions of a lab's checks and figures, without executing them."""
    for function in rubric.functions + rubric.functions_of_figures:
        file = function.partition(":")[0]
        # The check reports a mistake in its file.
        with suppress(OSError, SyntaxError, ValueError):
            compiled((rubric.folder / file).read_bytes(), file)


def _empty_submission(rubric: Rubric) -> SubmissionRecord:
    """Return a submission that has one sample file for all artifacts, beside the texts that the lab gave out."""
    texts = {"README.md": _SAMPLE, "node.py": f'"""{_SAMPLE}"""\n'}
    artifacts = [ArtifactFact(name, "node.py", "node.py", "name") for name in rubric.artifacts]
    files = [FileFact(path, len(text), "") for path, text in texts.items()]
    given = given_texts(rubric)
    return SubmissionRecord(
        "nobody", files=files, texts=texts, given_texts=given, artifacts=artifacts
    )


def evidence_of(result: Result, folder: Path, rubric: Rubric, what: str) -> str:
    """Return the page of all evidence about a check, a criterion, or the whole, within the limits of judging."""
    work = partial(_evidence_of, result, folder, rubric, what)
    try:
        return in_process(partial(work, FULL), JUDGING_BOUND)
    except BoundError:
        return judge_sparingly(work, rubric)


def _evidence_of(result: Result, folder: Path, rubric: Rubric, what: str, effort: Effort) -> str:
    from grader.report.evidence_page import render

    recordings = open_recordings(folder, rubric, effort)
    figures = _figures(recordings, rubric)
    return render(result, what, figures, recordings.sessions, recordings.submission)


def report_page(
    result: Result, recordings: Recordings, rubric: Rubric, before: Result | None = None
) -> str:
    """Return the HTML report of a result, with the changes since the student's previous result."""
    from grader.report.submission_page import render

    figures = _figures(recordings, rubric)
    submission = recordings.submission
    return render(
        result,
        figures,
        recordings.sessions,
        submission,
        before,
        rubric.policy.questions_to,
        languages_of(rubric, language_of_people(submission.identity.people, rubric)),
    )


def _figures(recordings: Recordings, rubric: Rubric) -> dict[str, list[Figure]]:
    """Draw the figures of each criterion, by its id."""
    figures = {}
    with patterns_bounded():
        for criterion in (*rubric.criteria, *rubric.bonus):
            figures[criterion.id] = list(_drawn(criterion, recordings, rubric))
    return figures


def _drawn(criterion: CriterionSpec, recordings: Recordings, rubric: Rubric) -> Iterator[Figure]:
    """Draw the figures of a criterion, except those of missing recordings."""
    from grader.report.figures import draw

    for spec in criterion.figures:
        recorded = recordings.sessions.get(spec.session)
        if recorded is None:
            continue
        figure = draw(spec, recorded, rubric.folder)
        if figure is not None:
            yield figure
