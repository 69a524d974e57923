"""Writes exports while a submission is still being graded.

Some systems show nothing of a job without a regular end. Each session is therefore followed by exports of the state so
far, judged by a process with the lowest priority.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from confine.helpers import helper_environment, python, start_helper
from grader.errors import UsageError
from grader.report.exports import EXPORTS
from grader.report.exports.writing import STANDARD_OUTPUT, ExportTarget, write_exports
from grader.result import Result

_CHILD_ENDS_S = 5.0


def export_variables() -> set[str]:
    """Return the names of the variables of all exports."""
    names = {"REVIEW_URL"}
    for export in EXPORTS.values():
        names.update(export.variables)
    return names


class LiveExports:
    """The exports of one submission while it is being graded; raises UsageError if one cannot be made here."""

    def __init__(
        self, targets: Sequence[ExportTarget], results: Path, path_prefix: str = ""
    ) -> None:
        self._targets, self._results, self._prefix = targets, results, path_prefix
        self._begun: set[str] = set()
        self._stale = False
        self._child: subprocess.Popen[bytes] | None = None
        self._arguments: list[str] = []
        for target in targets:
            EXPORTS[target.name].require_variables(os.environ)
            if target.file != STANDARD_OUTPUT:
                self._arguments.append(f"--to={target.absolute()}")
                path = target.path(results)
                if (
                    path.parent != results and not path.parent.is_dir()
                ):  # Fail now rather than in the end.
                    problem, location = "there is no such folder to export into", str(path.parent)
                    raise UsageError(problem, location=location, remedy="Make it first.")
                path.unlink(
                    missing_ok=True
                )  # An earlier export must not be taken for this grading's.

    def __enter__(self) -> LiveExports:
        return self

    def __exit__(self, *_: object) -> None:
        """End a running export, because its files would only be overwritten."""
        if self._child is not None:
            # On Ctrl-C it removes a half-written file.
            self._child.send_signal(signal.SIGINT)
            try:
                self._child.wait(_CHILD_ENDS_S)
            except subprocess.TimeoutExpired:
                self._child.kill()
                self._child.wait()

    def follow(self, on_progress: Callable[..., None]) -> Callable[..., None]:
        """Return `on_progress`, extended by an export when a session begins or ends."""
        if not self._arguments:
            return on_progress

        def notified(progress: Any) -> None:
            on_progress(progress)
            if not progress.ended:
                self._stale = self._stale or not self._begun
                self._begun.add(progress.session)
            elif (
                progress.session in self._begun
            ):  # A session left out ends while the earlier recordings are in place.
                self._stale = True
            self._catch_up()

        return notified

    def write(self, result: Result) -> None:
        """Write the exports of the result."""
        write_exports(self._targets, result, self._results, self._prefix)

    def _catch_up(self) -> None:
        if not self._stale:
            return
        if self._child is not None and self._child.poll() is None:
            return
        self._stale = False
        words = ["-m", "grader.cli", "export", "--so-far", f"--path-prefix={self._prefix}"]
        command = [*python(sys.executable, *words), *self._arguments]
        with suppress(OSError):
            self._child = start_helper(
                [*command, "--", str(self._results.absolute())],
                environment=helper_environment(export_variables()),
            )
            # SCHED_IDLE runs only on an idle core; the least priority still disturbs a timer of 100 Hz.
            os.sched_setscheduler(self._child.pid, os.SCHED_IDLE, os.sched_param(0))
