"""The names of what lies in a folder of results: a submission's, and a class's around it."""

from __future__ import annotations

RECORDINGS = "recordings"
#: In a recording.
LAYOUT_FILE = "foxglove.json"
RUBRIC_COPY = "rubric.yaml"
RESULT_FILE = "result.json"
#: Among recordings: the result of the submission before this one.
EARLIER_FILE = "earlier.json"
REPORT_FILE = "report.html"
CLASS_PAGE = "index.html"
GRADES_FILE = "grades.csv"
CHANGES_FILE = "changes.csv"
JOURNAL_FILE = "journal.jsonl"
AUDIT_FILE = "audit.jsonl"
SIMILARITY_FILE = "similarity.json"
HISTORY = "history"
EXPORTED = "exports"
ANONYMOUS_PAGE = "index-anonymous.html"
ANONYMOUS_GRADES_FILE = "grades-anonymous.csv"
