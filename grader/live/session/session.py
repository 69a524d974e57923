"""A session, as the first process of its sandbox: start, steps, stop → recording.

Forked by `grader.live.session.fork_server` with a `SessionPlan`. It touches no ROS itself. Progress goes to standard
output, one JSON line each.
"""

from __future__ import annotations

import asyncio
import importlib
import json
import os
import signal
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from confine.priority import MEASURED, STANDING, put_self_first
from grader.errors import without_temporary_names
from grader.live.process.cpu_watch import CpuWatch
from grader.live.process.forked import Program, run_script
from grader.live.process.machine_sample import sample_machine
from grader.live.process.process import RunningProcess
from grader.live.process.waiting import within
from grader.live.sandbox.environment import trusted_environment
from grader.live.sandbox.room import WORKSPACE
from grader.live.sandbox.rtps_filter import rtps_filter
from grader.live.session.director_client import Answer, DirectorClient
from grader.live.session.launch_runner import LaunchRunner
from grader.live.session.link import Link
from grader.live.session.plan import SessionPlan
from grader.live.session.student_sandbox import StudentSandbox
from grader.recording.bag import recover
from grader.recording.link import LinkResult
from grader.recording.session import AWAITED, Endpoint, ProcessRun, write_session
from grader.recording.trusted_channel import collect_trusted_messages

#: Address space of each of the grader's own processes.
_TRUSTED_BYTES = 3 * 1024**3
_REFERENCE_START_S = 15.0
_SAMPLE_PERIOD_S = 0.5
#: How often to look for a line of output that is waited for.
_LOOK_S = 0.01
#: Share of its samples that a session has where the machine went on; one that is busy delays some.
_SAMPLED_SHARE = 0.7
#: After the last of the student's processes has ended, how long its traffic may still be on its way.
_AFTER_EXIT_S = 0.3
#: Whoever uses less of a core than this goes before others while it is measured: twice what a node at work uses.
_MODEST = 0.3
#: What a measurement needs of its time undisturbed, and the pieces by which it is made longer for that.
_CALM_S, _MORE_S = 0.7, 0.5


class Session:
    """One session under way; each method `_step_KIND` does a step, and the director does all other kinds."""

    def __init__(self, plan: SessionPlan) -> None:
        self.plan = plan
        self.record = plan.record
        self.sandbox = StudentSandbox(plan)
        self.processes = self.sandbox.processes
        self.director: DirectorClient | None = None
        self._launch = LaunchRunner(self.sandbox)
        self._filter = rtps_filter()
        self._watch = CpuWatch()
        self._links: list[asyncio.Task[ProcessRun]] = []
        self._linked: list[RunningProcess] = []

    async def run(self) -> None:
        """Run the session and leave its record, whatever happens."""
        self.record.started_ns = time.time_ns()
        write_session(self.plan.folder, self.record)
        try:
            (self.plan.scratch / "trusted").mkdir()
            self.sandbox.prepare()
            await self._start_director()
            environment = trusted_environment(self.plan.scratch / "trusted", self.plan.domain_id)
            self.sandbox.trusted.append(await self._watch.start(environment))
            put_self_first()
            watchers = [
                asyncio.create_task(self._sample()),
                asyncio.create_task(self.sandbox.guard.watch()),
            ]
            try:
                await within(self._run_steps(), self.plan.timeout_s)
            except asyncio.TimeoutError:
                await self._stop_for_time()
            for watcher in watchers:
                if watcher.done():  # They go on until they are cancelled, unless they broke.
                    watcher.result()
                watcher.cancel()
        except Exception as problem:
            text = without_temporary_names(f"{type(problem).__name__}: {problem}")
            self.record.problems.append(text)
        try:
            await self._finish()
        finally:
            self.sandbox.clean_up()

    async def _stop_for_time(self) -> None:
        """End the student's processes, for which each step waited as long as it may; unless the machine stalled."""
        step, now_ns = self.record.steps[-1], time.time_ns()
        step.outcome, step.ended_ns = "timeout", now_ns
        alive = [process for process in self.sandbox.students() if process.alive]
        sampled_s = len(self.record.machine) * _SAMPLE_PERIOD_S
        if not alive or sampled_s < _SAMPLED_SHARE * (now_ns - self.record.started_ns) / 1e9:
            self.record.problems.append(
                f"the session took longer than {self.plan.timeout_s:g} s and was stopped"
            )
        for process in alive:
            await process.kill(limit="time")

    async def _finish(self) -> None:
        for link in self._links:
            link.cancel()
        self._launch.end()
        await self.sandbox.guard.look()  # while it can still be seen who took what
        for name, process in self.processes.items():
            if process.alive and process.run.role == "student":
                await process.kill()
            elif process.alive:
                await process.stop(2.0)
                if process.run.ended_by != "interrupt":
                    self.record.problems.append(
                        f"the reference node {name} did not end when it was asked to"
                    )
            elif process.run.role == "reference":
                self.record.problems.append(
                    f"the reference node {name} ended with status {process.run.exit_status}"
                )
        await self._watch.stop()
        if self.director is not None:
            await self.director.stop()
        collect_trusted_messages(self.record)
        await self.sandbox.guard.look()
        self.sandbox.blame_unstarted()
        recover(self.plan.folder)
        self.record.ended_ns = time.time_ns()
        self.record.complete = True
        write_session(self.plan.folder, self.record)

    # -- the grader's own processes -----------------------------------------------------------

    def _environment(self) -> dict[str, str]:
        """Return that of the grader's own ROS nodes."""
        return self.sandbox.with_interfaces(
            trusted_environment(self.plan.scratch / "trusted", self.plan.domain_id)
        )

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
        plan, session = self.plan, self.record.session
        reference_nodes = {spec["node"] for spec in plan.reference.values()}

        def direct() -> None:
            module = importlib.import_module("grader.live.ros_node.director")
            module.Director(
                plan.folder, session, plan.domain_id, reference_nodes, set(plan.expected)
            ).serve()

        director = DirectorClient(self.record)
        director.running = await self._start_trusted(director.run, direct, director.hear)
        self.director = director
        await director.wait_ready()
        self._filter.protect(director.running.root_pid() or 0)

    async def _start_reference(self, name: str, settings: dict[str, Any]) -> Answer:
        spec = self.plan.reference[name]
        configuration = {
            "seed": self.record.seed,
            "names": self.record.names,
            "with": settings,
            # The student's, by topic, those of a process that died included.
            "subscriptions": Counter(
                e.topic for e in self._students_endpoints() if e.kind == "subscription"
            ),
            "types": self._types(),
        }
        run = ProcessRun(
            name, "reference", ["python", Path(spec["file"]).name, json.dumps(configuration)]
        )
        # Not on the command line, which everybody can read where process ids are shared: the seed is in it.
        running = await self._start_trusted(run, partial(run_script, spec["file"], "-"))
        running.write(json.dumps(configuration).encode(), last=True)
        self.processes[name] = running
        outcome, result = await self._wait_output(name, "ready", _REFERENCE_START_S)
        if outcome != "done":
            self.record.problems.append(f"the reference node {name} did not become ready")
        running.put_standing()
        collect_trusted_messages(self.record)
        prefix = next(
            (trusted.gid_prefix for trusted in self.record.trusted if trusted.process == name), ""
        )
        self._filter.protect(running.root_pid() or 0, prefix)
        return outcome, result

    def _types(self) -> dict[str, str]:
        """Return the types of the topics to which the student subscribes, which may not be the lab's."""
        waits = [
            s
            for s in self.record.steps
            if s.kind == "wait_for" and s.parameters.get("subscription")
        ]
        return {s.result["name"]: s.result["type"] for s in waits if "type" in s.result}

    async def _sample(self) -> None:
        while True:
            await asyncio.sleep(_SAMPLE_PERIOD_S)
            self.record.machine.append(replace(sample_machine(), students_ns=self.sandbox.cpu_ns()))
            self._look_at(*self.sandbox.students(), *self.sandbox.trusted, *self._linked)
            for process in self.sandbox.trusted:
                if process.alive:
                    self._filter.protect(process.root_pid() or 0)  # it may have new sockets

    def _look_at(self, *processes: RunningProcess) -> None:
        step = self.record.steps[-1]
        for process in processes:
            process.sample_usage()
            if process.run.core is not None and (
                step.kind == "wait_exit" or step.parameters.get("extend_s")
            ):
                process.put_standing(MEASURED if process.lately_used() < _MODEST else STANDING)
        self._watch.follow(processes)

    # -- steps --------------------------------------------------------------------------------

    async def _run_steps(self) -> None:
        for number, (step, words) in enumerate(self.plan.steps, 1):
            step.started_ns = time.time_ns()
            self.record.steps.append(step)
            with suppress(BrokenPipeError):
                print(
                    json.dumps({"text": words, "index": number, "of": len(self.plan.steps)}),
                    flush=True,
                )
            # What is not done here is an operation of the director's.
            action = getattr(self, f"_step_{step.kind}", None) or partial(self._direct, step.kind)
            step.outcome, step.result = await action(step.parameters)
            step.ended_ns = time.time_ns()
        for link in self._links:
            self.record.processes.append(await link)

    async def _step_start(self, parameters: dict[str, Any]) -> Answer:
        if parameters["reference"]:
            return await self._start_reference(parameters["reference"], parameters["with"])
        if parameters["launch"]:
            return await self._launch.start(self.record.plan)
        artifact = parameters["student"]
        wrapper = self.plan.executables.get(artifact)
        if wrapper is None:
            return "failed", {"problem": "missing artifact", "artifact": artifact}
        name = parameters["name"] or artifact
        if parameters["if_ended"]:
            if self.processes[name].alive:
                return "done", {"started": False}
            assert self.director is not None
            await self.director.ask({"op": "forget"})
        arguments = []
        for parameter, value in parameters["parameters"].items():
            arguments += ["-p", f"{parameter}:={json.dumps(value)}"]
        # Nodes that a student composed in one file all run; what the session needs for itself is kept from the others.
        sources = self.plan.sources
        composed = any(a != artifact and sources[a] == sources.get(artifact) for a in sources)
        for wanted, new in {
            **parameters["remappings"],
            **(parameters["composed"] if composed else {}),
        }.items():
            arguments += ["-r", f"{self.record.names.get(wanted, wanted)}:={new}"]
        workspace = Path(self.sandbox.seen[WORKSPACE])
        command = [str(self.plan.interpreter), f"{workspace}/{wrapper}"]
        command += ["--ros-args", *arguments] if arguments else []
        cwd = str(workspace / "src" / Path(sources.get(artifact, "")).parent)
        await self.sandbox.start(ProcessRun(name, "student", command, artifact), cwd=cwd)
        return "done", {"started": True}

    async def _step_plan(self, parameters: dict[str, Any]) -> Answer:
        outcome, result = await self._launch.plan(parameters)
        if self.record.plan is None and not parameters["arguments"]:
            self.record.plan = result.get("plan")
        return outcome, result

    async def _step_wait_for(self, parameters: dict[str, Any]) -> Answer:
        if parameters["output_of"]:
            outcome, result = await self._wait_output(
                parameters["output_of"], parameters["text"] or "", parameters["timeout_s"]
            )
        else:
            outcome, result = await self._direct("wait_for", parameters)
            wanted = next(parameters[k] for k in AWAITED if parameters.get(k))
            if result.get("name", wanted) != wanted:
                self.record.names[wanted] = result["name"]
        self._hold_students_to_cores()
        return outcome, result

    def _hold_students_to_cores(self) -> None:
        cores = sorted(os.sched_getaffinity(0))
        for number, process in enumerate(self.sandbox.students()):
            if process.alive:
                process.hold_to_core(
                    cores[(self.plan.slot + number) % len(cores)], self.sandbox.uid
                )
                process.put_standing()
                self._look_at(process)

    async def _wait_output(self, name: str, text: str, timeout_s: float) -> Answer:
        process = self.processes.get(name)
        if process is None:
            return "failed", {"problem": f"there is no process {name}"}
        end_s, looked_at = time.monotonic() + timeout_s, 0
        while True:
            is_last = not process.alive or time.monotonic() > end_s
            lines = process.run.output[looked_at:]
            if any(text in line.text for line in lines):
                return "done", {}
            if is_last:
                return "timeout", {}
            looked_at += len(lines)
            await asyncio.sleep(_LOOK_S)

    async def _direct(self, op: str, parameters: dict[str, Any]) -> Answer:
        """Have the director do it, but not for longer than the student has processes."""
        assert self.director is not None
        if not self._students_remain():
            return "cancelled", {"problem": "the student's process had ended"}
        request = {"op": op, "processes": len(self.record.processes), **parameters}
        answer = asyncio.create_task(self.director.ask(request))
        ended = asyncio.create_task(self._students_ended())
        await asyncio.wait({answer, ended}, return_when=asyncio.FIRST_COMPLETED)
        if not answer.done():
            self.director.cancel()
        ended.cancel()
        return await answer

    async def _step_observe(self, parameters: dict[str, Any]) -> Answer:
        outcome, result = await self._direct("observe", parameters)
        for _ in range(int(parameters["extend_s"] / _MORE_S) if outcome == "done" else 0):
            if await self._watch.calm_s(result["opened_ns"]) >= _CALM_S:
                break
            went_on, more = await self._direct("observe", {"duration_s": _MORE_S})
            if went_on != "done":
                break
            result["closed_ns"] = more["closed_ns"]
        return outcome, result

    def _students_remain(self) -> bool:
        return bool(self._launch.waiting) or any(p.alive for p in self.sandbox.students())

    async def _students_ended(self) -> None:
        while self._students_remain():
            await asyncio.wait(
                {p.exited for p in self.sandbox.students() if p.alive} | self._launch.waiting,
                return_when=asyncio.FIRST_COMPLETED,
            )
        await asyncio.sleep(_AFTER_EXIT_S)

    async def _step_interrupt(self, parameters: dict[str, Any]) -> Answer:
        everyone = parameters["process"] == "*"
        chosen = [
            p for p in self.sandbox.students() if everyone or p.run.name == parameters["process"]
        ]
        if everyone:
            self._launch.end()
        alive = [p for p in chosen if p.alive]
        await asyncio.gather(*(p.stop(parameters["timeout_s"]) for p in alive))
        for process in alive:
            if process.run.interrupted_ns is None and process.run.ended_by in ("terminate", "kill"):
                self.record.problems.append(
                    f"{process.run.name} was not interrupted: its process was not found"
                )
        ended = {p.run.name: p.run.ended_by for p in chosen}
        stubborn = [n for n, how in ended.items() if how in ("terminate", "kill")]
        return ("timeout" if stubborn else "done"), {"ended_by": ended}

    async def _step_link(self, parameters: dict[str, Any]) -> Answer:
        """Begin what goes on beside the steps that follow, and is waited for after the last of them."""
        if not self.plan.isolation.namespaces:
            problem = "this machine gives a session no networks of its own"
            return "failed", asdict(LinkResult(problem=problem))
        link = Link(
            self.record.steps[-1],
            self._students_endpoints,
            self.sandbox.claims_so_far,
            self.record.names,
            self._linked.append,
        )
        self._links.append(asyncio.create_task(link.run(self.record.seed, self._environment())))
        return "done", {}

    def _students_endpoints(self) -> list[Endpoint]:
        """Return those that are in the graph now."""
        ours = {spec["node"] for spec in self.plan.reference.values()}
        return (
            [e for e in self.record.graph[-1].endpoints if e.node not in ours]
            if self.record.graph
            else []
        )

    async def _step_wait_exit(self, parameters: dict[str, Any]) -> Answer:
        process = self.processes.get(parameters["process"])
        if process is None:
            return "failed", {"problem": f"there is no process {parameters['process']}"}
        return ("done" if await process.wait_exit(parameters["timeout_s"]) else "timeout"), {}


def run(plan: SessionPlan) -> None:
    """Run a session; this process must be the first of its sandbox."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    asyncio.run(Session(plan).run())
