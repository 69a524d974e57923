"""The other end of `grader.batch.one`: starts the process, grants its turns, and ends it when it hangs."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import pickle
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from grader.batch.admission import Admission, Place, Use
from grader.batch.one import FIRST_TURN
from grader.batch.order import Ending, Order, Phase, problem_of
from grader.errors import GraderError
from grader.live.scratch import remove_leavings, scratch_prefix

#: How long it may take to end when it is asked to.
_END_S = 15.0
#: The last line holds the whole result.
_MOST_LINE_BYTES = 64 * 1024 * 1024


@dataclass(frozen=True)
class Limits:
    """How long things may take, in seconds, before the process is ended."""

    #: For reading, or judging, a submission.
    work_s: float = 120.0
    #: For a session beyond its own limit, until its process has ended it by itself.
    cell_grace_s: float = 60.0
    #: Without a turn and without asking for one.
    idle_s: float = 60.0
    #: In turns for which it has the machine for itself. After these it is not ended, but recorded beside the others.
    alone_s: float = 60.0


async def grade_in_process(
    order: Order, admission: Admission, number: int, on_phase: Callable[[Phase], None], limits: Limits | None = None
) -> Ending:
    """Grade one submission in a process of its own; returns how it ended, and never fails because of it.

    Parameters
    ----------
    number : int
        The submission's place in the queue.
    """
    first = await admission.take(Use.START, number)
    on_phase(Phase("", "reading"))
    supervised = _Supervised(order, admission, number, on_phase, limits or Limits(), {FIRST_TURN: first})
    return await supervised.run()


@dataclass
class _Supervised:
    order: Order
    admission: Admission
    number: int
    on_phase: Callable[[Phase], None]
    limits: Limits
    held: dict[int, Place]
    asking: dict[int, asyncio.Task[None]] = field(default_factory=dict)
    timers: dict[int | None, asyncio.TimerHandle] = field(default_factory=dict)
    alone_since_s: dict[int, float] = field(default_factory=dict)
    alone_s: float = 0.0
    ending: Ending | None = None
    process: asyncio.subprocess.Process = field(init=False)

    async def run(self) -> Ending:
        try:
            with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as scratch:
                await self._run(Path(scratch))
        except (OSError, ValueError) as error:
            self.ending = self.ending or problem_of(error)
        finally:
            for task in self.asking.values():
                task.cancel()
            for place in self.held.values():
                place.release()
            for timer in self.timers.values():
                timer.cancel()
        return self.ending or GraderError("the grader's process ended without a word", remedy="Grade it by itself.")

    async def _run(self, scratch: Path) -> None:
        self.order.write(scratch / "order")
        said = scratch / "stderr"
        with said.open("wb") as errors:
            self.process = await asyncio.create_subprocess_exec(
                *("setpriv", "--pdeathsig", "KILL", sys.executable, "-I", "-m", "grader.batch.one"),
                str(scratch / "order"),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=errors,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
                start_new_session=True,
                limit=_MOST_LINE_BYTES,
            )
        self._set_timer(FIRST_TURN, self.limits.work_s, "reading the submission")
        try:
            await self._follow()
            await self.process.wait()
        finally:
            await _end(self.process)
            remove_leavings()
        if self.ending is None:
            self.ending = _broken(self.process.returncode, said)

    async def _follow(self) -> None:
        assert self.process.stdout is not None
        async for line in self.process.stdout:
            message: dict[str, Any] = json.loads(line)
            if "ask" in message:
                self._on_ask(message)
                await asyncio.sleep(0)  # It queues before the turn that is freed next goes to anyone else.
            elif "free" in message:
                self._on_free(int(message["free"]))
            elif "now" in message:
                self._on_work(int(message["now"]), str(message["what"]))
            elif "ending" in message:
                self.ending = self.ending or pickle.loads(base64.b64decode(message["ending"]))
            else:
                step = f" ({message['step']} of {message['steps']})" if message["steps"] else ""
                self.on_phase(Phase(message["session"], message["text"] + step, message["ended"]))
            self._watch_idleness()

    # -- turns --------------------------------------------------------------------------------

    def _on_ask(self, message: dict[str, Any]) -> None:
        turn = int(message["ask"])
        if message["for"] == "cell":
            spec = self.order.rubric.sessions[message["session"]]
            alone = message["alone"] and self._been_alone_s() < self.limits.alone_s
            self.on_phase(Phase(spec.id, "waits to run alone" if alone else "waits"))
            limit_s, what = spec.timeout_s + self.limits.cell_grace_s, f"the session '{spec.id}'"
            granted = self._grant(turn, Use.CELL, limit_s, what, Phase(spec.id, "starting"), alone=alone)
        else:
            phase = Phase("", message["what"])
            granted = self._grant(turn, Use.WORK, self.limits.work_s, message["what"], phase)
        self.asking[turn] = asyncio.ensure_future(granted)
        self.asking[turn].add_done_callback(self._on_asked)

    def _on_asked(self, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if isinstance(error, Exception):
            self.ending = self.ending or problem_of(error)
            self._kill()

    def _been_alone_s(self) -> float:
        return self.alone_s + sum(time.monotonic() - since for since in self.alone_since_s.values())

    def _grant(
        self, turn: int, use: Use, limit_s: float, what: str, phase: Phase, *, alone: bool = False
    ) -> Coroutine[Any, Any, None]:
        async def grant() -> None:
            self.held[turn] = await self.admission.take(use, self.number, alone=alone)
            del self.asking[turn]
            if alone:
                self.alone_since_s[turn] = time.monotonic()
            self._set_timer(turn, limit_s, what)
            self._watch_idleness()
            self.on_phase(phase)
            assert self.process.stdin is not None
            self.process.stdin.write(f"{turn}\n".encode())

        return grant()

    def _on_work(self, turn: int, what: str) -> None:
        """Let a turn that is held already be used for work."""
        if turn in self.held:
            self._stop_timer(turn)
            self._set_timer(turn, self.limits.work_s, what)
            self.on_phase(Phase("", what))

    def _on_free(self, turn: int) -> None:
        if turn in self.held:
            self.held.pop(turn).release()
        elif turn in self.asking:
            self.asking.pop(turn).cancel()
        self._stop_timer(turn)
        if turn in self.alone_since_s:
            self.alone_s += time.monotonic() - self.alone_since_s.pop(turn)

    # -- limits -------------------------------------------------------------------------------

    def _set_timer(self, key: int | None, limit_s: float, what: str) -> None:
        self.timers[key] = asyncio.get_running_loop().call_later(limit_s, self._give_up, what, limit_s)

    def _stop_timer(self, key: int | None) -> None:
        if key in self.timers:
            self.timers.pop(key).cancel()

    def _watch_idleness(self) -> None:
        idle = not self.held and not self.asking
        if not idle:
            self._stop_timer(None)
        elif idle and None not in self.timers:
            self._set_timer(None, self.limits.idle_s, "waiting for the grader's process")

    def _give_up(self, what: str, limit_s: float) -> None:
        remedy = "Grade it by itself and watch; the other submissions are not concerned."
        self.ending = self.ending or GraderError(f"{what} took longer than {limit_s:g} s", remedy=remedy)
        self._kill()

    def _kill(self) -> None:
        with suppress(ProcessLookupError):
            self.process.kill()


async def _end(process: asyncio.subprocess.Process) -> None:
    """Ask the process to end if it has not, and see that it does."""
    if process.returncode is None:
        with suppress(ProcessLookupError):
            process.terminate()
        try:
            await asyncio.wait_for(process.wait(), _END_S)
        except asyncio.TimeoutError:
            with suppress(ProcessLookupError):
                process.kill()
    with suppress(asyncio.TimeoutError):
        await asyncio.wait_for(process.communicate(), _END_S)


def _broken(status: int | None, said: Path) -> GraderError:
    """Say of a process that ended without an ending what is known."""
    how = f"status {status}" if status is None or status >= 0 else signal.Signals(-status).name
    lines = said.read_text(encoding="utf-8", errors="replace").strip().splitlines() if said.is_file() else []
    last = f": {lines[-1]}" if lines else ""
    remedy = "Grade it by itself; a SIGKILL that nobody sent means that the machine ran out of memory."
    return GraderError(f"the grader's process ended with {how}{last}", remedy=remedy)
