"""Classes with results to return: made-up results beside the intake of real names in downloads."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from grader.cohort.entries import entries_in
from grader.json_text import json_text
from grader.lab.rubric import Rubric
from grader.recording.submission import SubmissionRecord, write_submission
from grader.report.exports.returned import ReturnedClass
from grader.result_folder import RECORDINGS, REPORT_FILE, RESULT_FILE
from grader.submission.discovery import find_submissions
from grader.submission.extraction import SubmissionSource
from tests.cohort.made_up import result_of, rubric_of

LAB = rubric_of(("pub.topic", 60), ("doc.readme", 40))


def laid_out(tmp_path: Path, names: Iterable[str]) -> Path:
    """Lay a download out; zips in it hold a file."""
    for name in names:
        path = tmp_path / "download" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".zip":
            with zipfile.ZipFile(path, "w") as packed:
                packed.writestr("joint_publisher.py", name)
        else:
            path.write_text(name, encoding="utf-8")
    return tmp_path / "download"


def taken_in(
    tmp_path: Path, rubric: Rubric, names: Iterable[str], class_list: str = ""
) -> list[SubmissionSource]:
    """Take a download in, with a class list if one is given."""
    listed = None
    if class_list:
        listed = tmp_path / "class.csv"
        listed.write_text(class_list, encoding="utf-8")
    return list(
        find_submissions([laid_out(tmp_path, names)], rubric, class_list=listed).submissions
    )


def results_of(
    tmp_path: Path, sources: Iterable[SubmissionSource], reasons: Mapping[str, str] | None = None
) -> Path:
    """Write results as a grading leaves them: the n-th submission has all of the first check, and n % of the other."""
    results = tmp_path / "results"
    for n, source in enumerate(sources, 1):
        folder = results / source.name
        (folder / RECORDINGS).mkdir(parents=True)
        plain = result_of(LAB, [1, n / 100], dict(reasons or {})) | {"submission": source.name}
        (folder / RESULT_FILE).write_text(
            json_text(json.loads(json.dumps(plain))), encoding="utf-8"
        )
        (folder / REPORT_FILE).write_text(f"<p>Report of {source.name}", encoding="utf-8")
        record = SubmissionRecord(
            source.name, student_id=source.student_id, identity=source.identity
        )
        write_submission(folder / RECORDINGS, record)
    return results


def given_back(
    tmp_path: Path, sources: Iterable[SubmissionSource], column: str = "", sender: str = ""
) -> ReturnedClass:
    """Give a class of submissions with the points 60.4, 60.8, 61.2 and so on."""
    results = results_of(tmp_path, sources)
    return ReturnedClass(entries_in(results), results, column, sender)
