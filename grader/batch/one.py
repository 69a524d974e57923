"""One submission in a process of its own, so that nothing it holds can end the grading of the others.

Started with an `Order` in a file. On its standard output it asks for turns and tells its progress, in lines of
JSON; on its standard input it reads the numbers of the turns that are granted. The first turn it has already.
"""

from __future__ import annotations

import asyncio
import base64
import json
import os
import pickle
import resource
import signal
import sys
import threading
import traceback
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import Future, InvalidStateError
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any

from grader import pipeline, result_folder
from grader.batch.order import Ending, Order, problem_of
from grader.live.cells import Progress, Shared
from grader.recording.submission import read_submission, write_submission
from grader.result import Result
from grader.rubric import SessionSpec

#: What reading and judging a submission may take of the address space; some 0.7 GiB suffice.
_MOST_MEMORY_BYTES = 4 * 1024**3
#: Number of the turn that this process starts with.
FIRST_TURN = 0


def main(argv: list[str]) -> int:
    """Carry out an order; returns the exit status."""
    limit_memory()
    turns = _TurnsByPipe()
    try:
        ending: Ending = _carry_out(Order.read(Path(argv[0])), turns)
    except Exception as error:
        traceback.print_exc()
        ending = problem_of(error)
    # Not through a file: that the disk is full may be what has to be said.
    say({"ending": base64.b64encode(pickle.dumps(ending)).decode()})
    return 0


def _carry_out(order: Order, turns: _TurnsByPipe) -> Result:
    if order.judge_only:
        with turns.work("judging"):
            _state_submission_time(order)
            result = pipeline.judge_results(order.results, order.rubric, order.options.overrides)
    else:
        assert order.isolation is not None
        shared = Shared(turns, order.isolation)
        result = pipeline.grade(order.handed, order.rubric, order.results, order.options, _tell, shared)
    make_durable(order.results)
    return result


def _state_submission_time(order: Order) -> None:
    recordings = order.results / result_folder.RECORDINGS
    record = read_submission(recordings)
    if record.submitted_at != order.submitted_at:
        record.submitted_at = order.submitted_at
        write_submission(recordings, record)


def say(message: dict[str, Any]) -> None:
    """Tell the process that started this one."""
    line = memoryview((json.dumps(message) + "\n").encode())
    while line:
        line = line[os.write(sys.stdout.fileno(), line) :]


def _tell(progress: Progress) -> None:
    told = {"session": progress.session, "text": progress.text[:200], "step": progress.step, "steps": progress.steps}
    say({**told, "ended": progress.ended})


def make_durable(folder: Path) -> None:
    """Bring a folder with all that is in it to the disk, so that it is whole even after a loss of power."""
    for path in [*folder.rglob("*"), folder]:
        file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
        try:
            os.fsync(file)
        finally:
            os.close(file)


class _TurnsByPipe:
    """Turns that another process grants.

    The last turn is kept while nothing else is asked for, and what is asked for is asked before it is given back.
    So a submission that has begun goes before the next one, and one whose sessions have ended is judged at once.
    """

    def __init__(self) -> None:
        self._granted: dict[int, Future[None]] = {}
        self._asked = FIRST_TURN
        self._kept: int | None = FIRST_TURN
        self._waiting = 0
        self._cells = 0
        threading.Thread(target=self._read, daemon=True).start()

    @asynccontextmanager
    async def cell(self, spec: SessionSpec, *, alone: bool) -> AsyncIterator[None]:
        """Hold a turn for a session."""
        number = self._ask("cell", session=spec.id, alone=alone)
        self._waiting += 1
        try:
            # All sessions that can run now are asked for before the turn that is held goes to anyone else.
            await asyncio.sleep(0)
            self._free_kept()
            await asyncio.wrap_future(self._granted[number])
        finally:
            self._waiting -= 1
        self._cells += 1
        try:
            yield
        finally:
            self._cells -= 1
            if self._cells or self._waiting:
                say({"free": number})
            else:
                self._kept = number

    @contextmanager
    def work(self, what: str) -> Iterator[None]:
        """Hold a turn for work of this process."""
        if self._kept is None:
            self._kept = self._ask("work", what=what)
            self._granted[self._kept].result()
        else:
            say({"now": self._kept, "what": what})
        yield

    def _free_kept(self) -> None:
        if self._kept is not None:
            say({"free": self._kept})
            self._kept = None

    def _ask(self, kind: str, **more: Any) -> int:
        self._asked += 1
        self._granted[self._asked] = Future()
        say({"ask": self._asked, "for": kind, **more})
        return self._asked

    def _read(self) -> None:
        for line in sys.stdin:
            with suppress(InvalidStateError):  # It was given up meanwhile.
                self._granted[int(line)].set_result(None)
        # Nobody is left to ask: end as on request, which removes what is half done.
        os.kill(os.getpid(), signal.SIGTERM)


def limit_memory() -> None:
    """Limit this process, but not the cells that it starts, which have limits of their own."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    if soft == resource.RLIM_INFINITY or soft > _MOST_MEMORY_BYTES:
        resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY_BYTES, hard))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
