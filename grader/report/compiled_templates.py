"""Compiled templates, kept beside the templates as Python keeps compiled modules: compiling takes half of a page's time."""

from __future__ import annotations

import pickle
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path

from jinja2.bccache import Bucket, BytecodeCache

from grader.files import replace_file

_REPORT = Path(__file__).parent


class CompiledTemplates(BytecodeCache):
    """Keeps compiled templates in a folder, as far as Python may write bytecode there.

    A template is compiled anew if its text or a module of `grader.report` changes, because compiling evaluates
    filters of constants.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get_source_checksum(self, source: str) -> str:
        """Return a hash of the template and of the modules with its filters."""
        return super().get_source_checksum(f"{_modules()}\n{source}")

    def load_bytecode(self, bucket: Bucket) -> None:
        """Read a compiled template, if it is kept and neither its text nor a module has changed."""
        with (
            suppress(OSError, EOFError, pickle.UnpicklingError),
            self._file(bucket).open("rb") as file,
        ):
            bucket.load_bytecode(file)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep a compiled template, unless Python writes no bytecode or the folder cannot be written."""
        if sys.dont_write_bytecode:
            return
        with suppress(OSError):
            self._folder.mkdir(exist_ok=True)
            replace_file(self._file(bucket), bucket.bytecode_to_string())

    def _file(self, bucket: Bucket) -> Path:
        return self._folder / f"{bucket.key}.{sys.implementation.cache_tag}.jinja"


@cache
def _modules() -> str:
    """Return name, time and size of each module of the report; Python finds changed modules by the same."""
    states = []
    for path in sorted(_REPORT.rglob("*.py")):
        state = path.stat()
        states.append(f"{path.relative_to(_REPORT)} {state.st_mtime_ns} {state.st_size}")
    return "\n".join(states)
