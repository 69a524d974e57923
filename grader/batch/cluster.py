"""Other machines, through a Dask scheduler: a submission goes there as bytes, its results come back as bytes.

Each worker grades as this machine would: in a process of its own for each submission, and by the admission rule of
the worker's machine. The scheduler gives the submissions of a worker that is lost to others.
"""

from __future__ import annotations

import asyncio
import pickle
import sys
import tempfile
import uuid
from collections.abc import AsyncIterator, Callable
from concurrent.futures import CancelledError
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from grader.batch import fingerprint
from grader.batch.admission import Admission, Use
from grader.batch.one import make_durable
from grader.batch.order import Ending, Order, Phase
from grader.batch.parcel import packed, packed_files, unpack
from grader.batch.supervised import grade_in_process
from grader.errors import GraderError, PlatformError
from grader.intake import Handed, Intake, taken_in
from grader.live.isolation import Level
from grader.live.probing import probe_isolation
from grader.live.scratch import scratch_prefix

_CONNECT_S = 10
_WATCH_S = 1.0
_LOST = "Look at the workers' logs, and give the same command again: what is graded is kept."


@dataclass(frozen=True)
class Parcel:
    """What another machine needs to grade a submission.

    Attributes
    ----------
    engine : str
        Hash of the grader that sends it; only the same one may grade it.
    submission : bytes
        The files that were taken in, packed.
    lab : bytes
        The files beside the rubric.
    """

    engine: str
    order: Order
    submission: bytes
    lab: bytes
    own_interpreter: bool


def grade_parcel(parcel: bytes) -> tuple[Ending, str, bytes]:
    """Grade a submission on the machine where this is called: what a worker does.

    Returns
    -------
    tuple
        How it ended, the level of confinement, and the packed results: without points too, for what was recorded.
    """
    sent: Parcel = pickle.loads(parcel)
    if sent.engine != fingerprint.engine_sha256():
        remedy = "Install the same version of grade, Python and the ROS 2 packages on all machines."
        return PlatformError("a worker's grade differs from the one here", remedy=remedy), Level.NONE.value, b""
    with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as scratch:
        order = _laid_out(sent, Path(scratch))
        isolation = probe_isolation(order.options.interpreter)
        admission = Admission.on_this_machine(isolation, order.options.jobs)
        order = replace(order, isolation=isolation)
        ending = asyncio.run(grade_in_process(order, admission, 0, lambda phase: None))
        return ending, isolation.level.value, packed(order.results)


def _laid_out(sent: Parcel, scratch: Path) -> Order:
    lab, submission, results = (scratch / name for name in ("lab", "submission", "results"))
    for folder in (lab, submission, results):
        folder.mkdir()
    unpack(sent.lab, lab)
    unpack(sent.submission, submission)
    assert isinstance(sent.order.handed, Intake)
    handed = replace(sent.order.handed, folder=submission)
    options = sent.order.options
    if sent.own_interpreter:
        options = replace(options, interpreter=Path(sys.executable))
    rubric = replace(sent.order.rubric, folder=lab)
    return replace(sent.order, handed=handed, results=results, rubric=rubric, options=options)


@asynccontextmanager
async def cluster(address: str, least_isolation: Level) -> AsyncIterator[Cluster]:
    """Connect to a scheduler, by its address or by the file that it wrote.

    Raises
    ------
    PlatformError
        If the cluster's software is not installed, or the scheduler is not to be reached.
    """
    try:
        import distributed
    except ImportError:
        remedy = "In a checkout of the grader: pip install '.[cluster]'"
        raise PlatformError("the Python package distributed is not installed", remedy=remedy) from None
    where: dict[str, Any] = {"scheduler_file": address} if Path(address).is_file() else {"address": address}
    try:
        client_of: Any = distributed.Client
        client = await client_of(**where, asynchronous=True, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, asyncio.TimeoutError) as problem:
        remedy = f"Check --scheduler, and that the scheduler runs. ({problem})"
        raise PlatformError("the scheduler cannot be reached", where=address, remedy=remedy) from problem
    try:
        yield Cluster(client, least_isolation)
    finally:
        with suppress(Exception):  # A scheduler that is gone needs no farewell.
            await client.close()


@dataclass
class Cluster:
    """The machines of a scheduler's workers."""

    client: Any
    least_isolation: Level
    # As many submissions as the workers have threads, earlier ones first. A scheduler that had more of them would give
    # them out in advance, by the time that it expects them to take; the next one would then wait behind one that
    # hangs, beside a worker that has nothing to do.
    _room: Admission = field(default_factory=lambda: Admission(0))
    _waiting: dict[str, Callable[[Phase], None]] = field(default_factory=dict)
    _labs: dict[str, bytes] = field(default_factory=dict)
    _engine: str = field(default_factory=fingerprint.engine_sha256)

    async def grade(self, order: Order, number: int, on_phase: Callable[[Phase], None]) -> tuple[Ending, Level]:
        """Grade a submission on one of the workers."""
        place = await self._room.take(Use.START, number)
        try:
            on_phase(Phase("", "waits for a worker"))
            parcel = await asyncio.to_thread(self._parcel, order)
            key = f"grade-{uuid.uuid4().hex}"
            self._waiting[key] = on_phase
            future = self.client.submit(grade_parcel, parcel, key=key, pure=False, priority=-number)
            try:
                ending, level, results = await future
            except asyncio.CancelledError:
                with suppress(Exception):
                    await future.cancel()
                raise
            except (Exception, CancelledError) as problem:
                return _lost(problem), Level.NONE
            finally:
                del self._waiting[key]
            if results:
                await asyncio.to_thread(_take_over, results, order.results)
            return ending, Level(level)
        finally:
            place.release()

    async def workers(self) -> int:
        """Return how many submissions the workers can grade at a time."""
        return sum((await self.client.nthreads()).values())

    async def watch(self) -> None:
        """Follow which workers there are and what they do, until cancelled."""
        while True:
            with suppress(OSError, asyncio.TimeoutError):
                self._room.resize(await self.workers())
                for worker, keys in (await self.client.processing()).items():
                    for on_phase in filter(None, (self._waiting.get(str(key)) for key in keys)):
                        on_phase(Phase("", f"with {worker}"))
            await asyncio.sleep(_WATCH_S)

    def _parcel(self, order: Order) -> bytes:
        lab = self._labs.setdefault(order.rubric.sha256, packed_files(fingerprint.lab_files(order.rubric)))
        own = order.options.interpreter == Path(sys.executable)
        assert isinstance(order.handed, Handed)
        with taken_in(order.handed, prefix=scratch_prefix()) as intake:
            parcel = Parcel(self._engine, replace(order, handed=intake), packed(intake.folder), lab, own)
            return pickle.dumps(parcel)


def _take_over(results: bytes, folder: Path) -> None:
    unpack(results, folder)
    make_durable(folder)


def _lost(problem: BaseException) -> GraderError:
    if type(problem).__name__ == "KilledWorker":
        return GraderError("each of the workers that had it was lost", remedy=_LOST)
    if isinstance(problem, CancelledError):
        return GraderError("the scheduler was lost", remedy=_LOST)
    return GraderError(f"the cluster failed: {type(problem).__name__}: {problem}", remedy=_LOST)
