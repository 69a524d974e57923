"""Runs one program to its end in a sandbox of its own."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from confine.cgroup import SandboxCgroup
from confine.command import confined
from confine.helpers import run_helper, search_path
from confine.isolation import Isolation
from confine.namespaces import Form, enter_sandbox
from confine.room import Room


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
    """Run a command in the sandbox of a slot, and return its output and exit status.

    Raises `OSError` if it cannot be started, and `subprocess.TimeoutExpired` if it took too long and was ended.
    """
    with confined(
        isolation, command, environment=environment, room=room, slot=slot, cwd=cwd, group=group
    ) as (argv, passed, info):
        try:
            return run_helper(
                argv,
                environment={"PATH": search_path()},
                before=partial(enter_or_end, isolation.form),
                timeout_s=timeout_s,
                pass_fds=passed,
            )
        finally:
            if info is not None:
                os.close(info)


def enter_or_end(form: Form, prepare: Callable[[], object] | None = None) -> None:
    """Enter a new sandbox and prepare it, or end this process with the reason on its standard error."""
    try:
        enter_sandbox(form)
        if prepare is not None:
            prepare()
    except OSError as problem:
        os.write(2, str(problem).encode())
        os._exit(1)
