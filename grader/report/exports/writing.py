"""Writes exports of a result into files."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from grader.errors import UsageError
from grader.files import replace_file
from grader.report.exports import CLASS_EXPORTS, EXPORTS, ClassExport, Export, render_export
from grader.report.exports.returned import Returned
from grader.result import Result

#: Stands for the standard output.
STANDARD_OUTPUT = "-"
#: Forms of a result, and of a class.
FORMS: Mapping[str, Export | ClassExport] = {**EXPORTS, **CLASS_EXPORTS}
#: Where a file would not be written but a device replaced.
_DEVICES = ("/dev/", "/proc/")


@dataclass(frozen=True)
class ExportTarget:
    """An export, by its key in `FORMS`, and the file it goes to; by default one in the results folder."""

    name: str
    file: str | None = None

    @classmethod
    def parse(cls, text: str, forms: Mapping[str, Export | ClassExport] = EXPORTS) -> ExportTarget:
        """Read `NAME` or `NAME=FILE`; raises ValueError if there is no such export among the forms."""
        name, _, file = text.partition("=")
        if name not in forms:
            raise ValueError(f"there is no export {name!r}; there are {', '.join(forms)}")
        if file.startswith(_DEVICES):
            raise ValueError(
                f"{file} cannot be replaced by a file; {STANDARD_OUTPUT} is the standard output"
            )
        return cls(name, file or None)

    def path(self, results: Path) -> Path:
        """Return the file, which is not the standard output."""
        return Path(self.file) if self.file is not None else results / FORMS[self.name].file_name

    def absolute(self) -> ExportTarget:
        """Return the same target for a process with another working folder."""
        if self.file in (None, STANDARD_OUTPUT):
            return self
        return ExportTarget(self.name, str(Path(self.file).absolute()))

    def __str__(self) -> str:
        return self.name if self.file is None else f"{self.name}={self.file}"


def write_exports(
    targets: Sequence[ExportTarget], result: Result, results: Path, path_prefix: str = ""
) -> list[Path]:
    """Write a result's exports; returns the files. Raises GraderError if one of them cannot be made."""
    written = []
    for target in targets:
        text = render_export(target.name, result, path_prefix=path_prefix, environment=os.environ)
        written += write_export(target, results, text.encode())
    return written


def write_class_export(
    target: ExportTarget, results: Path, returned: Returned
) -> list[tuple[Path, Returned]]:
    """Write a form of a class and its further files, called `moodle-2.csv` and so on; returns the files.

    Raises UsageError if several files are to go to the standard output.
    """
    if target.file == STANDARD_OUTPUT and returned.further:
        raise UsageError(
            f"the form {target.name} needs {1 + len(returned.further)} files, because no column names all students",
            location=STANDARD_OUTPUT,
            remedy="Leave out the file, or give --class-list with what is missing.",
        )
    written = [(path, returned) for path in write_export(target, results, returned.content)]
    path = target.path(results)
    for number, further in enumerate(returned.further, 2):
        beside = str(path.with_name(f"{path.stem}-{number}{path.suffix}"))
        target = ExportTarget(target.name, beside)
        written += [(file, further) for file in write_export(target, results, further.content)]
    return written


def write_export(target: ExportTarget, results: Path, content: bytes) -> list[Path]:
    """Write an export to the standard output, or into its file, which is returned.

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
