"""Grading of one submission in a process of its own, so that no submission can end the grading of the others.

The module has both ends. `grade_in_process` asks for a process with a job in a file, and ends the process if it
hangs. The process reports its progress and its ending through a pipe, and waits for one of the machine's slots for
each session and for its own work.

All processes of a class are forks of one process, `Workers`, with everything imported; `Here` replaces it if it is
lost.
"""

from __future__ import annotations

import asyncio
import base64
import gc
import os
import pickle
import shutil
import signal
import socket
import sys
import tempfile
import time
import traceback
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from confine.helpers import absolute_entries, helper_environment
from confine.isolation import Isolation, Level
from confine.machine import wait_for_calm
from confine.namespaces import end_with_parent
from confine.scratch import remove_stale, scratch_prefix
from grader import pipeline
from grader.bounded import limit_memory, write_all
from grader.classroom.job import Ending, Job, problem_of
from grader.classroom.scheduler import Machine
from grader.errors import GraderError, PlatformError, ProcessLostError
from grader.files import UNFINISHED
from grader.judging.judgement import prepare
from grader.lab.rubric import SessionSpec
from grader.live.process.forked import Program
from grader.live.process.forking import ForkingServer, serve
from grader.live.process.waiting import within
from grader.live.sandbox.environment import SOURCED
from grader.live.session.fork_server import ForkServer
from grader.live.session.runner import Progress, likely_used
from grader.live.session.scheduler import Slot
from grader.live_exports import export_variables

#: Address space for reading and judging a submission, of which 0.7 GiB suffice. Its sandboxes have limits of their
#: own.
MOST_MEMORY_BYTES = 4 * 1024**3
#: Time for a process to end after a request, in s.
_END_S = 15.0
#: Interval between reports of a waiting process, in s.
_STILL_WAITS_S = 10.0
#: Time without a request for slots after which another submission begins, and interval of the looks, in s.
_UNASKED_S, _LOOK_S = 0.5, 0.1
#: Number of losses of the common process in a row, without a finished grading in between, that are tolerated.
_MOST_LOST = 3


# -- the process that grades many ----------------------------------------------------------------


class Workers(ForkingServer):
    """The process with a fork for each submission; used as a context that ends all forks."""

    def __init__(self) -> None:
        environment = helper_environment(export_variables())
        for name in SOURCED:
            environment[name] = os.pathsep.join(absolute_entries(name))
        super().__init__(__name__, (), environment)


class Here(ExitStack):
    """Grading on this machine, of as many submissions at a time as keep its slots in use; used as a context.

    Submissions lost with a killed process are graded once more, by a new process if it was the common one.
    """

    def __init__(self, isolation: Isolation, machine: Machine) -> None:
        super().__init__()
        self._isolation, self._machine = isolation, machine
        self._turn = asyncio.Lock()
        self._running = 0
        self._workers: Workers | None = None
        self._lost = 0

    async def grade(
        self, job: Job, on_progress: Callable[[Progress], None]
    ) -> tuple[Ending, Level]:
        """Grade a submission in a process of its own; returns its ending, and the confinement of its code."""
        job = replace(job, isolation=self._isolation, machine=self._machine)
        async with self._turn:
            await self._wait_for_room(len(job.rubric.sessions))
            self._running += 1
        try:
            ending = await self._grade(job, on_progress)
            if isinstance(ending, ProcessLostError):
                again = Progress("", "restarting: a grader process was killed")
                on_progress(again)
                ending = await self._grade(job, on_progress)
            return ending, self._isolation.level
        finally:
            self._running -= 1

    async def _wait_for_room(self, sessions: int) -> None:
        """Wait until fewer submissions run than usually keep the slots in use, or until no session waits for a slot.

        Each running submission needs memory, usually 18 MB.
        """
        usual = self._machine.submissions(sessions)
        most = self._machine.slots + self._machine.spare
        unasked_s = 0.0
        while self._running >= usual:
            if unasked_s >= _UNASKED_S and self._running < most:
                return
            await asyncio.sleep(_LOOK_S)
            unasked_s += _LOOK_S
            if self._machine.is_asked():
                unasked_s = 0.0

    async def _grade(self, job: Job, on_progress: Callable[[Progress], None]) -> Ending:
        if self._lost == _MOST_LOST:
            remedy = "Find out what kills them, such as a want of memory (`dmesg`). The same command goes on from here."
            return PlatformError(
                f"the processes that grade were killed {_MOST_LOST} times in a row", remedy=remedy
            )
        workers = self._workers = self._workers or self.enter_context(Workers())
        ending = await grade_in_process(job, workers, on_progress)
        if not workers.has_ended():
            self._lost = 0
            return ending
        if workers is self._workers:
            self._lost += 1
            self._workers = None
        # Any report can be an effect of that: sessions of a lost server are recorded as undecided.
        if isinstance(ending, ProcessLostError):
            return ending
        return ProcessLostError("a server was killed")


async def grade_in_process(
    job: Job, workers: Workers, on_progress: Callable[[Progress], None]
) -> Ending:
    """Grade one submission in a process of its own; returns its ending, and never fails because of it."""
    try:
        with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as scratch:
            (Path(scratch) / "job").write_bytes(pickle.dumps(job.absolute()))
            return await _run(job, workers, Path(scratch), on_progress)
    except (OSError, ValueError) as error:
        return problem_of(error)
    finally:
        shutil.rmtree(job.results / UNFINISHED, ignore_errors=True)
        # The folder is usually not empty.
        with suppress(OSError):
            job.results.rmdir()


async def _run(
    job: Job, workers: Workers, scratch: Path, on_progress: Callable[[Progress], None]
) -> Ending:
    said = await workers.start(os.fsencode(scratch / "job"), scratch / "stderr")
    timeouts_s = [session.timeout_s for session in job.rubric.sessions.values()]
    quiet_s = job.silence_s + max(timeouts_s, default=0.0)
    ending: Ending | None = None
    status: int | None = None
    process = 0
    try:
        process = int(await within(said.readline(), quiet_s) or 0)
        while (line := await within(said.readline(), quiet_s)).endswith(b"\n"):
            if line.startswith(b"ended "):
                status = int(line.split()[1])
                continue
            message: Progress | Ending = pickle.loads(base64.b64decode(line))
            if isinstance(message, Progress):
                on_progress(message)
            else:
                ending = message
    except TimeoutError:
        remedy = "Grade this submission alone and watch its progress; the others are not affected."
        ending = ending or GraderError(
            f"the grader's process reported nothing for {quiet_s:g} s", remedy=remedy
        )
    finally:
        await _end(process, said)
        remove_stale()
    return ending or _broken(status, scratch / "stderr")


async def _end(process: int, said: asyncio.StreamReader) -> None:
    """Ask the process to end if it has not, and see that it does."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with suppress(asyncio.TimeoutError, ProcessLookupError):
            if not process:
                line = await within(said.readline(), _END_S)
                process = int(line or 0)
            if process and not said.at_eof():
                os.kill(process, number)
                await within(said.read(), _END_S)


def _broken(status: int | None, errors: Path) -> GraderError:
    """Return the known facts about a process without an ending."""
    if status is None:
        return ProcessLostError("the process that grades all submissions was killed")
    if status >= 0:
        how = f"status {status}"
    else:
        how = signal.Signals(-status).name
    lines = errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    last = f": {lines[-1]}" if lines else ""
    remedy = "Grade this submission alone. A SIGKILL that nobody sent means that the machine ran out of memory."
    kind = ProcessLostError if status < 0 else GraderError
    return kind(f"the grader's process ended with {how}{last}", remedy=remedy)


# -- the process that grades one -----------------------------------------------------------------


def main() -> None:
    """Fork a process for each job file that is named through the socket with the number in argv[1]."""
    end_with_parent()  # If that has ended already, so has the other side of the socket.
    # Python finds it by writing a file there, which one that is killed at that moment would leave.
    tempfile.gettempdir()
    servers: list[ForkServer] = []
    with ExitStack() as stack, socket.socket(fileno=int(sys.argv[1])) as link:

        def program_of(request: bytes) -> Program:
            job: Job = pickle.loads(Path(os.fsdecode(request)).read_bytes())
            if not servers:  # All jobs have the same rubric.
                servers.append(stack.enter_context(ForkServer(likely_used(job.rubric))))
                # A failed import is reported by its first use.
                with suppress(Exception):
                    prepare(job.rubric, job.rubric.reference_programs)
                gc.freeze()
            grade = partial(_grade, job, servers[0])
            return Program("worker", grade, dict(os.environ), kept=[servers[0].fileno()])

        serve(link, program_of, servers)


def _grade(job: Job, forks: ForkServer) -> None:
    limit_memory(MOST_MEMORY_BYTES)
    # A lab's own code can print, also students' texts: none of that is a message, because messages are unpickled.
    send = partial(_send, os.dup(1))
    os.dup2(2, 1)
    try:
        assert job.isolation is not None
        scheduler = _WorkerScheduler(job, job.isolation, forks, send)
        ending: Ending = pipeline.grade(
            job.source, job.rubric, job.results, job.options, send, scheduler
        )
    except Exception as error:
        traceback.print_exc()
        ending = problem_of(error)
    # Not through a file, because a full disk can be the problem.
    send(ending)


def _send(channel: int, what: Progress | Ending) -> None:
    write_all(channel, base64.b64encode(pickle.dumps(what)) + b"\n")


@dataclass
class _WorkerScheduler:
    """The machine's slots for the sessions of this process, and for its own work.

    A slot for work is kept until the work is done, because this process does work and sessions in turn. The end of
    the process frees its slots in any case.
    """

    job: Job
    isolation: Isolation
    forks: ForkServer
    send: Callable[[Progress], None]
    _own: Callable[[], None] | None = None
    _alone_s: float = 0.0

    def __post_init__(self) -> None:
        with self.work("reading"):
            pass

    def fork_server(self, likely: Sequence[str | Path]) -> ForkServer:
        """Return a branch of the class's server, which ends with this process and has loaded all that the lab uses."""
        return self.forks.branch(self.isolation.form)

    def slots(self, specs: Sequence[SessionSpec], attempt: int) -> Slot:
        """Return slots of the machine, for which the sessions ask one by one, since each that asks polls."""
        return partial(self._slot, attempt, asyncio.Lock())

    @asynccontextmanager
    async def _slot(
        self, attempt: int, asking: asyncio.Lock, spec: SessionSpec
    ) -> AsyncIterator[None]:
        """Hold a slot for a session; the second time beside as few others as a single grading runs, then alone."""
        self._give_back()
        assert self.job.machine is not None
        alone = attempt > 2 and self._alone_s < self.job.alone_s
        text, parts = "waits for a free slot", None
        if alone:
            text, parts = "waits to run alone, to retry undecided checks", 1
        elif attempt > 1:
            parts = self.job.machine.slots
            text = "waits to run beside few others, to retry undecided checks"
        async with asking:
            give_back = await self._take(Progress(spec.id, text), parts)
        began_s = time.monotonic()
        try:
            yield
        finally:
            give_back()
            self._alone_s += (time.monotonic() - began_s) * alone

    @contextmanager
    def work(self, what: str) -> Iterator[None]:
        """Hold a slot for work of this process."""
        if self._own is None:
            self._own = asyncio.run(self._take(Progress("", what)))
        else:
            self.send(Progress("", what))
        yield

    def await_calm(self, attempt: int) -> None:
        """Give back the slot for work of this process; before the third attempt, wait for a calmer machine besides.

        The second attempt waits for slots beside so few other sessions that they suffice.
        """
        self._give_back()
        if attempt > 2:
            wait_for_calm()

    def _give_back(self) -> None:
        if self._own is not None:
            self._own()
            self._own = None

    async def _take(self, progress: Progress, parts: int | None = None) -> Callable[[], None]:
        assert self.job.machine is not None
        waiting = asyncio.ensure_future(self.job.machine.take(parts))
        while not waiting.done():
            self.send(progress)
            await asyncio.wait({waiting}, timeout=_STILL_WAITS_S)
        return waiting.result()


if __name__ == "__main__":
    main()
