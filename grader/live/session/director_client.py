"""A session's side of the director process, see `grader.live.ros_node.director`."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from grader.lab.steps.base import Answer, Step, StepResult
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

#: Time in s that the director may take to start.
_START_S = 20.0
#: Time in s that the director may take to end.
_STOP_S = 8.0


class DirectorClient:
    """Sends requests to the director, which is `running` with `hear` for its messages, and records its reports."""

    running: RunningProcess

    def __init__(self, record: SessionRecord) -> None:
        self._record = record
        self.run = ProcessRun(
            "director", "grader", ["python", "-m", "grader.live.ros_node.director"]
        )
        self._answer: asyncio.Future[list[Any]] = asyncio.get_running_loop().create_future()

    async def wait_ready(self) -> None:
        """Wait until the director is ready; raises RuntimeError if it does not start."""
        outcome, _ = await self._answered(_START_S)
        if outcome != "done":
            raise RuntimeError(f"the director did not start: {self._last_words(5)}")
        self.running.put_standing()

    def hear(self, line: bytes) -> None:
        """Take a message of the director, such as `["problems", "the disk is full"]`."""
        record = self._record
        kind, value = json.loads(line)
        if kind == "answer":
            if not self._answer.done():
                self._answer.set_result(value)
        elif kind == "graph":
            record.graph.append(from_plain(GraphSnapshot, value))
        elif kind == "trusted":
            record.trusted.append(from_plain(Trusted, value))
        elif kind == "published":
            record.published.append(from_plain(Published, value))
        elif kind == "unrecorded":
            record.unrecorded.append(from_plain(RecordingGap, value))
        elif kind == "problems":
            record.problems.append(value)
        else:
            raise ValueError(f"the director reports {kind!r}, which no record has")

    def _last_words(self, lines: int) -> str:
        return "; ".join(line.text for line in self.run.output[-lines:])

    async def do(self, step: Step) -> Answer:
        """Have the director do a step."""
        parameters = step.model_dump(mode="json", by_alias=True)
        processes = len(self._record.processes)
        outcome, result = await self._ask(
            {"op": step.kind, "processes": processes, "step": parameters}
        )
        return Answer(outcome, step.result.of_plain(result))

    async def forget(self) -> None:
        """Have the director take the present endpoints for endpoints of an ended process."""
        await self._ask({"op": "forget"})

    async def _ask(self, request: dict[str, Any]) -> list[Any]:
        self._answer = asyncio.get_running_loop().create_future()
        self._send(request)
        return await self._answered()

    def cancel(self) -> None:
        """End the request that is under way."""
        self._send({"op": "cancel"})

    async def stop(self) -> None:
        """Have the director finish the bag, and end it."""
        if not self.running.alive:
            self._record.problems.append(f"the recorder died: {self._last_words(3)}")
        self._send({"op": "stop"})
        await self.running.wait_exit(_STOP_S)
        await self.running.kill()
        if self.run.exit_status != 0:
            self._record.problems.append("the recorder did not end properly; its bag was recovered")

    async def _answered(self, timeout_s: float | None = None) -> list[Any]:
        """Return outcome and result of the request under way."""
        answer = self._answer
        either: list[asyncio.Future[Any]] = [answer, self.running.exited]
        await asyncio.wait(either, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
        if answer.done():
            return answer.result()
        return ["failed", StepResult("the director ended").to_plain()]

    def _send(self, request: dict[str, Any]) -> None:
        self.running.write((json.dumps(request) + "\n").encode())
