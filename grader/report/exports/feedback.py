"""`feedback.zip`: the reports, under names by which the system of the submissions gives each to its student.

References
----------
Moodle: `mod/assign/feedback/file/importziplib.php` in moodle/moodle: a folder, or the beginning of a file's name, is
that of its download; the file keeps its own name.
Canvas: `infer_comment_context_from_filename` in `app/models/abstract_assignment.rb` of instructure/canvas-lms: a file
is named as in its download, and becomes a comment's attachment under the name of the student's file. It must therefore
be of the same kind as the student's file.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import PurePosixPath

from grader.cohort.entries import ClassEntry
from grader.languages.language import Language, Languages
from grader.report.exports.returned import Returned, ReturnedClass, plain_report
from grader.result import Result
from grader.result_folder import REPORT_FILE
from grader.submission.file_names import TEXT_SUFFIXES

_EARLIEST = (1980, 1, 1, 0, 0, 0)
_OPEN_ENDS = ("/", "_")


def render(given: ReturnedClass) -> Returned:
    """Return the archive; a submission with several possible names is in it once, under the first that fits."""
    returned = Returned()
    files: dict[str, bytes] = {}
    for entry in given.entries:
        report = given.report(entry)
        if entry.result is None or report is None:
            why = "there is no report"
        elif not entry.identity.handback:
            system = entry.identity.system or "the way in which they came"
            why = f"{system} takes no files back in an archive; `--to mail` makes mails"
        elif file := _file(entry, entry.result, report, _language_of(entry, given.languages)):
            files |= file
            continue
        else:
            why = "the report fits no kind of file that they handed in; `--to mail` makes mails"
        returned.left_out[why].append(entry.name)
    returned.content = packed(files)
    returned.count = len(files)
    return returned


def packed(files: Mapping[str, bytes]) -> bytes:
    """Return a zip archive of files; equal files give equal bytes."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as zipped:
        for name, content in sorted(files.items()):
            info = zipfile.ZipInfo(name, _EARLIEST)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            zipped.writestr(info, content)
    return archive.getvalue()


def _language_of(entry: ClassEntry, languages: Languages) -> Language:
    """Return the language that all people of a submission have; the first one shown if they differ."""
    tags = {person.language for person in entry.people}
    return languages.of(tags.pop() if len(tags) == 1 else "")


def _file(entry: ClassEntry, result: Result, report: bytes, language: Language) -> dict[str, bytes]:
    """Return the returned file under its name; none if no name fits, or all of them lead elsewhere."""
    safe = filter(_stays_inside, entry.identity.handback)

    def is_single(path: str) -> bool:
        return not path.lower().endswith((*_OPEN_ENDS, ".zip"))

    # Folders and archives first: they take the report as it is.
    for path in sorted(safe, key=is_single):
        if path.endswith(_OPEN_ENDS):
            return {path + REPORT_FILE: report}
        if path.lower().endswith(".zip"):
            return {path: packed({REPORT_FILE: report})}
        if PurePosixPath(path).suffix.lower() in TEXT_SUFFIXES:
            return {path: plain_report(result, language).encode()}
    return {}


def _stays_inside(path: str) -> bool:
    """Tell whether a path leads to a place below the folder of its archive, and can be written."""
    if not path.isprintable() or "\\" in path:
        return False
    parts = path.removesuffix("/").split("/")
    return {"", ".", ".."}.isdisjoint(parts)
