"""Validated rubrics, kept in the user's cache: a validation takes a fifth of a second."""

from __future__ import annotations

import os
from collections.abc import Callable, Container, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from grader.lab.kept_lab import files_of, sha256s
from grader.lab.references import Kinds
from grader.lab.rubric import Rubric, load_rubric
from grader.user_cache import keep, recalled, state_of_code
from ros_bag.definitions import share_folders

#: Kind of these values in the cache.
_CACHED = "rubrics"


@dataclass(frozen=True)
class _Validated:
    """A rubric, and the hashes of its files at the time of the validation."""

    rubric: Rubric
    files: Mapping[str, str]


def validated(path: Path, kinds: Callable[[], Kinds], *folders: Path) -> Rubric:
    """Return the rubric in a file; see `load_rubric`, also for its errors.

    A rubric is validated again after a change of its text, its files, the grader, or the installed interfaces.
    """
    key = _key(path, folders)
    kept = recalled(_CACHED, key)
    if isinstance(kept, _Validated):
        files = sha256s(files_of(kept.rubric))
        if files == kept.files:
            return kept.rubric
    known = kinds()
    rubric = load_rubric(path, known, *folders)
    # The shipped lab, not the rubric, names the files of former built-in checks.
    if _uses_one_of(known.former(), rubric):
        return rubric
    _complete(rubric)
    files = sha256s(files_of(rubric))
    validated_now = _Validated(rubric, files)
    keep(_CACHED, key, validated_now)
    return rubric


def _uses_one_of(checks: Container[str], rubric: Rubric) -> bool:
    """Tell whether a rubric uses one of some checks."""
    for spec in rubric.checks():
        if spec.check in checks:
            return True
    return False


def _key(path: Path, folders: tuple[Path, ...]) -> tuple[object, ...]:
    """Return the facts about a rubric for its validation, except its files."""
    places = str(path.resolve().parent)
    if folders:
        places = os.pathsep.join(map(os.path.abspath, folders))
    return path.name, _content(path), places, _installed(), state_of_code()


def _content(path: Path) -> bytes:
    """Return the content of a rubric; empty if it cannot be read."""
    with suppress(OSError):
        return path.read_bytes()
    return b""


def _installed() -> list[tuple[str, int]]:
    """Return the folders with installed interfaces, and the time of their last change."""
    found = []
    for folder in share_folders():
        changed_ns = 0
        with suppress(OSError):
            changed_ns = folder.stat().st_mtime_ns
        found.append((str(folder), changed_ns))
    return found


def _complete(rubric: Rubric) -> None:
    """Compute the properties for most judgements, because they are kept with the rubric."""
    _ = rubric.functions
    _ = rubric.functions_of_figures
    _ = rubric.names_in_checks
    for session in rubric.sessions.values():
        for step in session.steps:
            _ = step.parameters
