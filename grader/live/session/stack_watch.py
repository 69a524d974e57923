"""Looks at the stacks of programs that do not answer or are about to be ended, for the line at which one hangs."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Iterable

from grader.live.process.process import RunningProcess
from grader.live.student_tap.stacks import ALL_THREADS, MAIN_THREAD, ask, threads_in
from grader.recording.session import SessionRecord, Stack

#: Times that a program is looked at; each time its stacks are read twice.
_MOST_TIMES = 4
#: Stacks that a session keeps.
_MOST_STACKS = 60
#: Processes of a program that are asked.
_MOST_PROCESSES = 8
#: Time between the two readings, in s. A program that stands at one line both times hangs there.
_BETWEEN_S = 0.1
#: Longest time for an answer, in s, and the pause between two looks for more of its text.
_ANSWER_S, _LOOK_S = 0.3, 0.02
#: Share of a core up to which a program is idle. Its threads then stand still, and all of them can be read safely.
_IDLE = 0.03


class StackWatch:
    """The looks at the stacks of a session's programs.

    `text_of` returns the text of a program's tap until now, "" if the program has ended. Paths in the submission begin
    with `above`.
    """

    def __init__(self, record: SessionRecord, text_of: Callable[[str], str], above: str) -> None:
        self._record = record
        self._text_of = text_of
        self._above = above
        self._times: Counter[str] = Counter()

    async def look(self, programs: Iterable[RunningProcess], *, hang: bool) -> None:
        """Record the stacks of running programs.

        Reading all threads while some of them run can go wrong. It is done if a program seems to hang, or is idle.
        """
        looks = []
        for program in programs:
            name = program.run.name
            if not program.alive:
                continue
            if self._times[name] >= _MOST_TIMES:
                continue
            self._times[name] += 1
            is_whole = hang or program.lately_used() < _IDLE
            looks.append(self._look_at(program, is_whole))
        await asyncio.gather(*looks)

    async def _look_at(self, program: RunningProcess, is_whole: bool) -> None:
        name = program.run.name
        number = MAIN_THREAD
        if is_whole:
            number = ALL_THREADS
        asked_ns = time.time_ns()
        for pause_s in (_BETWEEN_S, 0.0):
            begin = len(self._text_of(name))
            for pid in program.descendants()[:_MOST_PROCESSES]:
                ask(pid, number)
            answer = await self._answer(name, begin)
            threads = threads_in(answer, self._above)
            if threads:
                self._keep(Stack(name, asked_ns, threads, is_whole))
            await asyncio.sleep(pause_s)

    def _keep(self, stack: Stack) -> None:
        if len(self._record.stacks) < _MOST_STACKS:
            self._record.stacks.append(stack)

    async def _answer(self, name: str, begin: int) -> str:
        """Return the text that comes until it grows no more."""
        end_s = time.monotonic() + _ANSWER_S
        answer = ""
        while time.monotonic() < end_s:
            await asyncio.sleep(_LOOK_S)
            text = self._text_of(name)[begin:]
            if text and text == answer:
                break
            answer = text
        return answer
