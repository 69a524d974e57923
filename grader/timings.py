"""Measures the time of the stages of a grading."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Stage:
    """Something that took time, on the monotonic clock, and the CPU time of all threads of this process meanwhile."""

    what: str
    began_s: float
    ended_s: float
    cpu_s: float

    @property
    def took_s(self) -> float:
        """Its length."""
        return self.ended_s - self.began_s


@dataclass(frozen=True)
class SessionRun:
    """A session in its sandbox, once for each attempt; it waited from when all of them were ready to run."""

    session: str
    waited_s: float
    ran_s: float


class Stopwatch:
    """Collects `stages` and `session_runs` of a grading, in the order of their ends."""

    def __init__(self) -> None:
        self.started_s = time.monotonic() - _age_s()
        self.stages = [
            Stage("starting the program", self.started_s, time.monotonic(), time.process_time())
        ]
        self.session_runs: list[SessionRun] = []
        self._ready_s = self.started_s
        self._begun: dict[str, float] = {}

    @contextmanager
    def stage(self, what: str) -> Iterator[None]:
        """Measure the time of the code within."""
        began_s, cpu_s = time.monotonic(), time.process_time()
        self._ready_s = began_s
        try:
            yield
        finally:
            self.stages.append(Stage(what, began_s, time.monotonic(), time.process_time() - cpu_s))

    def follow(self, on_progress: Callable[..., None]) -> Callable[..., None]:
        """Return a listener for the progress of sessions that measures them and passes all on."""

        def listen(progress: Any) -> None:
            now_s = time.monotonic()
            if not progress.ended:
                self._begun.setdefault(progress.session, now_s)
            elif (begun_s := self._begun.pop(progress.session, None)) is not None:
                self.session_runs.append(
                    SessionRun(progress.session, begun_s - self._ready_s, now_s - begun_s)
                )
            on_progress(progress)

        return listen


def _age_s() -> float:
    """Return for how long this process has run, as far as the system tells."""
    with suppress(OSError, ValueError, IndexError):
        after_name = Path("/proc/self/stat").read_text().rsplit(")", 1)[1].split()
        ticks = os.sysconf("SC_CLK_TCK")
        return max(0.0, time.clock_gettime(time.CLOCK_BOOTTIME) - int(after_name[19]) / ticks)
    return 0.0
