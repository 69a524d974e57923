"""The catalogues of a lab: translations of its rubric and of the texts of its own checks.

They lie in a folder `languages` beside the rubric, or in its folder `reference`: a file a language, such as `de.po`.
"""

from __future__ import annotations

from pathlib import Path

from grader.lab.kept_lab import is_of_shipped_lab, lab_folder
from grader.lab.rubric import Rubric

_FOLDERS = ("languages", "reference/languages")


def lab_catalogues(rubric: Rubric, tag: str) -> list[Path]:
    """Return the catalogues of a rubric's lab in a language; of the shipped lab for a copy kept with its recordings."""
    beside = _catalogues_in(rubric.folder, tag)
    if beside:
        return beside
    if is_of_shipped_lab(rubric.text):
        return _catalogues_in(lab_folder(), tag)
    return []


def _catalogues_in(lab: Path, tag: str) -> list[Path]:
    """Return the catalogue of a language in the folder of a lab, if there is one."""
    for folder in _FOLDERS:
        path = lab / folder / f"{tag}.po"
        if path.is_file():
            return [path]
    return []
