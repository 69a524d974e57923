"""Sources of students in any language that the grader reads."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath

from grader.evidence.text.c_source import read_c
from grader.evidence.text.source import Rules, SourceFacts, read_python
from grader.submission.file_names import C_SUFFIXES


def read_sources(texts: Mapping[str, str], rules: Rules | None = None) -> list[SourceFacts]:
    """Read files by their paths. A text that is repeated in the same words explains once. Never raises."""
    rules = rules or Rules()
    said: set[str] = set()
    found = []
    for path, text in texts.items():
        read = read_python
        if PurePosixPath(path).suffix in C_SUFFIXES:
            read = read_c
        found.append(read(path, text, rules, said))
    return found
