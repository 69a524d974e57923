"""The catalogues of a lab: translations of its rubric and of the texts of its own checks.

They lie in a folder `languages` beside the rubric, or in its folder `reference`: a file a language, such as `de.po`.
"""

from __future__ import annotations

from pathlib import Path

from grader.lab.kept_lab import RUBRIC_FILE, lab_folder, lab_id
from grader.lab.rubric import Rubric

_FOLDERS = ("languages", "reference/languages")


def lab_catalogues(rubric: Rubric, tag: str) -> list[Path]:
    """Return the catalogues of a rubric's lab in a language; of the shipped lab for a copy kept with its recordings."""
    places = [rubric.folder]
    shipped = lab_folder()
    if rubric.lab.id == lab_id(shipped / RUBRIC_FILE):
        places.append(shipped)
    for place in places:
        for folder in _FOLDERS:
            path = place / folder / f"{tag}.po"
            if path.is_file():
                return [path]
    return []
