"""Examination of a lab before it is used, and of its checks by the recording of its solution."""

from __future__ import annotations

import contextlib
import inspect
import io
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from confine.interpreters import OWN_INTERPRETER
from confine.scratch import scratch_prefix
from grader import yaml_text
from grader.bounded import Bound, in_process
from grader.checks.own import built, load_own
from grader.classroom.expectations import EXPECTED_FILE, left_to_a_person, load_fixture
from grader.errors import RecordingError, RubricError
from grader.evidence.oracle import describe_failure, load_file, load_oracle
from grader.evidence.recorded import Recorded
from grader.judging.judge import Recordings, judge, open_recordings
from grader.judging.judgement import JUDGING_BOUND, judge_recordings
from grader.lab.kept_lab import files_of
from grader.lab.lab_code import OwnParameters
from grader.lab.overrides import Overrides
from grader.lab.rubric import Rubric, functions_of
from grader.lab.steps.start import StartStep
from grader.lab.yaml_with_lines import Fault, Loc, parse_yaml
from grader.live.interfaces.build import provide, shipped_for
from grader.live.sandbox.probing import probe_isolation
from grader.recording.session import SessionRecord
from grader.report.views import points
from grader.result import CheckResult, Outcome, Result
from grader.result_folder import RECORDINGS, RUBRIC_COPY
from grader.submission.file_names import tool_folder
from ros_bag.reading import Bag

#: Bounds for importing the files of a lab.
_IMPORT_BOUND = Bound(
    "importing the lab's files", cpu_s=30.0, wall_s=60.0, memory_bytes=2 * 1024**3
)
_REMEDY = "`grade checks`, `grade steps` and `grade figures` list what can be used."


@dataclass(frozen=True)
class Remark:
    """A finding: "✓" in order, "!" a warning."""

    sign: str
    text: str


def examine(rubric: Rubric, rubric_file: Path, tried: Path) -> Iterator[Remark]:
    """Examine a lab with a valid rubric; raises RubricError with all mistakes in its files, each with its line.

    `tried` has results of its solution, if there are any.
    """
    _, mistakes = parse_yaml(rubric_file, rubric.text, "the lab")
    with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as built:
        not_built = _with_interfaces(rubric, Path(built))
        code = in_process(partial(_code_mistakes, rubric, Path(built), not_built), _IMPORT_BOUND)
    for loc, words in (*_pattern_mistakes(rubric), *_solution_mistakes(rubric), *code):
        mistakes.add(loc, words)
    listed = [words for _, words in sorted(mistakes.found)]
    listed += _fixture_mistakes(rubric)
    if listed:
        problem = f"the lab has {len(listed)} mistake{'s' * (len(listed) != 1)}"
        raise RubricError(problem, listed, location=str(rubric.folder), remedy=_REMEDY)
    count = f"Points: {points(rubric.lab.points)}, checks: {len(list(rubric.checks()))}."
    yield Remark("✓", f"The rubric and all that it names are in order. {count}")
    if rubric.reference and find_spec("rclpy") is None:
        yield Remark("!", "ROS is not installed here: the reference nodes were not imported.")
    if rubric.lab.solution is None:
        yield Remark(
            "!",
            "The rubric names no solution (lab.solution), which would show that all points can be earned.",
        )
    yield from _by_recording(rubric, tried)


# -- files -----------------------------------------------------------------------------------------


def _pattern_mistakes(rubric: Rubric) -> Iterator[Fault]:
    """Find patterns of files that are never taken from a submission, because tools make their folders."""
    for name, spec in rubric.artifacts.items():
        for n, pattern in enumerate(spec.find):
            made = tool_folder(tuple(pattern.split("/")))
            if made is not None:
                words = f"{pattern!r} matches nothing: files in {made}/ are left out of every submission"
                yield ("artifacts", name, "find", n), words


def _solution_mistakes(rubric: Rubric) -> Iterator[Fault]:
    folder = rubric.folder / (rubric.lab.solution or "")
    if not folder.is_dir():
        yield ("lab", "solution"), f"there is no folder {rubric.lab.solution!r} beside the rubric"
        return
    if not rubric.lab.solution:
        return
    for name, artifact in rubric.artifacts.items():
        if name not in rubric.bonus_artifacts and not any(folder.rglob(artifact.file)):
            yield ("artifacts", name, "file"), f"there is no {artifact.file} in the solution"


def _fixture_mistakes(rubric: Rubric) -> Iterator[str]:
    for path in sorted((rubric.folder / "fixtures").glob(f"*/{EXPECTED_FILE}")):
        try:
            load_fixture(path.parent, rubric)
        except RubricError as error:
            folder = path.parent.relative_to(rubric.folder)
            for mistake in error.mistakes:
                yield f"{folder}/{mistake}"


def _with_interfaces(rubric: Rubric, folder: Path) -> Collection[str]:
    """Put the interfaces that reference nodes import into a folder; returns packages that cannot be built."""
    texts = files_of(rubric)
    imports: list[str] = []
    for spec in rubric.reference.values():
        lines = texts.get(spec.file, "").splitlines()
        imports += [line for line in lines if line.startswith(("import ", "from "))]
    ours = [] if find_spec("rclpy") is None else rubric.interface_packages
    if any(package.name in line for package in ours for line in imports):
        ours = ours
    else:
        ours = []
    needed = [*ours, *shipped_for(imports)]
    if needed:
        return provide(needed, folder, probe_isolation(OWN_INTERPRETER)).missing
    return ()


def _code_mistakes(rubric: Rubric, built: Path, not_built: Collection[str]) -> list[Fault]:
    """Execute the lab's files, and return their mistakes, in a process that ends afterwards."""
    # A program without a guard finds no configuration, and ends.
    sys.argv = sys.argv[:1]
    sys.path += map(str, built.glob("*/lib/python*/site-packages"))
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        works = _works(rubric)
        found = []
        for loc, work, named in works:
            words = _failure(loc, work, named, not_built)
            if words:
                found.append((words, loc))
    # A mistake of a file is reported at its first place in the rubric.
    return [(loc, words) for words, loc in dict(reversed(found)).items()]


def _failure(loc: Loc, work: Callable[[], object], named: str, not_built: Collection[str]) -> str:
    try:
        work()
    # A program can end; a file of checks would end the judging.
    except SystemExit as end:
        if loc[0] in ("criteria", "bonus"):
            return describe_failure(end, named)
        return ""
    except Exception as problem:
        module = ""
        if isinstance(problem, ModuleNotFoundError):
            module = getattr(problem, "name", None) or ""
        if module.partition(".")[0] in not_built:
            return ""
        return describe_failure(problem, named)
    return ""


def _works(rubric: Rubric) -> Iterator[tuple[Loc, Callable[[], object], str]]:
    """Yield the attempts for each file: its place in the rubric, the work, and the file."""
    folder = rubric.folder
    if find_spec("rclpy") is not None:
        for name, spec in rubric.reference.items():
            yield ("reference", name, "file"), partial(load_file, folder, spec.file), spec.file
    for session in rubric.sessions.values():
        for n, step in enumerate(session.steps):
            start = step.step
            if not isinstance(start, StartStep) or start.reference is None:
                continue
            settings = rubric.reference[start.reference].settings
            if settings is not None:
                step_loc = ("sessions", session.id, "steps", n, step.kind)
                yield step_loc, partial(_settle, folder, settings, start.with_), settings
    for key, criteria in (("criteria", rubric.criteria), ("bonus", rubric.bonus)):
        for n, criterion in enumerate(criteria):
            for kind, parts in (("checks", criterion.checks), ("figures", criterion.figures)):
                for m, part in enumerate(parts):
                    loc = (key, n, kind, m, "with")
                    yield from _works_of(folder, loc, part)


def _works_of(folder: Path, loc: Loc, part: Any) -> Iterator[tuple[Loc, Callable[[], object], str]]:
    """Yield the attempts for the functions of a check or figure."""
    for function in functions_of(part):
        yield loc, partial(_call, folder, function, part), function


def _settle(folder: Path, settings: str, values: dict[str, Any]) -> None:
    load_oracle(folder, settings)(**values)


def _call(folder: Path, function: str, part: Any) -> None:
    """Load a function and check that it can be called; an oracle takes streams, parameters and a seed.

    Other functions of a lab's own check are called by the check itself.
    """
    if not isinstance(part.parameters, OwnParameters):
        inspect.signature(load_oracle(folder, function)).bind({}, {}, 0)
    elif function == part.check:
        built(load_own(folder, function), part.parameters)


# -- the solution's recording ----------------------------------------------------------------------


def _by_recording(rubric: Rubric, tried: Path) -> Iterator[Remark]:
    """Yield the checks that the solution does not pass, and checks that an idle submission passes."""
    recordings = tried / RECORDINGS
    outdated = _outdated(rubric, recordings)
    if outdated:
        yield Remark("!", outdated)
        return
    try:
        result = in_process(partial(_judged, recordings, rubric), JUDGING_BOUND)
        idle = in_process(partial(_judged_idle, recordings, rubric), JUDGING_BOUND)
    except RecordingError as error:
        yield Remark(
            "!", f"The solution's recording cannot be judged: {error.problem} {error.remedy}"
        )
        return
    yield from _absent_bonus(result, rubric)
    by_person = left_to_a_person(rubric)
    wrong = [*_lost(result, by_person), *_free(idle), *_broken(idle)]
    yield from wrong
    if not wrong:
        yield Remark(
            "✓",
            "On the solution's recording every check passes, and where nothing happens none does.",
        )


def _outdated(rubric: Rubric, recordings: Path) -> str:
    """Report missing recordings of the solution, or recordings of other sessions; empty otherwise."""
    try:
        recorded = _experiments((recordings / RUBRIC_COPY).read_text(encoding="utf-8"))
    except OSError:
        return "The solution has not been recorded yet: `grade lab try` does it, and more can be told then."
    if recorded != _experiments(rubric.text):
        return "The sessions have changed since the solution was recorded; `grade lab try` records it again."
    return ""


def _absent_bonus(result: Result, rubric: Rubric) -> Iterator[Remark]:
    """Yield a remark if the solution lacks a part of the bonus."""
    there = {criterion.id for criterion in result.bonus}
    absent = [criterion.id for criterion in rubric.bonus if criterion.id not in there]
    if absent:
        yield Remark(
            "!",
            f"The solution holds nothing of the bonus {', '.join(absent)}, so that this is not examined.",
        )


def _lost(result: Result, by_person: Collection[str]) -> Iterator[Remark]:
    """Yield each check that the solution does not pass, except checks by a person."""
    for check in result.every_check:
        if check.outcome is Outcome.PASSED or check.id in by_person:
            continue
        outcome = check.outcome.value.replace("_", " ")
        found = f"{outcome}; expected {check.expected}, found {check.measured}"
        why = check.reason or found
        yield Remark("!", f"{check.id} does not pass on the solution's recording: {why}")


def _free(idle: Sequence[CheckResult]) -> Iterator[Remark]:
    """Yield each check in which an idle submission earns points."""
    for check in idle:
        if check.earned:
            words = f"{check.id} earns {points(check.earned)} points also where nothing happens"
            yield Remark("!", f"{words}: let it require a check that fails then, or ask for more.")


def _broken(idle: Sequence[CheckResult]) -> Iterator[Remark]:
    """Yield each check that fails with an error for an idle submission."""
    for check in idle:
        if check.outcome is Outcome.ERROR:
            yield Remark(
                "!",
                f"{check.id} fails with an error where nothing happens, so that it costs nobody: {check.reason}",
            )


def _experiments(rubric: str) -> list[Any]:
    plain = yaml_text.load(rubric)
    return [plain.get(key) for key in ("artifacts", "reference", "sessions")]


def _judged(recordings: Path, rubric: Rubric) -> Result:
    return judge_recordings(recordings, rubric, Overrides()).by_rubric


def _judged_idle(recordings: Path, rubric: Rubric) -> list[CheckResult]:
    """Judge the recordings as if the programs had started and done nothing, and as if no files had been submitted."""
    found = open_recordings(recordings, rubric)
    sessions = {}
    for name, recorded in found.sessions.items():
        sessions[name] = Recorded(_idle(recorded.record), Bag.empty())
    nobody = replace(found.submission, files=[], texts={}, packages=[], artifacts=[])
    idle = judge(replace(found, sessions=sessions), rubric)
    empty = judge(Recordings(nobody, {}), rubric)
    of_sessions = [check for check in idle.every_check if check.session is not None]
    of_files = [check for check in empty.every_check if check.session is None]
    return [*of_sessions, *of_files]


def _idle(record: SessionRecord) -> SessionRecord:
    silent = [replace(process, output=[]) for process in record.processes]
    empty = [replace(graph, nodes=[], endpoints=[], services=[]) for graph in record.graph]
    steps = []
    for step in record.steps:
        if step.kind != "observe":
            step = replace(step, outcome="timeout", result={})
        steps.append(step)
    return replace(
        record,
        processes=silent,
        graph=empty,
        steps=steps,
        names={},
        claims=[],
        plan=None,
        published=[],
        unrecorded=[],
    )
