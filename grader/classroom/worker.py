"""One submission in a process of its own, so that nothing it holds can end the grading of the others.

Both ends: `grade_in_process` starts the process with a job in a file, and ends it when it hangs; the process says on
its standard output what it is doing, and at last how that ended. For each session, and for its own work, it waits for
one of the machine's slots.
"""

from __future__ import annotations

import asyncio
import base64
import os
import pickle
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from grader import pipeline
from grader.bounded import limit_memory, write_all
from grader.classroom.job import Ending, Job, problem_of
from grader.errors import GraderError
from grader.files import UNFINISHED
from grader.lab.rubric import SessionSpec
from grader.live.process.waiting import within
from grader.live.sandbox.isolation import Isolation
from grader.live.sandbox.scratch import remove_stale, scratch_prefix
from grader.live.session.runner import Progress

#: What reading and judging a submission may take of the address space; some 0.7 GiB suffice. The sandboxes that it
#: starts have limits of their own.
MOST_MEMORY_BYTES = 4 * 1024**3
#: How long it may take to end when it is asked to.
_END_S = 15.0
#: How often one that waits says so.
_STILL_WAITS_S = 10.0
#: The last line holds the whole result.
_MOST_LINE_BYTES = 64 * 1024 * 1024


# -- the process that grades many ----------------------------------------------------------------


async def grade_in_process(job: Job, on_progress: Callable[[Progress], None]) -> Ending:
    """Grade one submission in a process of its own; returns how it ended, and never fails because of it."""
    assert job.machine is not None
    # So that starting takes no core from a session; the process itself takes the next slot.
    give_back = await job.machine.take()
    try:
        with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as scratch:
            (Path(scratch) / "job").write_bytes(pickle.dumps(job))
            return await _run(job, Path(scratch), on_progress, give_back)
    except (OSError, ValueError) as error:
        return problem_of(error)
    finally:
        give_back()
        shutil.rmtree(job.results / UNFINISHED, ignore_errors=True)
        with suppress(OSError):  # It is not empty, as a rule.
            job.results.rmdir()


async def _run(
    job: Job, scratch: Path, on_progress: Callable[[Progress], None], on_started: Callable[[], None]
) -> Ending:
    with (scratch / "stderr").open("wb") as errors:
        process = await asyncio.create_subprocess_exec(
            *("setpriv", "--pdeathsig", "KILL", sys.executable, "-I", "-m", "grader.classroom.worker"),
            str(scratch / "job"),
            str(os.getpid()),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=errors,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,
            limit=_MOST_LINE_BYTES,
        )
    assert process.stdout is not None
    quiet_s = job.silence_s + max(session.timeout_s for session in job.rubric.sessions.values())
    ending: Ending | None = None
    try:
        while (line := await within(process.stdout.readline(), quiet_s)).endswith(b"\n"):
            on_started()
            message: Progress | Ending = pickle.loads(base64.b64decode(line))
            if isinstance(message, Progress):
                on_progress(message)
            else:
                ending = message
        await within(process.wait(), quiet_s)
    except asyncio.TimeoutError:
        remedy = "Grade this submission alone and watch its progress; the others are not affected."
        ending = ending or GraderError(f"the grader's process reported nothing for {quiet_s:g} s", remedy=remedy)
    finally:
        await _end(process)
        remove_stale()
    return ending or _broken(process.returncode, scratch / "stderr")


async def _end(process: asyncio.subprocess.Process) -> None:
    """Ask the process to end if it has not, and see that it does."""
    if process.returncode is None:
        with suppress(ProcessLookupError):
            process.terminate()
        try:
            await within(process.wait(), _END_S)
        except asyncio.TimeoutError:
            with suppress(ProcessLookupError):
                process.kill()
    with suppress(asyncio.TimeoutError):
        await within(process.communicate(), _END_S)


def _broken(status: int | None, errors: Path) -> GraderError:
    """Return what is known of a process that ended without an ending."""
    how = f"status {status}" if status is None or status >= 0 else signal.Signals(-status).name
    lines = errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    last = f": {lines[-1]}" if lines else ""
    remedy = "Grade this submission alone. A SIGKILL that nobody sent means that the machine ran out of memory."
    return GraderError(f"the grader's process ended with {how}{last}", remedy=remedy)


# -- the process that grades one -----------------------------------------------------------------


def main(argv: list[str]) -> int:
    """Grade the submission of a job; returns the exit status."""
    if os.getppid() != int(argv[1]):  # It ended before it could be said that this one ends with it.
        return 1
    limit_memory(MOST_MEMORY_BYTES)
    try:
        job: Job = pickle.loads(Path(argv[0]).read_bytes())
        assert job.isolation is not None
        scheduler = _WorkerScheduler(job, job.isolation)
        ending: Ending = pipeline.grade(job.source, job.rubric, job.results, job.options, _send, scheduler)
    except Exception as error:
        traceback.print_exc()
        ending = problem_of(error)
    # Not through a file: that the disk is full may be what has to be said.
    _send(ending)
    return 0


def _send(what: Progress | Ending) -> None:
    write_all(sys.stdout.fileno(), base64.b64encode(pickle.dumps(what)) + b"\n")


@dataclass
class _WorkerScheduler:
    """The machine's slots for the sessions of this process, and for its own work.

    A slot for work is kept until the first session asks for one, since it is of this process alone, which does
    both in turn. What this process holds is freed at its end in any case.
    """

    job: Job
    isolation: Isolation
    _own: Callable[[], None] | None = None
    _alone_s: float = 0.0

    def __post_init__(self) -> None:
        with self.work("reading"):
            pass

    @asynccontextmanager
    async def session_slot(self, spec: SessionSpec, *, alone: bool) -> AsyncIterator[None]:
        """Hold a slot for a session."""
        if self._own is not None:
            self._own()
            self._own = None
        alone = alone and self._alone_s < self.job.alone_s
        give_back = await self._take(Progress(spec.id, "waits to run alone" if alone else "waits"), alone=alone)
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
            _send(Progress("", what))
        yield

    async def _take(self, progress: Progress, *, alone: bool = False) -> Callable[[], None]:
        assert self.job.machine is not None
        waiting = asyncio.ensure_future(self.job.machine.take(alone=alone))
        while not waiting.done():
            _send(progress)
            await asyncio.wait({waiting}, timeout=_STILL_WAITS_S)
        return waiting.result()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
