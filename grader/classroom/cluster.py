"""Grading on other machines through a Dask scheduler; submissions and results travel as bytes.

Each worker grades as this machine would: in a process of its own for each submission, and within the slots of the
worker's machine. The scheduler gives the submissions of a lost worker to others.
"""

from __future__ import annotations

import asyncio
import io
import logging
import pickle
import sys
import tarfile
import tempfile
import uuid
from collections.abc import AsyncIterator, Callable
from concurrent.futures import CancelledError
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any

from confine.isolation import Level
from confine.scratch import scratch_prefix
from grader.classroom import fingerprint
from grader.classroom.job import Ending, Job
from grader.classroom.scheduler import Machine
from grader.classroom.worker import Here
from grader.errors import GraderError, PlatformError
from grader.files import atomic_replacement
from grader.live.sandbox.course_ros import installation_at, require_usable
from grader.live.sandbox.installation import Installation
from grader.live.sandbox.probing import probe_isolation
from grader.live.session.runner import Progress
from grader.pipeline import PARTS
from grader.submission.extraction import Intake, SubmissionSource, open_submission

_CONNECT_S = 10
_WATCH_S = 1.0
_POLL_S = 0.2
_WORKERS_LOST = (
    "Read the workers' logs, then run the same command again: finished submissions are kept."
)
_SCHEDULER_LOST = (
    "Start a scheduler again, then run the same command: finished submissions are kept."
    " Without --scheduler, it grades the others here."
)


@dataclass(frozen=True)
class Bundle:
    """All data for grading a submission on another machine."""

    #: Hash of the sending grader; the worker must have the same one.
    engine: str
    job: Job
    #: The extracted files, packed.
    submission: bytes
    #: The files beside the rubric.
    lab: bytes
    own_interpreter: bool
    #: Contents of the installation of ROS for students' programs; empty for wheels.
    ros: list[str] = field(default_factory=list)


def packed(files: dict[str, Path]) -> bytes:
    """Return files as an archive, with given names."""
    stream = io.BytesIO()
    with tarfile.open(
        fileobj=stream, mode="w:gz", compresslevel=1, format=tarfile.PAX_FORMAT
    ) as archive:
        for name, path in files.items():
            archive.add(path, name, recursive=False)
    return stream.getvalue()


def unpack(content: bytes, folder: Path) -> None:
    """Write the files of an archive below an empty folder; raises ValueError unless all are files with plain names."""
    with tarfile.open(fileobj=io.BytesIO(content), mode="r:gz") as archive:
        for member in archive:
            path = PurePosixPath(member.name)
            file = archive.extractfile(member) if member.isreg() else None
            if file is None or path.is_absolute() or ".." in path.parts:
                raise ValueError(f"{member.name!r} cannot be part of a bundle")
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(file.read())


def grade_bundle(bundle: bytes) -> tuple[Ending, str, bytes]:
    """Grade a submission on the calling machine, as a worker.

    Returns the ending, the level of confinement, and the packed results; recordings are packed even without points.
    """
    sent: Bundle = pickle.loads(bundle)
    if sent.engine != fingerprint.engine_sha256():
        remedy = "Install the same version of grade, Python and the ROS 2 packages on all machines."
        return (
            PlatformError("a worker's grade differs from the one here", remedy=remedy),
            Level.NONE.value,
            b"",
        )
    with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as scratch:
        try:
            job = _laid_out(sent, Path(scratch))
        except PlatformError as problem:
            return problem, Level.NONE.value, b""
        isolation = probe_isolation(job.options.interpreter)
        with Here(isolation, Machine.of(isolation, job.options.jobs)) as here:
            ending, _ = asyncio.run(here.grade(job, lambda progress: None))
        made = dict(fingerprint.files_below(job.results))
        return ending, isolation.level.value, packed(made) if made else b""


def _laid_out(sent: Bundle, scratch: Path) -> Job:
    lab, submission = scratch / "lab", scratch / "submission"
    for folder, content in ((lab, sent.lab), (submission, sent.submission)):
        folder.mkdir()
        unpack(content, folder)
    assert isinstance(sent.job.source, Intake)
    source = replace(sent.job.source, folder=submission)
    rubric = sent.job.rubric.model_copy(update={"folder": lab})
    options = sent.job.options
    if sent.own_interpreter:
        options = replace(options, interpreter=Path(sys.executable))
    if options.ros is not None:
        ros = same_installation(options.ros, sent.ros)
        options = replace(options, ros=ros, interpreter=ros.interpreter)
    results = scratch / "results"
    return replace(sent.job, source=source, results=results, rubric=rubric, options=options)


def same_installation(sent: Installation, contents: list[str]) -> Installation:
    """Return the installation of ROS in the same folder of this machine.

    Parameters
    ----------
    sent
        The installation on the machine of the command.
    contents
        Its contents there.

    Raises
    ------
    PlatformError
        It is missing here, does not work, or has another version or other packages.
    """
    assert sent.prefix is not None
    found = installation_at(sent.prefix, sent.interpreter)
    require_usable(found)
    if found.contents() != contents:
        raise PlatformError(
            "a worker's installation of ROS differs from the one here",
            location=str(sent.prefix),
            remedy="Install the same packages of ROS on all machines, in the same folder.",
        )
    return found


@asynccontextmanager
async def cluster(address: str, note: Callable[[str], None]) -> AsyncIterator[Cluster]:
    """Connect to a scheduler, by its address or by the file that it wrote; raises PlatformError if that fails."""
    import distributed

    # Its errors reach the caller as exceptions.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    location: dict[str, Any] = {"address": address}
    if Path(address).is_file():
        location = {"scheduler_file": address}
    elif ":" not in address:
        raise _no_file(address)
    try:
        client_of: Any = distributed.Client
        client = await client_of(
            **location, asynchronous=True, timeout=_CONNECT_S, set_as_default=False
        )
    except (TimeoutError, OSError, ValueError) as problem:
        remedy = f"Check --scheduler, and that the scheduler runs. ({problem})"
        raise PlatformError(
            "the scheduler cannot be reached", location=address, remedy=remedy
        ) from problem
    opened = Cluster(client)
    if not await opened.workers():
        note("The scheduler has no workers yet; waiting for them.")
    watching = asyncio.ensure_future(opened.watch())
    try:
        yield opened
    finally:
        watching.cancel()
        # A lost scheduler needs no goodbye.
        with suppress(Exception):
            await client.close()


def _no_file(address: str) -> PlatformError:
    """Return the error for an address without a port, if no file has that name."""
    remedy = (
        "A scheduler writes this file when it has started. Wait for it, check the path, or give"
        " an address such as tcp://127.0.0.1:8786."
    )
    return PlatformError("there is no such file of a scheduler", location=address, remedy=remedy)


@dataclass
class Cluster:
    """The machines of a scheduler's workers."""

    client: Any
    # As many submissions as the workers have threads, earlier ones first. A scheduler that had more of them would give
    # them out in advance, by the time that it expects them to take; the next one would then wait behind one that
    # hangs, beside a worker that has nothing to do.
    _threads: int = 0
    _next: asyncio.Lock = field(default_factory=asyncio.Lock)
    _under_way: dict[str, Callable[[Progress], None]] = field(default_factory=dict)
    _labs: dict[str, bytes] = field(default_factory=dict)
    _engine: str = field(default_factory=fingerprint.engine_sha256)

    async def grade(
        self, job: Job, on_progress: Callable[[Progress], None]
    ) -> tuple[Ending, Level]:
        """Grade a submission on one of the workers."""
        key = f"grade-{uuid.uuid4().hex}"
        async with self._next:
            while self._is_busy():
                await asyncio.sleep(_POLL_S)
            self._under_way[key] = on_progress
        try:
            on_progress(Progress("", "waits for a worker"))
            bundle = await asyncio.to_thread(self._bundle, job)
            try:
                ending, level, results = await self._graded(bundle, key)
            except (Exception, CancelledError) as problem:
                return self._lost(problem), Level.NONE
        finally:
            del self._under_way[key]
        if results:
            with atomic_replacement(job.results, PARTS) as new:
                await asyncio.to_thread(unpack, results, new)
        return ending, Level(level)

    def _is_busy(self) -> bool:
        """Tell whether another submission has to wait; none waits for the workers of a lost scheduler."""
        if self.client.status == "closed":
            return False
        return len(self._under_way) >= self._threads

    async def _graded(self, bundle: bytes, key: str) -> tuple[Ending, str, bytes]:
        """Grade a bundle on a worker; raises an exception of Dask if workers or the scheduler are lost."""
        future = self.client.submit(grade_bundle, bundle, key=key, pure=False)
        try:
            graded: tuple[Ending, str, bytes] = await future
            return graded
        except asyncio.CancelledError:
            with suppress(Exception):
                await future.cancel()
            raise

    def _lost(self, problem: BaseException) -> GraderError:
        """Return the error of a submission without a result from the workers."""
        if type(problem).__name__ == "KilledWorker":
            lost = "the connection to each worker that graded it was lost"
            return GraderError(lost, remedy=_WORKERS_LOST)
        # A client without a scheduler cancels submissions under way. When it is closed, it refuses later ones.
        is_lost = self.client.status == "closed"
        if isinstance(problem, CancelledError):
            is_lost = True
        if is_lost:
            return GraderError("the connection to the scheduler was lost", remedy=_SCHEDULER_LOST)
        words = f"the cluster failed: {type(problem).__name__}: {problem}"
        return GraderError(words, remedy=_WORKERS_LOST)

    async def workers(self) -> int:
        """Return the number of submissions that the workers can grade at a time."""
        return sum((await self.client.nthreads()).values())

    async def watch(self) -> None:
        """Follow the workers and their progress, until cancelled."""
        while True:
            with suppress(OSError, asyncio.TimeoutError):
                self._threads = await self.workers()
                for worker, keys in (await self.client.processing()).items():
                    for on_progress in filter(
                        None, (self._under_way.get(str(key)) for key in keys)
                    ):
                        on_progress(Progress("", f"with {worker}"))
            await asyncio.sleep(_WATCH_S)

    def _bundle(self, job: Job) -> bytes:
        lab = self._labs.setdefault(job.rubric.sha256, packed(fingerprint.lab_files(job.rubric)))
        assert isinstance(job.source, SubmissionSource)
        with open_submission(job.source, prefix=scratch_prefix()) as intake:
            own = job.options.interpreter == Path(sys.executable)
            sent = replace(job, source=intake)
            files = dict(fingerprint.files_below(intake.folder))
            bundle = Bundle(self._engine, sent, packed(files), lab, own, _contents_of(job))
            return pickle.dumps(bundle)


def _contents_of(job: Job) -> list[str]:
    """Return the contents of the installation of ROS for students' programs; empty for wheels."""
    if job.options.ros is None:
        return []
    return job.options.ros.contents()
