"""One server of sandboxes for all recordings of a test process: it imports the grader's modules once, as for a class."""

from __future__ import annotations

import atexit
import sys
from functools import cache
from pathlib import Path

from confine.namespaces import Form
from grader.live.session.fork_server import ForkServer
from grader.live.session.scheduler import LocalScheduler


@cache
def scheduler(jobs: int | None = None) -> LocalScheduler:
    """Return the scheduler of the gradings in this process; its server ends with the process."""
    shared = LocalScheduler(Path(sys.executable), jobs)
    atexit.register(shared.close)
    return shared


@cache
def fork_server(form: Form) -> ForkServer:
    """Return the server for sandboxes of a form, of which each recording has a branch."""
    shared = ForkServer().__enter__()
    atexit.register(shared.__exit__)
    return shared
