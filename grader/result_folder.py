"""Names of the files and folders among the results of a submission and of a class."""

from __future__ import annotations

from pathlib import PurePosixPath

RECORDINGS = "recordings"
#: Files in a recording.
LAYOUT_FILE = "foxglove.json"
RUBRIC_COPY = "rubric.yaml"
RESULT_FILE = "result.json"
#: Result of the previous submission, among recordings.
EARLIER_FILE = "earlier.json"
REPORT_FILE = "report.html"
CLASS_PAGE = "index.html"
GRADES_FILE = "grades.csv"
CHANGES_FILE = "changes.csv"
JOURNAL_FILE = "journal.jsonl"
AUDIT_FILE = "audit.jsonl"
#: Decisions by people, beside the folders of the submissions.
OVERRIDES_FILE = "overrides.yaml"
SIMILARITY_FILE = "similarity.json"
HISTORY = "history"
EXPORTED = "exports"
ANONYMOUS_PAGE = "index-anonymous.html"
ANONYMOUS_GRADES_FILE = "grades-anonymous.csv"
#: A rubric changed at the desk.
EDITED_RUBRIC = "rubric-edited.yaml"
#: Last given class list.
CLASS_LIST_FILE = "class-list.csv"

_FOLDERS = frozenset({RECORDINGS, HISTORY, EXPORTED})
#: Kinds of the files in these folders, of exports, and of copies of a lab.
_FILE_KINDS = frozenset(
    {".csv", ".eml", ".files", ".html", ".json", ".jsonl", ".mbox", ".mcap", ".md", ".txt"}
    | {".xml", ".yaml", ".yml", ".zip"}
)


def is_reserved(name: str) -> bool:
    """Tell whether a file or folder with this name among results may be the grader's; no submission has such a name.

    Every name with the ending of a grader file is reserved, e.g. `rubric-edited.yaml` and `Eve.HTML`.
    """
    folded = name.casefold()
    return folded in _FOLDERS or PurePosixPath(folded).suffix in _FILE_KINDS
