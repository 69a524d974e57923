"""Writes exports of a result into files."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from grader.errors import UsageError
from grader.files import replace_file
from grader.lab.similar_words import meant
from grader.report.exports import CLASS_EXPORTS, EXPORTS, Forms, render_export

if TYPE_CHECKING:
    from grader.report.exports.returned import Returned
    from grader.result import Result

#: Stands for the standard output.
STANDARD_OUTPUT = "-"
#: Forms of a result, and of a class.
FORMS: Forms = {**EXPORTS, **CLASS_EXPORTS}
#: Folders of devices, which must not be replaced by a file.
_DEVICES = ("/dev/", "/proc/")


@dataclass(frozen=True)
class ExportTarget:
    """An export, by its key in `FORMS`, and its file; by default one in the results folder."""

    name: str
    file: str | None = None

    @classmethod
    def parse(cls, text: str, forms: Forms = EXPORTS) -> ExportTarget:
        """Read `NAME` or `NAME=FILE`; raises ValueError if the forms have no such export."""
        name, _, file = text.partition("=")
        if name not in forms:
            near = meant(name, list(forms))
            if not near:
                near = f"; there are {', '.join(forms)}"
            raise ValueError(f"there is no export {name!r}{near}")
        if file.startswith(_DEVICES):
            raise ValueError(
                f"{file} cannot be replaced by a file; {STANDARD_OUTPUT} is the standard output"
            )
        return cls(name, file or None)

    def path(self, results: Path) -> Path:
        """Return the file of a target that is not the standard output."""
        if self.file is not None:
            return Path(self.file)
        return results / FORMS[self.name].file_name

    def absolute(self) -> ExportTarget:
        """Return the same target for a process with another working folder."""
        if self.file in (None, STANDARD_OUTPUT):
            return self
        return ExportTarget(self.name, str(Path(self.file).absolute()))

    def __str__(self) -> str:
        if self.file is None:
            return self.name
        return f"{self.name}={self.file}"


def write_exports(
    targets: Sequence[ExportTarget], result: Result, results: Path, path_prefix: str = ""
) -> list[Path]:
    """Write a result's exports, and return their files; raises GraderError if an export cannot be made."""
    written = []
    for target in targets:
        text = render_export(target.name, result, path_prefix=path_prefix, environment=os.environ)
        written += write_export(target, results, text.encode())
    return written


def write_class_export(
    target: ExportTarget, results: Path, returned: Returned
) -> list[tuple[Path, Returned]]:
    """Write a form of a class and its further files, named `moodle-2.csv` and so on, and return the files.

    Raises UsageError if several files are to go to the standard output.
    """
    if target.file == STANDARD_OUTPUT and returned.further:
        raise UsageError(
            f"the form {target.name} needs {1 + len(returned.further)} files, because no column names all students",
            location=STANDARD_OUTPUT,
            remedy="Leave out the file, or give --class-list with what is missing.",
        )
    written = []
    path = target.path(results)
    for number, each in enumerate((returned, *returned.further), 1):
        if number > 1:
            beside = path.with_name(f"{path.stem}-{number}{path.suffix}")
            target = ExportTarget(target.name, str(beside))
        for file in write_export(target, results, each.content):
            written.append((file, each))
    return written


def write_export(target: ExportTarget, results: Path, content: bytes) -> list[Path]:
    """Write an export to the standard output, or into its file, and return the file.

    Raises UsageError if its folder among the results is a link.
    """
    if target.file == STANDARD_OUTPUT:
        sys.stdout.flush()
        sys.stdout.buffer.write(content)
        sys.stdout.buffer.flush()
        return []
    path = target.path(results)
    if target.file is None and path.parent != results:
        path.parent.mkdir(exist_ok=True)
        if path.parent.is_symlink():
            remedy = "Remove the link; nothing is written through one."
            raise UsageError(
                "the folder of the exports is a link", location=str(path.parent), remedy=remedy
            )
    replace_file(path, content)
    return [path]
