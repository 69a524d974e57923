"""A session's side of the watch for delays by the machine; see `confine.cpu_watch`."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Iterable
from contextlib import suppress

from confine.cpu_watch import main
from grader.live.process.forked import Program
from grader.live.process.process import RunningProcess
from grader.live.process.waiting import within
from grader.recording.session import ProcessRun

#: The limit of a demoted process, as `ProcessRun.limit` names limits.
COMPUTING = "computing"
_STOP_S, _ANSWER_S = 3.0, 1.0
_ADDRESS_SPACE_BYTES = 1024**3


class CpuWatch:
    """The watch of one session; without it, only samples twice a second show delays."""

    def __init__(self) -> None:
        self._running: RunningProcess | None = None
        self._runs: dict[str, ProcessRun] = {}
        self._calm_s: asyncio.Future[float] | None = None

    async def start(self, environment: dict[str, str]) -> RunningProcess:
        """Start the watching process, and return it."""
        run = ProcessRun("cpu watch", "grader", ["python", "-m", "confine.cpu_watch"])
        program = Program(run.name, main, environment, _ADDRESS_SPACE_BYTES)
        self._running = await RunningProcess.fork(run, program, on_message=self._hear)
        return self._running

    def follow(self, processes: Iterable[RunningProcess]) -> None:
        """Watch the present threads of some processes, on the cores to which these are held."""
        if self._running is None:
            return
        for process in processes:
            if process is not self._running and process.alive and process.threads:
                self._follow(self._running, process)

    def _follow(self, watch: RunningProcess, process: RunningProcess) -> None:
        run = process.run
        name = f"{run.name} {run.started_ns}"  # a program may be started twice
        self._runs[name] = run
        asked = {
            "name": name,
            "core": run.core,
            "is_confined": run.role == "student",
            "threads": process.threads,
        }
        watch.write((json.dumps(asked) + "\n").encode())

    async def calm_s(self, since_ns: int) -> float:
        """Return the undisturbed time of the student's processes since a time, in s; inf if the watch does not answer."""
        if self._running is None or not self._running.alive:
            return math.inf
        self._calm_s = asyncio.get_running_loop().create_future()
        self._running.write((json.dumps({"calm_since": since_ns}) + "\n").encode())
        with suppress(asyncio.TimeoutError):
            return await within(self._calm_s, _ANSWER_S)
        return math.inf

    async def stop(self) -> None:
        """End the watch, and note the delays that it has seen."""
        if self._running is not None:
            self._running.write(b"", last=True)
            await self._running.wait_exit(_STOP_S)
            await self._running.kill()

    def _hear(self, line: bytes) -> None:
        said = json.loads(line)
        if isinstance(said, str):
            self._runs[said].limit = COMPUTING
        elif isinstance(said, dict):
            for name, disturbed in said.items():
                self._runs[name].disturbed = disturbed
        elif self._calm_s is not None and not self._calm_s.done():
            self._calm_s.set_result(float(said))
