"""The start of a grading: its threads and its modules."""

from __future__ import annotations

import os
import subprocess
import sys

_START = """\
import os, sys
import grader.commands.grade, grader.pipeline
from grader.judging.judgement import load
from grader.judging.rubrics import read_rubric

rubric = read_rubric(None)
if "load" in sys.argv:
    load(rubric)
print(len(os.listdir("/proc/self/task")))
print(*sys.modules)
"""


def _started(*arguments: str) -> tuple[int, set[str]]:
    """Return the number of threads of a process with the modules of a grading, and its modules."""
    command = [sys.executable, "-I", "-c", _START, *arguments]
    environment = dict(os.environ)
    environment.pop("OPENBLAS_NUM_THREADS", None)
    told = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    threads, modules = told.stdout.splitlines()
    return int(threads), set(modules.split())


def test_libraries_start_no_threads() -> None:
    """The threads of numpy's library would spin for a tenth of a second."""
    threads, modules = _started()
    assert threads == 1
    assert "numpy" in modules


def test_a_grading_imports_nothing_for_other_commands() -> None:
    """Modules of exports, locales and the lists of all figures stay out."""
    _started()  # The first validation of a rubric needs all checks and figures.
    _, modules = _started("load")
    others = {"babel", "grader.report.exports.graded", "grader.report.figures.kinds"}
    assert not others & modules
