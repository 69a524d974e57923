"""Code that the recorded submissions of a class have in common: read, compared within bounds, and kept as a file."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path

from pydantic import TypeAdapter

from grader.bounded import Bound, in_process, in_processes
from grader.cohort.similarity import (
    MOST_NODES,
    Program,
    Similarity,
    copies_of,
    pairs_of,
    program_of,
)
from grader.errors import RecordingError, SubmissionError, described
from grader.files import replace_file
from grader.json_text import json_text
from grader.lab.rubric import Rubric
from grader.recording.submission import SubmissionRecord, read_submission
from grader.result_folder import RECORDINGS, SIMILARITY_FILE
from grader.submission.artifacts import collect_files

#: Bounds for parsing one submission, which takes 0.02 s, and for comparing all, which takes 1 s for 125 submissions.
_READING_BOUND = Bound(what="parsing its files", cpu_s=20.0, wall_s=100.0, memory_bytes=1024**3)
_COMPARING_BOUND = Bound(
    what="comparing the class", cpu_s=600.0, wall_s=1200.0, memory_bytes=4 * 1024**3
)


def common_folders(folders: Sequence[Path], rubric: Rubric, given: Sequence[Path]) -> list[Path]:
    """Return the folders of code that all students were given: the rubric's handout and solution, and given folders.

    The lab's folder is the rubric's, or the folder of a submission's recording. Raises SubmissionError if a given
    folder is missing.
    """
    for folder in given:
        if not folder.is_dir():
            raise SubmissionError(
                "there is no such folder", location=str(folder), remedy="Check --common."
            )
    labs = [rubric.folder]
    for folder in folders[:1]:
        labs.append(Path(read_submission(folder / RECORDINGS).lab_folder))
    common = list(given)
    for name in (rubric.lab.handout, rubric.lab.solution):
        if name:
            there = [lab / name for lab in labs if (lab / name).is_dir()]
            common += there[:1]
    return common


def compare(folders: Sequence[Path], common: Sequence[Path]) -> Similarity:
    """Compare the submissions that were recorded in some folders; a failure of one does not affect the others."""
    programs, problems = [], {}
    works = {folder.name: partial(_program, folder) for folder in folders}
    for name, outcome in in_processes(works, _READING_BOUND):
        if isinstance(outcome, Exception):
            problems[name] = f"Not compared: {described(outcome).problem}"
            continue
        programs.append(outcome)
        if outcome.cut:
            problems[name] = (
                f"Only its smaller files are compared: it has more than {MOST_NODES:,} syntax nodes."
            )
    programs.sort(key=lambda program: program.name)
    given = [_given(folder) for folder in common]
    pairs = in_process(partial(pairs_of, programs, given), _COMPARING_BOUND)
    hashes = {program.name: program.sha256 for program in programs}
    sorted_problems = dict(sorted(problems.items()))
    common_names = tuple(map(str, common))
    copies = tuple(copies_of(programs, given))
    return Similarity(hashes, sorted_problems, common_names, tuple(pairs), copies)


def _program(folder: Path) -> Program:
    record = read_submission(folder / RECORDINGS)
    record.name = folder.name
    return program_of(record)


def _given(folder: Path) -> Program:
    record = SubmissionRecord(folder.name)
    collect_files(folder, record)
    return program_of(record)


# -- similarity.json ---------------------------------------------------------------------------


@cache
def _adapter() -> TypeAdapter[Similarity]:
    return TypeAdapter(Similarity)


def write_similarity(results: Path, similarity: Similarity) -> Path:
    """Write the common code of a class beside its results; returns the file."""
    file = results / SIMILARITY_FILE
    replace_file(file, json_text(_adapter().dump_python(similarity, mode="json")))
    return file


def read_similarity(results: Path) -> Similarity | None:
    """Read the last comparison; returns None if there is none, and raises RecordingError if it cannot be read."""
    file = results / SIMILARITY_FILE
    try:
        return _adapter().validate_json(file.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as problem:
        remedy = f"Run `grade similarity {results}` again, or delete it."
        raise RecordingError(
            f"{file.name} cannot be read", location=str(file), remedy=remedy
        ) from problem
