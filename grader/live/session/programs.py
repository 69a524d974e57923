"""The programs of one session: the student's, reference nodes, director, link. The actions of steps work with them."""

from __future__ import annotations

import asyncio
import importlib
import json
import os
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from confine.priority import MEASURED, STANDING
from grader.lab.steps.base import Answer, Step, StepResult
from grader.lab.steps.link import LinkResult, LinkStep
from grader.lab.steps.observe import ObserveStep
from grader.lab.steps.wait_exit import WaitExitStep
from grader.lab.steps.wait_for import WaitForResult, WaitForStep
from grader.live.process.cpu_watch import CpuWatch
from grader.live.process.forked import Program, run_script
from grader.live.process.process import RunningProcess
from grader.live.sandbox.environment import DISCOVERY_FILE, trusted_environment
from grader.live.sandbox.rtps_filter import rtps_filter
from grader.live.session.director_client import DirectorClient
from grader.live.session.launch_runner import LaunchRunner
from grader.live.session.link import Link
from grader.live.session.plan import SessionPlan
from grader.live.session.student_sandbox import StudentSandbox
from grader.recording.session import Endpoint, ProcessRun
from grader.recording.trusted_channel import collect_trusted_messages, tells_identity
from grader.reference_node import FROM_INPUT

#: Address space of each of the grader's own processes.
_TRUSTED_BYTES = 3 * 1024**3
#: Time in s that a reference node may take to say that it is ready.
_REFERENCE_START_S = 15.0
#: Time in s that a reference node may take to end.
_REFERENCE_END_S = 2.0
#: Time in s that messages may be under way after the last of the student's processes has ended.
_AFTER_EXIT_S = 0.3
#: Processes below this share of a core get a higher priority during a measurement. A working node uses half as much.
_MODEST = 0.3
#: Looks at a process's sockets after a change of its threads, one a sample.
_LOOKS_FOR_SOCKETS = 2


def _is_of_start(line: str) -> bool:
    """Tell whether a line of a reference node tells its identity, or that it is ready."""
    if tells_identity(line):
        return True
    return "ready" in line


class Programs:
    """The programs of a session.

    Attributes
    ----------
    processes
        The student's processes and the reference nodes by name, in order of their start.
    step
        The current step.
    links
        Links that go on beside the steps.
    """

    def __init__(self, plan: SessionPlan, watch: CpuWatch) -> None:
        self.plan = plan
        self.record = plan.record
        self.sandbox = StudentSandbox(plan)
        self.processes = self.sandbox.processes
        self.director: DirectorClient | None = None
        self.launch = LaunchRunner(self.sandbox)
        self.watch = watch
        self.step: Step | None = None
        self.links: list[asyncio.Task[ProcessRun]] = []
        self._linked: list[RunningProcess] = []
        self._filter = rtps_filter()
        self.sandbox.before_start = self._filter.arm
        if not plan.isolation.namespaces:  # Others may send from the beginning.
            self._filter.arm()
        #: Process of the grader -> its scheduling, and the number of looks at its sockets since then.
        self._protected: dict[RunningProcess, tuple[object, int]] = {}

    # -- the grader's own processes -----------------------------------------------------------

    async def start(self) -> None:
        """Start the director and the watch."""
        trusted = self.plan.scratch / "trusted"
        trusted.mkdir()
        self.sandbox.prepare()
        await self._start_director()
        await self.watch.start()

    def _environment(self) -> dict[str, str]:
        """Return the environment of the grader's own ROS nodes."""
        trusted = trusted_environment(self.plan.scratch / "trusted", self.plan.domain_id)
        return self.sandbox.with_interfaces(trusted)

    async def _start_trusted(
        self,
        run: ProcessRun,
        main: Callable[[], object],
        hear: Callable[[bytes], None] | None = None,
    ) -> RunningProcess:
        self.record.processes.append(run)
        program = Program(run.name, main, self._environment(), _TRUSTED_BYTES)
        running = await RunningProcess.fork(run, program, on_message=hear)
        self.sandbox.trusted.append(running)
        return running

    async def _start_director(self) -> None:
        plan = self.plan
        reference_nodes = self._reference_nodes()

        def direct() -> None:
            # ROS is loaded in the director's process alone.
            module = importlib.import_module("grader.live.ros_node.director")
            director = module.Director(
                plan.folder,
                plan.record.session,
                plan.domain_id,
                reference_nodes,
                set(plan.expected),
            )
            director.serve()

        director = DirectorClient(self.record)
        director.running = await self._start_trusted(director.run, direct, director.hear)
        self.director = director
        await director.wait_ready()
        self._filter.protect(director.running.root_pid() or 0)

    def _reference_nodes(self) -> set[str]:
        return {spec["node"] for spec in self.plan.reference.values()}

    async def start_reference(self, name: str, settings: dict[str, Any]) -> Answer:
        """Start a reference node, and wait until it says that it is ready."""
        file = self.plan.reference[name]["file"]
        text = json.dumps(self._configuration(settings))
        run = ProcessRun(name, "reference", ["python", Path(file).name, text])
        # Not on the command line, which everybody can read where process ids are shared: the seed is in it.
        running = await self._start_trusted(run, partial(run_script, file, FROM_INPUT))
        running.write(f"{text}\n".encode())
        self.processes[name] = running
        await self._protect_reference(name, running)
        answer = await self.wait_output(name, "ready", _REFERENCE_START_S)
        if answer.outcome != "done":
            self.record.problems.append(f"the reference node {name} did not become ready")
        running.put_standing()
        self._filter.protect(running.root_pid() or 0)
        return answer

    async def _protect_reference(self, name: str, running: RunningProcess) -> None:
        """Protect a reference node's name as soon as it is known, and let the node open its endpoints."""
        await self._wait_line(running, _is_of_start, _REFERENCE_START_S)
        collect_trusted_messages(self.record)
        self._filter.protect(running.root_pid() or 0, self._prefix_of(name))
        running.write(b"protected\n", last=True)

    def _configuration(self, settings: dict[str, Any]) -> dict[str, Any]:
        """Return the text that a reference node reads, before it is JSON."""
        subscriptions = [each for each in self.students_endpoints() if each.kind == "subscription"]
        return {
            "seed": self.record.seed,
            "names": self.record.names,
            "with": settings,
            # Subscriptions of the student by topic, also of a process that died.
            "subscriptions": Counter(each.topic for each in subscriptions),
            "types": self._types(),
        }

    def _types(self) -> dict[str, str]:
        """Return the types of the topics to which the student subscribes, which may not be the lab's."""
        types = {}
        for run in self.record.steps:
            if run.kind == WaitForStep.kind and WaitForStep.given(run).subscription:
                found = WaitForResult.of(run)
                if found.name is not None and found.type is not None:
                    types[found.name] = found.type
        return types

    def _prefix_of(self, name: str) -> str:
        """Return the first digits of the gids of a process of the grader's, empty if it did not tell them."""
        for trusted in self.record.trusted:
            if trusted.process == name:
                return trusted.gid_prefix
        return ""

    # -- all programs -------------------------------------------------------------------------

    def sample(self) -> None:
        """Note the use of the machine, and protect new sockets of the grader's processes."""
        self._look_at(*self.sandbox.students(), *self.sandbox.trusted, *self._linked)
        for process in self.sandbox.trusted:
            if process.alive:
                self._protect_new(process)

    def _protect_new(self, process: RunningProcess) -> None:
        """Protect the new sockets of a process: they come with new threads, or soon after."""
        scheduling, looks = self._protected.get(process, (None, 0))
        if process.scheduling != scheduling:
            looks = 0
        if looks < _LOOKS_FOR_SOCKETS:
            self._filter.protect(process.root_pid() or 0)
        self._protected[process] = (process.scheduling, looks + 1)

    def _look_at(self, *processes: RunningProcess) -> None:
        is_measured = self._measures()
        for process in processes:
            process.sample_usage()
            if process.run.core is not None and is_measured:
                is_modest = process.lately_used() < _MODEST
                process.stay_standing(MEASURED if is_modest else STANDING)
        self.watch.follow(processes)

    def _measures(self) -> bool:
        """Return whether the current step measures over time."""
        if isinstance(self.step, ObserveStep):
            return self.step.extend_s > 0
        return isinstance(self.step, WaitExitStep)

    def hold_students_to_cores(self) -> None:
        """Give each of the student's processes a core."""
        cores = sorted(os.sched_getaffinity(0))
        for number, process in enumerate(self.sandbox.students()):
            if process.alive:
                core = cores[(self.plan.slot + number) % len(cores)]
                process.hold_to_core(core, self.sandbox.uid)
                process.put_standing()
                self._look_at(process)

    def students_endpoints(self) -> list[Endpoint]:
        """Return the student's endpoints that are in the graph now."""
        if not self.record.graph:
            return []
        ours = self._reference_nodes()
        return [each for each in self.record.graph[-1].endpoints if each.node not in ours]

    # -- waiting ------------------------------------------------------------------------------

    async def direct(self, step: Step) -> Answer:
        """Have the director do a step, but not for longer than the student has processes."""
        assert self.director is not None
        if not self._students_remain():
            return Answer("cancelled", StepResult("the student's process had ended"))
        answer = asyncio.create_task(self.director.do(step))
        ended = asyncio.create_task(self._students_ended())
        await asyncio.wait({answer, ended}, return_when=asyncio.FIRST_COMPLETED)
        if not answer.done():
            self.director.cancel()
        ended.cancel()
        return await answer

    def _students_remain(self) -> bool:
        if self.launch.waiting:
            return True
        return any(process.alive for process in self.sandbox.students())

    async def _students_ended(self) -> None:
        while self._students_remain():
            alive = {process.exited for process in self.sandbox.students() if process.alive}
            await asyncio.wait(alive | self.launch.waiting, return_when=asyncio.FIRST_COMPLETED)
        await asyncio.sleep(_AFTER_EXIT_S)

    async def wait_output(self, name: str, text: str, timeout_s: float) -> Answer:
        """Wait until a process has written a line with a text."""
        process = self.processes.get(name)
        if process is None:
            return Answer("failed", StepResult(f"there is no process {name}"))
        is_written = await self._wait_line(process, lambda line: text in line, timeout_s)
        if is_written:
            return Answer("done")
        return Answer("timeout")

    async def _wait_line(
        self, process: RunningProcess, fits: Callable[[str], bool], timeout_s: float
    ) -> bool:
        """Wait for a line of a process's output that fits, and return whether there is one."""
        end_s = time.monotonic() + timeout_s
        looked_at = 0
        while True:
            left_s = end_s - time.monotonic()
            is_last = not process.alive or left_s < 0
            lines = process.run.output[looked_at:]
            if any(fits(line.text) for line in lines):
                return True
            if is_last:
                return False
            looked_at += len(lines)
            await process.wait_said(left_s)

    # -- the link -----------------------------------------------------------------------------

    def start_link(self, step: LinkStep) -> Answer:
        """Begin to carry messages over a link, beside the steps that follow."""
        if not self.plan.isolation.namespaces:
            problem = "this machine gives a session no networks of its own"
            return Answer("failed", LinkResult(problem))
        link = Link(
            self.record.steps[-1],
            step,
            self.students_endpoints,
            self.sandbox.claims_so_far,
            self.record.names,
            self._linked.append,
        )
        # The time of acknowledgements decides how much arrives over the link.
        environment = self._environment() | {"FASTRTPS_DEFAULT_PROFILES_FILE": str(DISCOVERY_FILE)}
        carrying = link.run(self.record.seed, environment)
        self.links.append(asyncio.create_task(carrying))
        return Answer("done")

    # -- the end ------------------------------------------------------------------------------

    async def end(self) -> None:
        """End all programs, the director last."""
        for link in self.links:
            link.cancel()
        self.launch.end()
        await self.sandbox.guard.look()  # while the use of each process can still be seen
        for name, process in self.processes.items():
            if process.run.role == "student":
                if process.alive:
                    await process.kill()
            elif process.run.role == "reference":
                await self._end_reference(name, process)
        await self.watch.stop()
        if self.director is not None:
            await self.director.stop()
        collect_trusted_messages(self.record)
        await self.sandbox.guard.look()
        self.sandbox.blame_unstarted()

    async def _end_reference(self, name: str, process: RunningProcess) -> None:
        run = process.run
        if not process.alive:
            problem = f"the reference node {name} ended with status {run.exit_status}"
            self.record.problems.append(problem)
            return
        await process.stop(_REFERENCE_END_S)
        if run.ended_by != "interrupt":
            problem = f"the reference node {name} did not end when it was asked to"
            self.record.problems.append(problem)
