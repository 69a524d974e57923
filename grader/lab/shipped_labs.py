"""Labs of the grader's package: their names, their files, and the extras for their programs."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from grader.extras import EXTRAS, missing_extra
from grader.lab.kept_lab import RUBRIC_FILE, lab_folder, lab_id

if TYPE_CHECKING:
    from grader.lab.rubric import Rubric

#: Schema of rubrics for editors, in the folder of the default lab.
SCHEMA_FILE = "rubric.schema.json"
#: Folder of the other labs, in the folder of the default lab.
_OTHERS = "labs"
#: Sample submission for the default lab, beside its rubric.
_SAMPLE = "submissions/alice"
#: Folders of the default lab beside its rubric, which stands in the folder of a checkout, if there is one.
_DEFAULT_FOLDERS = ("reference",)
_NOT_COPIED = shutil.ignore_patterns("__pycache__", "tried", ".gitignore")
#: A module at the beginning of an import, e.g. `mujoco` in `from mujoco.viewer import launch`.
_IMPORT = re.compile(r"^[ \t]*(?:import|from)[ \t]+(\w+)", re.MULTILINE)
#: The schema's place in the first line of a rubric, e.g. `$schema=../../rubric.schema.json`.
_SCHEMA_PLACE = re.compile(rf"\$schema=[./]*{re.escape(SCHEMA_FILE)}")


def shipped_labs() -> dict[str, Path]:
    """Return the folders of the shipped labs by their names; the default lab is the first."""
    default = lab_folder()
    labs = {lab_id(default / RUBRIC_FILE): default}
    for rubric in sorted((default / _OTHERS).glob(f"*/{RUBRIC_FILE}")):
        labs[rubric.parent.name] = rubric.parent
    return labs


def sample_submission() -> Path:
    """Return the folder of the sample submission for the default lab."""
    return lab_folder() / _SAMPLE


def copy_lab(name: str, target: Path) -> None:
    """Copy a shipped lab into a folder, with the schema of rubrics beside its own."""
    source = shipped_labs()[name]
    if source == lab_folder():
        target.mkdir(parents=True, exist_ok=True)
        for part in _DEFAULT_FOLDERS:
            shutil.copytree(source / part, target / part, ignore=_NOT_COPIED)
        shutil.copyfile(source / RUBRIC_FILE, target / RUBRIC_FILE)
    else:
        shutil.copytree(source, target, ignore=_NOT_COPIED, dirs_exist_ok=True)
    shutil.copyfile(lab_folder() / SCHEMA_FILE, target / SCHEMA_FILE)
    rubric = target / RUBRIC_FILE
    text = rubric.read_text(encoding="utf-8")
    text = _SCHEMA_PLACE.sub(f"$schema={SCHEMA_FILE}", text, count=1)
    rubric.write_text(text, encoding="utf-8")


def require_extras(rubric: Rubric) -> None:
    """Raise PlatformError if a program of the lab imports a module of a missing extra."""
    for module in EXTRAS.keys() & set(_imported(rubric)):
        if find_spec(module) is None:
            raise missing_extra(module)


def _imported(rubric: Rubric) -> Iterator[str]:
    """Yield the modules in the imports of reference programs, and of the files beside these."""
    folders = set()
    for spec in rubric.reference.values():
        folders.add((rubric.folder / spec.file).parent)
    for folder in sorted(folders):
        for file in sorted(folder.glob("*.py")):
            yield from _IMPORT.findall(file.read_text(encoding="utf-8", errors="replace"))
