"""What can begin while it is still read what is to be graded, which takes as long."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from pathlib import Path

from grader.bounded import Bound, begun
from grader.live.sandbox.probing import probe_isolation
from grader.live.session.fork_server import ForkServer

#: It takes 0.25 s; what it runs has limits of its own, which others would be in the way of.
_PROBING_BOUND = Bound(what="testing the sandbox", cpu_s=None, wall_s=180.0, memory_bytes=None)


class Ahead(ExitStack):
    """The test of the sandbox, and the server that forks sandboxes, begun at once; a context, with which both end."""

    def __init__(self, interpreter: Path) -> None:
        super().__init__()
        #: Returns how code can be confined, or raises what came up, as soon as that is known.
        self.isolation = self.enter_context(
            begun(partial(probe_isolation, interpreter), _PROBING_BOUND)
        )
        self.forks = self.enter_context(ForkServer())
