"""Evaluation of a launch file in a process of its own, with all rights of the caller."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

from launch_plan.exchange import (
    MOST_ANSWER_BYTES,
    PACKAGE,
    Ending,
    Request,
    command,
    plan_of_answer,
)
from launch_plan.plan import Plan

#: End of the output that a plan may quote, in bytes.
_QUOTED_BYTES = 4096


def evaluate(
    file: Path | str,
    arguments: Mapping[str, str] | None = None,
    *,
    root: Path | str | None = None,
    native: bool = False,
    interpreter: Path | str = sys.executable,
    environment: Mapping[str, str] | None = None,
    timeout_s: float = 30.0,
) -> Plan:
    """Return the plan of a launch file, as `ros2 launch FILE name:=value` would carry it out.

    The evaluation executes the launch file, unconfined. For a file of unknown origin, start the process in a sandbox
    with the functions of `launch_plan.exchange`.

    Parameters
    ----------
    file : Path or str
        Launch file in Python, XML or YAML.
    arguments : Mapping, optional
        Value by name of launch argument, e.g. `{"rate": "50"}`.
    root : Path or str, optional
        Folder to which the paths in the plan are relative; the folder of the file by default.
    native : bool
        True for the real `launch` and `launch_ros` of a ROS installation, false for the stand-in.
    interpreter : Path or str
        Python with PyYAML and `ament_index_python`; for `native` also with `launch_ros`.
    environment : Mapping, optional
        Variables of the process; the caller's by default. `AMENT_PREFIX_PATH` lists the installed packages.
    timeout_s : float
        Time for the evaluation, in seconds.

    Returns
    -------
    Plan
        A plan in any case: mistakes of the launch file are its `problem`.

    Raises
    ------
    OSError
        If the process cannot be started.
    """
    path = Path(file).absolute()
    folder = path.parent if root is None else Path(root).absolute()
    request = Request(str(path), dict(arguments or {}), str(folder), native)
    with TemporaryFile() as answer, TemporaryFile() as output:
        process = subprocess.Popen(
            command(interpreter, PACKAGE, answer.fileno()),
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            pass_fds=[answer.fileno()],
            cwd=path.parent if path.parent.is_dir() else "/",
            env=environment,
            start_new_session=True,
        )
        in_time = _finished(process, request.to_json(), timeout_s)
        ending = Ending(in_time, timeout_s, process.returncode, output=_last_line(output))
        answer.seek(0)
        text = answer.read(MOST_ANSWER_BYTES).decode("utf-8", "replace")
    return plan_of_answer(text, ending, os.path.relpath(path, folder))


def _finished(process: subprocess.Popen[bytes], request: bytes, timeout_s: float) -> bool:
    """Return whether a process ended in time; at the end, kill the process and all in its group."""
    try:
        process.communicate(request, timeout=timeout_s)
    except subprocess.TimeoutExpired:
        return False
    finally:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return True


def _last_line(output: IO[bytes]) -> str:
    size = output.seek(0, os.SEEK_END)
    output.seek(max(0, size - _QUOTED_BYTES))
    lines = output.read().decode("utf-8", "replace").split("\n")
    spoken = [line for line in lines if line.strip()]
    return spoken[-1] if spoken else ""
