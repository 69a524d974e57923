"""One server of sandboxes for all recordings of a module: it imports the grader's modules once, as for a class."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from functools import cache
from pathlib import Path

from confine.namespaces import Form
from grader.live.session.fork_server import ForkServer
from grader.live.session.scheduler import LocalScheduler

_servers = ExitStack()


@cache
def scheduler(jobs: int | None = None) -> LocalScheduler:
    """Return the scheduler of the module's gradings in this process."""
    return _servers.enter_context(LocalScheduler(Path(sys.executable), jobs))


@cache
def fork_server(form: Form) -> ForkServer:
    """Return the server for sandboxes of a form; each recording has a branch of it."""
    return _servers.enter_context(ForkServer())


def end_servers() -> None:
    """End all servers; other modules count the processes below this one, and their CPU time."""
    _servers.close()
    scheduler.cache_clear()
    fork_server.cache_clear()
