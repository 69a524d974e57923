"""Files of a lab that judging executes, beside the copy of its rubric, and the trust in them.

Recordings travel from a student's CI job to an instructor, and between machines; anybody can have changed their folder.
A file in it is executed only if this machine knows its hash: the file ships with the grader, or the user has graded by a
lab with it, named its rubric with `--rubric`, or passed `--trust-lab`.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import grader
from grader.errors import RecordingError
from grader.recording.submission import read_submission
from ros_bag.interfaces import read_folder

if TYPE_CHECKING:
    from grader.lab.rubric import Rubric

#: The rubric in a lab's folder.
RUBRIC_FILE = "rubric.yaml"
#: Folder beside the copy of a rubric for its files, with their paths beside the rubric itself.
KEPT = "rubric.files"


def lab_folder() -> Path:
    """Return the folder of the lab that travels with the grader: the checkout's root, or inside the package."""
    package = Path(grader.__file__).parent
    inside = package / "shipped_lab"
    if (inside / RUBRIC_FILE).is_file():
        return inside
    return package.parent


def lab_id(rubric: Path) -> str:
    """Return the id of a rubric's lab; empty if it cannot be read."""
    return _id_in(_text(rubric))


def _text(rubric: Path) -> str:
    """Return the text of a rubric; empty if it cannot be read."""
    with suppress(OSError, UnicodeDecodeError):
        return rubric.read_text(encoding="utf-8")
    return ""


@functools.lru_cache(maxsize=16)
def _id_in(text: str) -> str:
    # Imported late, because few commands parse a rubric, and the import takes 8 ms.
    import yaml

    from grader import yaml_text

    with suppress(yaml.YAMLError, RecursionError, ValueError, TypeError, KeyError):
        found = yaml_text.load(text)["lab"]["id"]
        # The text of nested aliases could be endless.
        if isinstance(found, (str, int, float)):
            return str(found)
    return ""


def has_text(copy: Path, rubric: Rubric) -> bool:
    """Tell whether a file holds the text of a rubric, and so the same lab; to parse it for the id takes 40 ms."""
    return _text(copy) == rubric.text


def is_shipped(rubric: Path) -> bool:
    """Return whether a rubric belongs to the lab shipped with the grader."""
    return is_of_shipped_lab(_text(rubric))


def is_of_shipped_lab(text: str) -> bool:
    """Return whether the text of a rubric has the id of the lab shipped with the grader."""
    shipped = _text(lab_folder() / RUBRIC_FILE)
    # To parse a rubric takes longer than to compare it.
    if text == shipped:
        return True
    return _id_in(text) == _id_in(shipped)


def named_files(rubric: Rubric, *, figures: bool = True) -> list[str]:
    """Return the files beside a rubric that it names: programs, oracles and checks of its own, interfaces."""
    functions = rubric.functions
    if figures:
        functions += rubric.functions_of_figures
    files = [spec.file for spec in rubric.reference.values()]
    files += [function.partition(":")[0] for function in functions]
    files += interface_files(rubric)
    return list(dict.fromkeys(files))


def interface_files(rubric: Rubric) -> list[str]:
    """Return the definitions of interfaces, the lab's own and the asked ones, as paths beside the rubric."""
    found = []
    for folder in (rubric.interfaces, rubric.asked_interfaces):
        if folder is not None:
            found += [f"{folder}/{name}" for name in read_folder(rubric.folder / folder)]
    return found


def files_of(rubric: Rubric) -> dict[str, str]:
    """Return the texts of the existing files that a rubric names."""
    return _texts(rubric.folder, named_files(rubric))


def identity_of(rubric: Rubric) -> str:
    """Return the hash of a rubric and of all files that it names, which identifies a lab."""
    stated = {RUBRIC_FILE: rubric.sha256, **sha256s(files_of(rubric))}
    return hashlib.sha256(json.dumps(stated, sort_keys=True).encode()).hexdigest()


def kept_files(copy: Path) -> dict[str, str]:
    """Return the texts of the files beside a copy of a rubric."""
    folder = copy.parent / KEPT
    names = [path.relative_to(folder).as_posix() for path in sorted(folder.rglob("*"))]
    return _texts(folder, names)


def _texts(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Return the texts of files in a folder; links out of it are left out."""
    top = folder.resolve()
    found: dict[str, str] = {}
    for name in names:
        path = folder / name
        if path.resolve().is_relative_to(top) and path.is_file():
            found[name] = path.read_bytes().decode("utf-8", "surrogateescape")
    return found


def sha256s(files: Mapping[str, str]) -> dict[str, str]:
    """Return the hash of each text."""
    found: dict[str, str] = {}
    for name, text in files.items():
        content = text.encode("utf-8", "surrogateescape")
        found[name] = hashlib.sha256(content).hexdigest()
    return found


def trust(files: Mapping[str, str]) -> None:
    """Remember that the user has chosen to execute some files; without a home folder, nothing is remembered."""
    with suppress(OSError, RuntimeError):
        folder = _known_folder()
        folder.mkdir(parents=True, exist_ok=True)
        for sha256 in sha256s(files).values():
            (folder / sha256).touch()


def _is_known(name: str, sha256: str) -> bool:
    for lab in (lab_folder(), *lab_folder().glob("labs/*")):
        hashes = sha256s(_texts(lab, [name]))
        if sha256 in hashes.values():
            return True
    with suppress(OSError, RuntimeError):
        return (_known_folder() / sha256).is_file()
    return False


def _known_folder() -> Path:
    state = os.environ.get("XDG_STATE_HOME")
    if state:
        folder = Path(state)
    else:
        folder = Path.home() / ".local/state"
    return folder / "grade/known-lab-files"


def require_known(copy: Path) -> None:
    """Raise RecordingError if code beside a copy of a rubric may not be executed here."""
    unknown = []
    for name, sha256 in sha256s(kept_files(copy)).items():
        if not _is_known(name, sha256):
            unknown.append(name)
    if unknown:
        raise RecordingError(
            f"{', '.join(unknown)} came with the recordings and is not known on this machine, so it is not executed",
            location=str(copy.parent / KEPT),
            remedy="Name the lab's own rubric by --rubric; or, if you know where the recordings come from, judge them "
            "by `grade regrade --trust-lab`.",
        )


def remarks(recordings: Path, rubric: Rubric) -> list[str]:
    """Report files of the lab that differ between recording and judging, or that changed in the lab afterwards."""
    submission = read_submission(recordings)
    made_with = submission.lab_files
    other = _differing(made_with, sha256s(files_of(rubric)))
    if other:
        return [f"judged by another {other} than it was recorded with"]
    folders = [Path(submission.lab_folder)]
    if is_of_shipped_lab(rubric.text):
        folders.append(lab_folder())
    for lab in folders:
        if lab.is_absolute() and lab.is_dir():
            return _changes(lab, made_with)
    return []


def _changes(lab: Path, made_with: Mapping[str, str]) -> list[str]:
    """Report files of a lab that changed after a recording."""
    changed = _differing(made_with, sha256s(_texts(lab, made_with)))
    if not changed:
        return []
    return [
        f"{changed} in {lab} has changed since it was recorded; name the rubric there by --rubric to judge by it"
    ]


def _differing(made_with: Mapping[str, str], others: Mapping[str, str]) -> str:
    """Name the files with other hashes than at the recording."""
    differing = []
    for name, sha256 in others.items():
        if made_with.get(name, sha256) != sha256:
            differing.append(name)
    return " and ".join(differing)
