"""A session's side of the director process, see `grader.live.ros_node.director`."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from grader.live.process.process import RunningProcess
from grader.recording.record import from_plain
from grader.recording.session import (
    GraphSnapshot,
    ProcessRun,
    Published,
    RecordingGap,
    SessionRecord,
    Trusted,
)

_START_S = 20.0
_STOP_S = 8.0
#: What it reports: list of the record -> kind of its entries, if that is a dataclass.
_REPORTED = {
    "graph": GraphSnapshot,
    "trusted": Trusted,
    "published": Published,
    "unrecorded": RecordingGap,
}

#: Outcome and result of a request, or of a step.
Answer = tuple[str, dict[str, Any]]


class DirectorClient:
    """Sends requests to the director, `running` with `hear` for its messages, and records what it reports besides."""

    running: RunningProcess

    def __init__(self, record: SessionRecord) -> None:
        self._record = record
        self.run = ProcessRun(
            "director", "grader", ["python", "-m", "grader.live.ros_node.director"]
        )
        self._answer: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()

    async def wait_ready(self) -> None:
        """Wait until it is ready, or raise `RuntimeError` if it does not get so."""
        if (await self._answered(_START_S))[0] != "done":
            raise RuntimeError(f"the director did not start: {self._last_words(5)}")
        self.running.put_standing()

    def hear(self, line: bytes) -> None:
        """Take a message of its, which is a line of JSON."""
        kind, what = json.loads(line)
        if kind != "answer":
            getattr(self._record, kind).append(
                from_plain(_REPORTED[kind], what) if kind in _REPORTED else what
            )
        elif not self._answer.done():
            self._answer.set_result((what[0], what[1]))

    def _last_words(self, lines: int) -> str:
        return "; ".join(line.text for line in self.run.output[-lines:])

    async def ask(self, request: dict[str, Any]) -> Answer:
        """Have it carry out a request."""
        self._answer = asyncio.get_running_loop().create_future()
        self._send(request)
        return await self._answered()

    def cancel(self) -> None:
        """End the request that is under way."""
        self._send({"op": "cancel"})

    async def stop(self) -> None:
        """Have it finish the bag, and end it."""
        if not self.running.alive:
            self._record.problems.append(f"the recorder died: {self._last_words(3)}")
        self._send({"op": "stop"})
        await self.running.wait_exit(_STOP_S)
        await self.running.kill()
        if self.run.exit_status != 0:
            self._record.problems.append("the recorder did not end properly; its bag was recovered")

    async def _answered(self, timeout_s: float | None = None) -> Answer:
        answer = self._answer
        either: list[asyncio.Future[Any]] = [answer, self.running.exited]
        await asyncio.wait(either, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
        return answer.result() if answer.done() else ("failed", {"problem": "the director ended"})

    def _send(self, request: dict[str, Any]) -> None:
        self.running.write((json.dumps(request) + "\n").encode())
