"""Decides when sessions, and the grader's own work, may burden the machine.

`LocalScheduler` serves a single grading. A class has a scheduler of its own in each worker (`grader.classroom.worker`).
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import (
    AbstractAsyncContextManager,
    AbstractContextManager,
    ExitStack,
    asynccontextmanager,
    nullcontext,
)
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from confine.isolation import Isolation
from confine.machine import wait_for_calm
from grader.bounded import Bound, begun
from grader.live.sandbox.probing import probe_isolation

if TYPE_CHECKING:
    from grader.lab.rubric import SessionSpec
    from grader.live.session.fork_server import CommandsForkServer, ForkServer

#: Largest measured number of sessions per core with sound 100 Hz timing (p99 jitter under 6 ms).
SESSIONS_PER_CORE = 2
#: Most sessions at a time.
_MOST_SESSIONS = 4
#: Head start of the longest sessions, in s: the time a program takes to begin.
_START_S = 0.5
#: Limits of the sandbox test. It takes 0.25 s; the programs that it runs have limits of their own.
_PROBING_BOUND = Bound(what="testing the sandbox", cpu_s=None, wall_s=180.0, memory_bytes=None)

#: Holds the slot of a session.
Slot = Callable[["SessionSpec"], AbstractAsyncContextManager[None]]


def sessions_at_a_time(isolation: Isolation) -> int:
    """Return how many sandboxes may run side by side here; one if they would share a network."""
    if not isolation.namespaces:
        return 1
    cores = len(os.sched_getaffinity(0))
    return max(1, min(_MOST_SESSIONS, SESSIONS_PER_CORE * cores))


class Scheduler(Protocol):
    """Permits a session, or the grader's own work, to burden a machine that several submissions may share."""

    @property
    def isolation(self) -> Isolation:
        """Return how students' code is confined."""
        ...

    def fork_server(self, likely: Sequence[str | Path]) -> ForkServer:
        """Return a context that starts the sandboxes of one submission; for `likely` see `ForkServer`."""
        ...

    def slots(self, specs: Sequence[SessionSpec], attempt: int) -> Slot:
        """Return the slots of sessions that are about to be recorded, longest first; called in their event loop.

        A slot waits until its session may run. Later attempts wait for a calmer machine.
        """
        ...

    def work(self, what: str) -> AbstractContextManager[None]:
        """Wait until the grader's own work, such as judging, takes no core from a session that is being timed."""
        ...

    def await_calm(self, attempt: int) -> None:
        """Give up the slot for the grader's own work, and wait until an attempt after the first may begin."""
        ...


class LocalScheduler(ExitStack):
    """The whole machine for one grading.

    The sandbox test starts at once, and the fork server with `load`, while the caller still reads the rubric and the
    submission; both end with this context.

    Parameters
    ----------
    interpreter
        Python that runs students' code.
    jobs
        Sessions side by side; None for as many as the cores allow.
    """

    def __init__(self, interpreter: Path, jobs: int | None = None) -> None:
        super().__init__()
        self._interpreter = interpreter
        self._jobs = jobs
        probing = partial(probe_isolation, interpreter)
        self._probed = self.enter_context(begun(probing, _PROBING_BOUND))

    def for_interpreter(self, interpreter: Path) -> LocalScheduler:
        """Return the scheduler for students' code with an interpreter: this one, or one that ends with this context."""
        if interpreter == self._interpreter:
            return self
        return self.enter_context(LocalScheduler(interpreter, self._jobs))

    def load(self) -> None:
        """Have the fork server load its modules, as soon as the test has ended."""
        self._forks.load(self.isolation.form)

    @cached_property
    def _forks(self) -> CommandsForkServer:
        """Fork server with the modules that this process has imported by its first use."""
        # Its import takes a tenth of a second; the sandbox test runs meanwhile.
        from grader.live.session.fork_server import CommandsForkServer

        return self.enter_context(CommandsForkServer())

    @cached_property
    def isolation(self) -> Isolation:
        """Return how code can be confined, as soon as the test has ended, or raise the error of the test."""
        return self._probed()

    def fork_server(self, likely: Sequence[str | Path]) -> ForkServer:
        """Return a branch of the fork server, which begins to load these types and the programs' modules."""
        self._forks.likely = likely
        return self._forks.branch(self.isolation.form)

    def slots(self, specs: Sequence[SessionSpec], attempt: int) -> Slot:
        """Return slots for as many sessions as the cores allow, or for one session in later attempts."""
        free = asyncio.Semaphore(self._at_a_time(attempt))
        longest_s = 0.0
        if specs:
            longest_s = specs[0].typical_s

        @asynccontextmanager
        async def slot(spec: SessionSpec) -> AsyncIterator[None]:
            if spec.typical_s + _START_S < longest_s:
                await asyncio.sleep(_START_S)
            async with free:
                yield

        return slot

    def _at_a_time(self, attempt: int) -> int:
        if attempt > 1:
            return 1
        most = sessions_at_a_time(self.isolation)
        if self._jobs is None or not self.isolation.namespaces:
            return most
        return self._jobs

    def work(self, what: str) -> AbstractContextManager[None]:
        """Permit work at once."""
        return nullcontext()

    def await_calm(self, attempt: int) -> None:
        """Wait for a calmer machine."""
        wait_for_calm()
