"""Runs a submission's sessions, each in a sandbox of its own, side by side as the cores allow."""

from __future__ import annotations

import asyncio
import json
import os
import pickle
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Coroutine, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from confine.isolation import Isolation, free_slot
from confine.scratch import remove_tree, scratch_prefix
from grader.errors import PlatformError, ProcessLostError
from grader.lab.rubric import Rubric, SessionSpec
from grader.live.builds.build import AMENT_CMAKE
from grader.live.builds.crash_library import crash_library
from grader.live.process.waiting import side_by_side, within
from grader.live.sandbox.environment import NativeLaunch
from grader.live.sandbox.installation import Installation
from grader.live.session.fork_server import ForkServer
from grader.live.session.plan import SessionPlan
from grader.live.session.program import StudentProgram
from grader.live.session.scheduler import Slot
from grader.recording.session import SessionRecord, StepRun
from grader.recording.submission import SubmissionRecord

#: Time that a session may take beyond its own limit before its sandbox is killed.
_GRACE_S = 25.0
#: Time in s that a sandbox may take to report its process id, and again to end.
_END_S = 5.0
_REMEDY = "Check whether memory or processes ran out and whether /dev/shm exists; `grade doctor` shows more."


@dataclass(frozen=True)
class Progress:
    """The current work of a session; of the grader itself if the session is empty."""

    session: str
    text: str
    step: int = 0
    steps: int = 0
    ended: bool = False


#: Keys of steps with names of topics, services and nodes.
_NAMING = (
    "node",
    "publisher",
    "subscription",
    "service",
    "action",
    "action_client",
    "first_message_on",
)


def given_in_steps(rubric: Rubric, *keys: str, sessions: Sequence[str] | None = None) -> list[str]:
    """Return the names under some keys of all or some sessions' steps; under `type` the names of interfaces."""
    listed = (
        rubric.sessions.values()
        if sessions is None
        else [rubric.sessions[name] for name in sessions]
    )
    steps = [step for session in listed for step in session.steps]
    return sorted(
        {str(step.parameters[key]) for step in steps for key in keys if step.parameters.get(key)}
    )


def likely_used(rubric: Rubric, sessions: Sequence[str] | None = None) -> list[str | Path]:
    """Return the interface types and programs that some or all sessions are likely to use, see `ForkServer`."""
    types = given_in_steps(rubric, "type", sessions=sessions)
    return [*types, *map(Path.resolve, rubric.reference_programs)]


@dataclass(frozen=True)
class SessionRunner:
    """The sessions of one submission, ready to be recorded, each in a folder of its own below `recordings`.

    Parameters
    ----------
    slots
        Gives the slots of sessions for an attempt, see `Scheduler.slots`.
    attempt
        1 for the first recording, more if an earlier recording left something undecided.
    disturbed
        Sessions in which an earlier recording showed interference with the grader's own processes.
    lacking
        Session -> reason why this machine cannot give everything that the session needs.
    """

    rubric: Rubric
    submission: SubmissionRecord
    staged: Path
    programs: dict[str, StudentProgram]
    recordings: Path
    isolation: Isolation
    installation: Installation
    seed: int
    versions: dict[str, str]
    forks: ForkServer
    slots: Callable[[Sequence[SessionSpec], int], Slot]
    native: NativeLaunch | None = None
    attempt: int = 1
    disturbed: frozenset[str] = frozenset()
    interfaces: Path | None = None
    lacking: Mapping[str, str] = field(default_factory=dict)

    def record(self, chosen: Sequence[str], on_progress: Callable[[Progress], None]) -> None:
        """Record the chosen sessions; returns when all have ended.

        A session that cannot be run to its end leaves a recording that says so; nothing stays if the grader is asked
        to end.
        """
        run_to_an_end(self._record_all(chosen, on_progress))

    async def _record_all(
        self, chosen: Sequence[str], on_progress: Callable[[Progress], None]
    ) -> None:
        specs = [self.rubric.sessions[name] for name in chosen]
        specs.sort(key=lambda spec: -spec.typical_s)
        slot = self.slots(specs, self.attempt)
        text = "recorded"
        if self.attempt > 1:
            text += " retry, as something was undecided"

        async def one(spec: SessionSpec) -> None:
            async with slot(spec):
                await self._record_one(spec, on_progress)
                on_progress(Progress(spec.id, text, ended=True))

        await side_by_side(one(spec) for spec in specs)

    async def _record_one(self, spec: SessionSpec, on_progress: Callable[[Progress], None]) -> None:
        folder = self.recordings / spec.id
        partial = self.recordings / f".{spec.id}.partial"
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        scratch = Path(tempfile.mkdtemp(prefix=scratch_prefix()))
        try:
            with free_slot() as slot:
                plan = self._plan(spec, partial, scratch, slot)
                (scratch / "plan").touch(mode=0o600)  # the seed is in it
                (scratch / "plan").write_bytes(pickle.dumps(plan))
                await self._run_sandbox(spec, scratch, on_progress)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise
        finally:
            remove_tree(scratch)
        shutil.rmtree(folder, ignore_errors=True)
        partial.rename(folder)

    def _plan(self, spec: SessionSpec, folder: Path, scratch: Path, slot: int) -> SessionPlan:
        return SessionPlan(
            record=SessionRecord(
                spec.id,
                attempt=self.attempt,
                disturbed_before=spec.id in self.disturbed,
                seed=self.seed,
                isolation=self.isolation.describe(),
                versions=self.versions,
                problems=[self.lacking[spec.id]] if spec.id in self.lacking else [],
            ),
            steps=[(StepRun(s.kind, s.parameters, s.label), s.step) for s in spec.steps],
            folder=folder.resolve(),
            scratch=scratch,
            staged=self.staged.resolve(),
            interfaces=self.interfaces,
            crash_library=self._crash_library(),
            programs=self.programs,
            sources={a.name: a.path for a in self.submission.artifacts if a.path is not None},
            reference={
                name: {"file": str((self.rubric.folder / ref.file).resolve()), "node": ref.node}
                for name, ref in self.rubric.reference.items()
            },
            expected=given_in_steps(self.rubric, *_NAMING),
            isolation=self.isolation,
            installation=self.installation,
            slot=slot,
            domain_id=0 if self.isolation.namespaces else slot,
            timeout_s=spec.timeout_s,
            native=self.native,
        )

    def _crash_library(self) -> Path | None:
        """Return the library for crashes of compiled programs; None without a package that compiles some."""
        for package in self.submission.packages:
            if package.build_type == AMENT_CMAKE:
                return crash_library()
        return None

    async def _run_sandbox(
        self, spec: SessionSpec, scratch: Path, on_progress: Callable[[Progress], None]
    ) -> None:
        on_progress(Progress(spec.id, "starting"))
        messages = await self.forks.start_sandbox(
            self.isolation.form, scratch / "plan", scratch / "stderr"
        )
        pid = asyncio.ensure_future(sandbox_pid(messages))
        try:
            await within(_follow(messages, pid, spec.id, on_progress), spec.timeout_s + _GRACE_S)
        except TimeoutError:
            pass
        finally:
            await _end(messages, pid)


async def sandbox_pid(messages: asyncio.StreamReader) -> int:
    """Return the process id that ends a sandbox; raises PlatformError with the reason if there is no sandbox."""
    first = (await messages.readline()).decode("utf-8", "replace").strip()
    if not first:
        raise ProcessLostError("the process that starts sandboxes has ended", remedy=_REMEDY)
    if not first.isdecimal():
        raise PlatformError(f"a session cannot be started here: {first}", remedy=_REMEDY)
    return int(first)


async def _follow(
    messages: asyncio.StreamReader,
    pid: asyncio.Future[int],
    session: str,
    on_progress: Callable[[Progress], None],
) -> None:
    """Pass on the reports of a session, until its sandbox has ended."""
    await asyncio.shield(pid)
    async for line in messages:
        with suppress(ValueError, KeyError):
            event: dict[str, Any] = json.loads(line)
            on_progress(Progress(session, event["text"], event["index"], event["of"]))


async def _end(messages: asyncio.StreamReader, pid: asyncio.Future[int]) -> None:
    """End a sandbox that has not ended by itself, and return when nothing of it is left."""
    with suppress(asyncio.TimeoutError, PlatformError):
        number = await within(pid, _END_S)
        if not messages.at_eof():
            with suppress(ProcessLookupError):
                os.killpg(number, signal.SIGKILL)
            # The process holds the pipe as long as it exists.
            await within(messages.read(), _END_S)


def run_to_an_end(work: Coroutine[Any, Any, None]) -> None:
    """Run `work`; Ctrl-C, or a signal that asks the grader to end, cancels it once and lets it clean up.

    `asyncio` by itself cancels tasks a second time on its way out, in the midst of their cleaning up.
    """
    received: list[int] = []

    async def guarded() -> None:
        task, loop = asyncio.ensure_future(work), asyncio.get_running_loop()

        def end(number: int) -> None:
            received.append(number)
            if len(received) == 1:
                task.cancel()

        numbers = _heeded_signals()
        for number in numbers:
            loop.add_signal_handler(number, end, number)
        try:
            await task
        except asyncio.CancelledError:
            if not received:
                raise
        finally:
            for number in numbers:
                loop.remove_signal_handler(number)

    asyncio.run(guarded())
    if received:
        raise KeyboardInterrupt if received[0] == signal.SIGINT else SystemExit(128 + received[0])


def _heeded_signals() -> list[signal.Signals]:
    """Return the signals that end the grader; one that the caller ignores (as `nohup` does) stays ignored."""
    if threading.current_thread() is not threading.main_thread():
        return []
    asking = [n for n in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) == signal.SIG_DFL]
    return asking if signal.getsignal(signal.SIGINT) == signal.SIG_IGN else [signal.SIGINT, *asking]
