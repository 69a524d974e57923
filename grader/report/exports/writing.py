"""Writes exports of a result into files."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from grader.files import replace_file
from grader.report.exports import EXPORTS, render_export
from grader.result import Result

#: Stands for the standard output.
STANDARD_OUTPUT = "-"
#: Where a file would not be written but a device replaced.
_DEVICES = ("/dev/", "/proc/")


@dataclass(frozen=True)
class ExportTarget:
    """An export, by its key in `EXPORTS`, and the file it goes to; by default one in the results folder."""

    name: str
    file: str | None = None

    @classmethod
    def parse(cls, text: str) -> ExportTarget:
        """Read `NAME` or `NAME=FILE`; raises ValueError if there is no such export."""
        name, _, file = text.partition("=")
        if name not in EXPORTS:
            raise ValueError(f"there is no export {name!r}; there are {', '.join(EXPORTS)}")
        if file.startswith(_DEVICES):
            raise ValueError(f"{file} cannot be replaced by a file; {STANDARD_OUTPUT} is the standard output")
        return cls(name, file or None)

    def path(self, results: Path) -> Path:
        """Return the file, which is not the standard output."""
        return Path(self.file) if self.file is not None else results / EXPORTS[self.name].file_name

    def __str__(self) -> str:
        return self.name if self.file is None else f"{self.name}={self.file}"


def write_exports(targets: Sequence[ExportTarget], result: Result, results: Path, path_prefix: str = "") -> list[Path]:
    """Write a result's exports; returns the files. Raises GraderError if one of them cannot be made."""
    written = []
    for target in targets:
        text = render_export(target.name, result, path_prefix=path_prefix, environment=os.environ)
        if target.file == STANDARD_OUTPUT:
            sys.stdout.flush()
            sys.stdout.buffer.write(text.encode("utf-8"))
            sys.stdout.buffer.flush()
        else:
            written.append(target.path(results))
            replace_file(written[-1], text)
    return written
