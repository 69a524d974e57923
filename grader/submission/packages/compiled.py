"""Executables that the packages of a submission compile, by parsing alone."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath

from grader.recording.submission import PackageFact
from grader.submission.packages.cmake_script import COMPILED_SUFFIXES, compiled_executables


def compiled_programs(package: PackageFact, texts: Mapping[str, str]) -> dict[str, str]:
    """Return the executables that a package compiles: name -> path of the first source; empty if none is named."""
    script = texts.get(f"{package.path}/CMakeLists.txt".lstrip("/"), "")
    found = {}
    for name, source in compiled_executables(script, package.name).items():
        found[name] = ""
        if source:
            found[name] = f"{package.path}/{source}".lstrip("/")
    return found


def is_compiled_source(path: str) -> bool:
    """Return whether a file is a source of a compiled program, by its ending."""
    return PurePosixPath(path).suffix in COMPILED_SUFFIXES
