"""A session's side of the director process, see `grader.live.director`."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from grader.live.process import RunningProcess
from grader.recording.record import from_plain
from grader.recording.session import GraphSnapshot, ProcessRun, Published, SessionRecord, Trusted, Unrecorded

_START_S = 20.0
_STOP_S = 8.0


class DirectorClient:
    """Sends requests to the director, and records what it reports besides.

    Attributes
    ----------
    run : ProcessRun
        Its record.
    running : RunningProcess
        The process, started with `hear` for its messages.
    """

    running: RunningProcess

    def __init__(self, record: SessionRecord) -> None:
        self._record = record
        self.run = ProcessRun("director", "grader", ["python", "-m", "grader.live.director"])
        self._ready, self._stopped = asyncio.Event(), asyncio.Event()
        self._answer: asyncio.Future[dict[str, Any]] | None = None

    async def wait_ready(self) -> None:
        """Wait until it is ready.

        Raises
        ------
        RuntimeError
            If it does not get ready.
        """
        await self._wait(self._ready, _START_S)
        if not self._ready.is_set():
            raise RuntimeError(f"the director did not start: {self._last_words(5)}")
        self.running.put_standing()

    def hear(self, line: bytes) -> None:
        """Take a message of its, which is a line of JSON."""
        event = json.loads(line)
        if event["event"] == "graph":
            self._record.graph.append(from_plain(GraphSnapshot, event["graph"]))
        elif event["event"] == "ready":
            self._record.trusted.append(from_plain(Trusted, event["trusted"]))
            self._ready.set()
        elif event["event"] == "published":
            self._record.published.append(from_plain(Published, event["published"]))
        elif event["event"] == "stopped":
            self._record.problems += event["problems"]
            self._record.unrecorded += [from_plain(Unrecorded, plain) for plain in event["unrecorded"]]
            self._stopped.set()
        elif self._answer is not None and not self._answer.done():
            self._answer.set_result(event)

    def _last_words(self, lines: int) -> str:
        return "; ".join(line.text for line in self.run.output[-lines:])

    async def ask(self, request: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        """Have it carry out a request; returns the outcome and the result."""
        self._answer = asyncio.get_running_loop().create_future()
        self._send(request)
        either: list[asyncio.Future[Any]] = [self._answer, self.running.exited]
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        if not self._answer.done():
            return "failed", {"problem": "the director ended"}
        answer = self._answer.result()
        return answer["outcome"], answer["result"]

    def cancel(self) -> None:
        """End the request that is under way."""
        self._send({"op": "cancel"})

    async def stop(self) -> None:
        """Have it finish the bag, and end it."""
        if not self.running.alive:
            self._record.problems.append(f"the recorder died: {self._last_words(3)}")
        self._send({"op": "stop"})
        await self._wait(self._stopped, _STOP_S)
        if not self._stopped.is_set():
            self._record.problems.append("the recorder did not end in order; its bag was recovered")
        await self.running.wait_exit(1.0)
        await self.running.kill()

    async def _wait(self, event: asyncio.Event, timeout_s: float) -> None:
        waiting = asyncio.create_task(event.wait())
        either: set[asyncio.Task[Any]] = {waiting, self.running.exited}
        await asyncio.wait(either, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()

    def _send(self, request: dict[str, Any]) -> None:
        self.running.write((json.dumps(request) + "\n").encode())
