"""A session, as the first process of its sandbox: start, steps, end → recording.

Forked by `grader.live.session.fork_server` with a `SessionPlan`. It touches no ROS itself. Progress goes to standard
output as lines of JSON, e.g. `{"text": "starting talker", "index": 1, "of": 5}`.
"""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import time
from contextlib import suppress

from confine.priority import put_self_first
from grader.errors import without_temporary_names
from grader.live.process.cpu_watch import CpuWatch
from grader.live.process.machine_sample import MachineSampler
from grader.live.process.waiting import looked_for, within
from grader.live.session.plan import SessionPlan
from grader.live.session.programs import Programs
from grader.live.session.steps import ACTIONS
from grader.recording.session import write_session
from ros_bag.recovery import recover

#: Time in s between two samples of the machine.
_SAMPLE_PERIOD_S = 0.5
#: Share of its samples that a session has if the machine did not stall; a busy machine delays some.
_SAMPLED_SHARE = 0.7


class Session:
    """One session under way; the actions of `grader.live.session.steps` do its steps."""

    def __init__(self, plan: SessionPlan, watch: CpuWatch) -> None:
        self._plan = plan
        self._record = plan.record
        self._programs = Programs(plan, watch)

    async def run(self) -> None:
        """Run the session and leave its record, whatever happens."""
        self._record.started_ns = time.time_ns()
        write_session(self._plan.folder, self._record)
        try:
            await self._programs.start()
            put_self_first()
            await self._watched_steps()
        except Exception as problem:
            text = without_temporary_names(f"{type(problem).__name__}: {problem}")
            self._record.problems.append(text)
        try:
            await self._programs.end()
            self._write()
        finally:
            self._programs.sandbox.clean_up()

    async def _watched_steps(self) -> None:
        watchers = [
            asyncio.create_task(self._sample()),
            asyncio.create_task(self._programs.sandbox.guard.watch()),
        ]
        try:
            await within(self._run_steps(), self._plan.timeout_s)
        except TimeoutError:
            await self._stop_for_time()
        for watcher in watchers:
            if watcher.done():  # Only an error ends a watcher before it is cancelled.
                watcher.result()
            watcher.cancel()

    async def _sample(self) -> None:
        machine = MachineSampler()

        def sample() -> bool:
            """Take a sample, and return False, so that another one follows."""
            students_ns = self._programs.sandbox.cpu_ns()
            self._record.machine.append(machine.sample(students_ns))
            self._programs.sample()
            return False

        await looked_for(sample, _SAMPLE_PERIOD_S)

    async def _run_steps(self) -> None:
        for number, (run, step) in enumerate(self._plan.steps, 1):
            run.started_ns = time.time_ns()
            self._record.steps.append(run)
            self._programs.step = step
            progress = {"text": step.describe(), "index": number, "of": len(self._plan.steps)}
            with suppress(BrokenPipeError):
                print(json.dumps(progress), flush=True)
            answer = await ACTIONS[type(step)](self._programs, step)
            run.outcome = answer.outcome
            run.result = answer.result.to_plain()
            run.ended_ns = time.time_ns()
            if answer.outcome == "timeout":
                await self._look_at_hanging()
        for link in self._programs.links:
            self._record.processes.append(await link)

    async def _look_at_hanging(self) -> None:
        """Record at which lines the student's programs stand when something did not come in time."""
        sandbox = self._programs.sandbox
        await sandbox.stacks.look(sandbox.students(), hang=True)

    async def _stop_for_time(self) -> None:
        """End the student's processes after each step has waited as long as it may."""
        run = self._record.steps[-1]
        run.outcome = "timeout"
        run.ended_ns = time.time_ns()
        students = self._programs.sandbox.students()
        alive = [process for process in students if process.alive]
        if not alive or self._machine_stalled(run.ended_ns):
            problem = f"the session took longer than {self._plan.timeout_s:g} s and was stopped"
            self._record.problems.append(problem)
        await self._look_at_hanging()
        for process in alive:
            await process.kill(limit="time")

    def _machine_stalled(self, now_ns: int) -> bool:
        sampled_s = len(self._record.machine) * _SAMPLE_PERIOD_S
        return sampled_s < _SAMPLED_SHARE * (now_ns - self._record.started_ns) / 1e9

    def _write(self) -> None:
        recover(self._plan.folder)
        self._record.ended_ns = time.time_ns()
        self._record.complete = True
        write_session(self._plan.folder, self._record)


def run(plan: SessionPlan, link: socket.socket) -> None:
    """Run a session with a link to the CPU watch; this process must be the first of its sandbox."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    asyncio.run(Session(plan, CpuWatch(link)).run())
