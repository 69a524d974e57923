"""Runs one program to its end as sessions run a student's, in a sandbox of its own."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence

from grader.live.sandbox.cgroup import SandboxCgroup
from grader.live.sandbox.helpers import run_helper, search_path
from grader.live.sandbox.isolation import Isolation, Room, confined
from grader.live.sandbox.namespaces import Form, enter_sandbox


def run_confined(
    isolation: Isolation,
    room: Room,
    command: Sequence[str],
    *,
    environment: Mapping[str, str],
    slot: int,
    cwd: str,
    timeout_s: float,
    group: SandboxCgroup | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run a command in the sandbox of a slot, and return what it prints and how it ended.

    Raises `OSError` where it cannot be started, and `subprocess.TimeoutExpired` where it took too long and was ended.
    """
    with confined(
        isolation, command, environment=environment, room=room, slot=slot, cwd=cwd, group=group
    ) as (
        argv,
        passed,
        info,
    ):
        try:
            return run_helper(
                argv,
                environment={"PATH": search_path()},
                before=lambda: _enter_sandbox(isolation.form),
                timeout_s=timeout_s,
                pass_fds=passed,
            )
        finally:
            if info is not None:
                os.close(info)


def _enter_sandbox(form: Form) -> None:
    try:
        enter_sandbox(form)
    except OSError as problem:
        os.write(2, str(problem).encode())
        os._exit(1)
