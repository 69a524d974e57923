"""The audit trail of replaced results: a line for each in `audit.jsonl`, and each old result in `history/`.

Existing lines and results never change. Both lie beside the submissions' folders.
"""

from __future__ import annotations

import hashlib
import json
from datetime import UTC, datetime
from pathlib import Path

import grader
from grader.cohort.changes import changes_between, plain_changes
from grader.files import replace_file
from grader.result import read_result, result_of_text
from grader.result_folder import AUDIT_FILE, HISTORY, RESULT_FILE

AUDIT_SCHEMA = "ros-lab-grader/audit/v1"


def note_replaced(
    results: Path, name: str, before: str | None, command: str, *, overrides_sha256: str
) -> None:
    """Keep an old result and add a line to the trail; nothing is written if nothing was replaced.

    `before` is the previous text of the submission's `result.json`, `command` the command that replaced it, and the
    hash that of the applied file of overrides, empty without one. Raises RecordingError if the present file is no
    result.
    """
    after = (results / name / RESULT_FILE).read_text(encoding="utf-8")
    # Reading two equal results would take 20 ms.
    if before == after:
        return
    old, new = result_of_text(before), read_result(json.loads(after))
    if old is not None or new.adjustments:
        kept = None
        if old is not None and before is not None:
            kept = keep(results, name, before)
        old_rubric = old.rubric_sha256 if old is not None else None
        old_result = _sha256(before) if before is not None else None
        line = {
            "schema": AUDIT_SCHEMA,
            "at": datetime.now(UTC).isoformat(timespec="seconds"),
            "command": command,
            "grader": grader.__version__,
            "submission": name,
            "overrides_sha256": overrides_sha256 or None,
            "rubric_sha256": [old_rubric, new.rubric_sha256],
            "result_sha256": [old_result, _sha256(after)],
            "kept": kept,
        }
        line |= plain_changes(changes_between(old, new))
        with (results / AUDIT_FILE).open("a", encoding="utf-8", newline="\n") as trail:
            trail.write(json.dumps(line, ensure_ascii=True) + "\n")


def keep(results: Path, name: str, text: str) -> str:
    """Keep the text of a result under its hash; returns the path relative to the results."""
    folder = results / HISTORY / name
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{_sha256(text)[:16]}.json"
    if not path.exists():
        replace_file(path, text)
    return path.relative_to(results).as_posix()


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
