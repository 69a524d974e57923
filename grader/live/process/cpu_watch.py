"""A session's side of the watch for delays by the machine; see `confine.cpu_watch`."""

from __future__ import annotations

import asyncio
import json
import math
import os
import socket
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress

from confine.cpu_watch import main
from grader.live.process.forked import Program, read_pipe
from grader.live.process.process import RunningProcess
from grader.live.process.waiting import within
from grader.recording.session import ProcessRun

#: The limit of a demoted process, as `ProcessRun.limit` names limits.
COMPUTING = "computing"
_STOP_S, _ANSWER_S = 3.0, 1.0
_ADDRESS_SPACE_BYTES = 1024**3
#: Request for a channel.
_HELLO = b"session"


def watching_program(link: socket.socket) -> Program:
    """Return the watch of many sessions as a program, with its end of the link to them."""
    descriptor = link.fileno()

    def watch() -> None:
        main(socket.socket(fileno=descriptor))

    return Program("cpu watch", watch, {}, _ADDRESS_SPACE_BYTES, kept=(descriptor,))


class CpuWatch:
    """The watch of one session, by a link to the watching process; without it, only samples twice a second show delays."""

    def __init__(self, link: socket.socket | None) -> None:
        self._link = link
        self._requests: socket.socket | None = None
        self._listening: asyncio.Task[None] | None = None
        self._runs: dict[str, ProcessRun] = {}
        #: Name -> ids of its processes that the watch has.
        self._known: dict[str, set[int]] = {}
        #: Name -> the scheduling of its processes when it was last sent.
        self._sent: dict[str, object] = {}
        self._calm_s: asyncio.Future[float] | None = None

    async def start(self) -> None:
        """Open a channel."""
        if self._link is None:
            return
        self._requests, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._requests.setblocking(False)
        answers, writer = os.pipe()
        with theirs, suppress(OSError):  # Without a watch, the answers end at once.
            socket.send_fds(self._link, [_HELLO], [theirs.fileno(), writer])
        os.close(writer)
        self._listening = asyncio.create_task(self._listen(await read_pipe(answers)))

    def follow(self, processes: Iterable[RunningProcess]) -> None:
        """Watch the present threads of some processes, on the cores to which these are held."""
        for process in processes:
            if process.alive and process.pids:
                self._follow(process)

    def _follow(self, process: RunningProcess) -> None:
        run = process.run
        name = f"{run.name} {run.started_ns}"  # a program may be started twice
        self._runs[name] = run
        scheduling = process.scheduling
        if self._sent.get(name) == scheduling:
            return
        known = self._known.setdefault(name, set())
        asked = {"name": name, "core": run.core, "is_confined": run.role == "student"}
        descriptors = []
        for pid in set(process.pids) - known:
            with suppress(OSError):
                descriptors.append(os.pidfd_open(pid))
        known.update(process.pids)
        if self._ask(asked, descriptors):
            self._sent[name] = scheduling
        for descriptor in descriptors:
            os.close(descriptor)

    def _ask(self, asked: Mapping[str, object], descriptors: Sequence[int]) -> bool:
        """Send a request, and return whether it was sent: not if the watch has ended or falls far behind."""
        if self._requests is None:
            return False
        try:
            socket.send_fds(self._requests, [json.dumps(asked).encode()], descriptors)
        except OSError:
            return False
        return True

    async def calm_s(self, since_ns: int) -> float:
        """Return the undisturbed time of the student's processes since a time, in s; inf if the watch does not answer."""
        if self._listening is None or self._listening.done():
            return math.inf
        self._calm_s = asyncio.get_running_loop().create_future()
        self._ask({"calm_since": since_ns}, [])
        with suppress(asyncio.TimeoutError):
            return await within(self._calm_s, _ANSWER_S)
        return math.inf

    async def stop(self) -> None:
        """Close the channel, and note the delays that the watch has seen."""
        if self._requests is None or self._listening is None:
            return
        self._requests.close()
        with suppress(asyncio.TimeoutError):
            await within(self._listening, _STOP_S)

    async def _listen(self, answers: asyncio.StreamReader) -> None:
        async for line in answers:
            self._hear(line)

    def _hear(self, line: bytes) -> None:
        said = json.loads(line)
        if isinstance(said, str):
            self._runs[said].limit = COMPUTING
        elif isinstance(said, dict):
            for name, disturbed in said.items():
                self._runs[name].disturbed = disturbed
        elif self._calm_s is not None and not self._calm_s.done():
            self._calm_s.set_result(float(said))
