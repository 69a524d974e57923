"""Executes the files of a lab's checks, oracles and figures before the judgements that call them.

Executing them takes a fourteenth of a judgement. Forks of a process that has executed them have their functions; each
fork still begins with the state that the files leave behind.
"""

from __future__ import annotations

import io
import sys
import threading
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout, suppress
from functools import partial
from pathlib import Path

from grader.bounded import Bound, in_process
from grader.checks.own import built, load_own
from grader.errors import BoundError
from grader.evidence.oracle import load_file
from grader.lab.lab_code import is_own
from grader.lab.rubric import CheckSpec, Rubric, functions_of

#: Limits of executing all files of a lab, a hundred times the 0.03 s of Lab 09-01.
_EXECUTING_BOUND = Bound(
    what="executing the lab's files", cpu_s=5.0, wall_s=20.0, memory_bytes=1024**3
)
_THREADS = Path("/proc/self/task")


def execute_files(rubric: Rubric) -> None:
    """Execute the files of a lab that judging calls, if all of them can be executed without harm to this process.

    A fork executes them first. This process does the same only if the fork came to its end within limits, and without
    a thread, which no fork would have. A file with a mistake is left to the judgement, which reports the mistake.
    """
    if sys.platform != "linux":
        return
    # No other thread of a process, such as a server's, may wait for it.
    if threading.current_thread() is not threading.main_thread():
        return
    try:
        files = in_process(partial(_without_harm, rubric), _EXECUTING_BOUND)
    except BoundError:
        return
    _execute(rubric, files)


def _without_harm(rubric: Rubric) -> list[str]:
    """Return the files that were executed in this process; none if they started a thread."""
    threads = _threads()
    files = sorted(_files_in(rubric))
    done = _execute(rubric, files)
    if _threads() != threads:
        return []
    return done


def _threads() -> int:
    """Return the number of threads of this process, also of those that Python does not know."""
    return sum(1 for _ in _THREADS.iterdir())


def _files_in(rubric: Rubric) -> set[str]:
    """Return the files of the functions that checks and figures name; those of reference nodes are never executed."""
    functions = list(rubric.functions_of_figures)
    for spec in rubric.checks():
        functions += functions_of(spec)
    return {function.partition(":")[0] for function in functions}


def _execute(rubric: Rubric, files: list[str]) -> list[str]:
    """Execute files, and read the parameters of the checks in them; returns the files without a mistake.

    Nothing that they print is kept.
    """
    done = []
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        for file in files:
            with suppress(Exception, SystemExit):
                load_file(rubric.folder, file)
                done.append(file)
        for spec in _checks_in(rubric, done):
            with suppress(Exception, SystemExit):
                built(load_own(rubric.folder, spec.check), spec.parameters)
    return done


def _checks_in(rubric: Rubric, files: list[str]) -> Iterator[CheckSpec]:
    """Yield the lab's own checks in some files."""
    for spec in rubric.checks():
        if is_own(spec.check) and spec.check.partition(":")[0] in files:
            yield spec
