"""Validated rubrics, kept in the user's cache: to validate one takes a tenth of a second."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
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
    """A rubric, and the hashes of the files that it named when it was validated."""

    rubric: Rubric
    files: Mapping[str, str]


def validated(path: Path, kinds: Callable[[], Kinds], *folders: Path) -> Rubric:
    """Return the rubric in a file; see `load_rubric`, whose errors it raises.

    A rubric is validated once for its text, the files that it names, the modules of the grader and the installed
    interfaces.
    """
    key = _key(path, folders)
    kept = recalled(_CACHED, key)
    if isinstance(kept, _Validated) and kept.files == sha256s(files_of(kept.rubric)):
        return kept.rubric
    known = kinds()
    rubric = load_rubric(path, known, *folders)
    names = {spec.check for spec in rubric.checks()}
    # Files of earlier built-in checks are those of the shipped lab, not of the rubric.
    if names.isdisjoint(known.former()):
        _complete(rubric)
        keep(_CACHED, key, _Validated(rubric, sha256s(files_of(rubric))))
    return rubric


def _key(path: Path, folders: tuple[Path, ...]) -> tuple[object, ...]:
    """Return all that decides about a rubric besides the files that it names."""
    try:
        content = path.read_bytes()
    except OSError:
        content = b""  # `load_rubric` says why
    interfaces = []
    for folder in share_folders():
        changed_ns = folder.stat().st_mtime_ns if folder.is_dir() else 0
        interfaces.append((str(folder), changed_ns))
    places = [str(folder) for folder in folders or (path.resolve().parent,)]
    return content, places, os.getcwd(), interfaces, state_of_code()


def _complete(rubric: Rubric) -> None:
    """Compute the properties that most judgements need, so that they are kept with the rubric."""
    _ = rubric.functions, rubric.functions_of_figures, rubric.names_in_checks
    for session in rubric.sessions.values():
        for step in session.steps:
            _ = step.parameters
