"""A session, as the first process of its cell: start, steps, stop → recording.

Forked by `grader.live.fork_server` with a `SessionPlan`. It starts the director, the
reference nodes and the student's processes, runs the steps, and writes `session.json` beside the
bag. It touches no ROS itself. Progress goes to standard output, one JSON line each.
"""

from __future__ import annotations

import asyncio
import ctypes
import fcntl
import importlib
import json
import os
import signal
import socket
import struct
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from grader.beneath import copy_tree, restore_way
from grader.live.cgroup import CellGroup
from grader.live.claims import claims_in
from grader.live.environment import INSIDE_FOLDER, LAUNCHING_FOLDER, student_environment, trusted_environment
from grader.live.forked import Program, script
from grader.live.guard import Guard
from grader.live.isolation import (
    HOME,
    INSIDE,
    LAUNCHING,
    PARAMETERS,
    SHARED_MEMORY,
    TEMPORARY,
    WORKSPACE,
    Isolation,
    Room,
    student_argv,
    student_uid,
)
from grader.live.launched import LaunchRunner
from grader.live.machine import sample_machine
from grader.live.packet_filter import PacketFilter
from grader.live.priority import put_self_first
from grader.live.process import OutputRoom, PipeReader, RunningProcess
from grader.live.process_table import descendants_of
from grader.live.scratch import remove_tree
from grader.live.seccomp import open_filter
from grader.recording.record import from_plain
from grader.recording.session import (
    GraphSnapshot,
    ProcessRun,
    Published,
    SessionRecord,
    StepRun,
    Trusted,
    Unrecorded,
    write_session,
)
from grader.recording.told import participants_told, take_told

_WORKSPACE_BYTES = 256 * 1024 * 1024
_SMALL_BYTES = 64 * 1024 * 1024
_MAX_FILES = 20_000
#: Address space of each of the grader's own processes.
_TRUSTED_BYTES = 3 * 1024**3
_SET_CHILD_SUBREAPER = 36
_SWEEP_S = 5.0
#: More than the processes that come before a student's program in its sandbox.
_STUDENTS_IDS = 12
_MAX_CLAIM_BYTES, _MOST_CLAIMS = 512 * 1024, 5000
_DIRECTOR_START_S = 20.0
_DIRECTOR_STOP_S = 8.0
_REFERENCE_START_S = 15.0
_SAMPLE_PERIOD_S = 0.5
#: Share of its samples that a session has where the machine went on; one that is busy delays some.
_SAMPLED_SHARE = 0.7
#: Rights of a folder to which both the student's user and bubblewrap, root without privileges, can change.
_OPEN = 0o755
#: Limits of a session's students together: where one was hit, nothing more may begin.
_LEAVES_NO_ROOM = ("processes", "memory")
#: After the last of the student's processes has ended, how long its traffic may still be on its way.
_AFTER_EXIT_S = 0.3


@dataclass
class SessionPlan:
    """All that a session process needs to know; plain data, passed as a JSON file.

    Attributes
    ----------
    folder : str
        The recording's folder.
    scratch : str
        A folder of its own, removed by the caller.
    staged : str
        The staged submission (`src/`, `install/`).
    executables, sources : dict
        Artifact -> wrapper relative to `staged`, and -> source relative to `staged`/src.
    reference : dict
        Reference node -> {"file": absolute path, "node": fully qualified name}.
    expected : list of str
        Names of topics, services and nodes that the rubric uses.
    native : dict or None
        Where the real `launch` is, if it evaluates launch files; see `grader.live.ros_launch`.
    """

    session: str
    steps: list[dict[str, Any]]
    seed: int
    folder: str
    scratch: str
    staged: str
    executables: dict[str, str]
    sources: dict[str, str]
    reference: dict[str, dict[str, str]]
    expected: list[str]
    isolation: dict[str, Any]
    interpreter: str
    slot: int
    domain_id: int
    timeout_s: float
    attempt: int = 1
    disturbed_before: bool = False
    versions: dict[str, str] = field(default_factory=dict)
    native: dict[str, Any] | None = None


class _Director:
    """The session's side of the director process."""

    running: RunningProcess

    def __init__(self, record: SessionRecord) -> None:
        self._record = record
        self.ready = asyncio.Event()
        self.stopped = asyncio.Event()
        self._answer: asyncio.Future[dict[str, Any]] | None = None

    def on_message(self, line: bytes) -> None:
        event = json.loads(line)
        if event["event"] == "graph":
            self._record.graph.append(from_plain(GraphSnapshot, event["graph"]))
        elif event["event"] == "ready":
            self._record.trusted.append(from_plain(Trusted, event["trusted"]))
            self.ready.set()
        elif event["event"] == "published":
            self._record.published.append(from_plain(Published, event["published"]))
        elif event["event"] == "stopped":
            self._record.problems += event["problems"]
            self._record.unrecorded += [from_plain(Unrecorded, plain) for plain in event["unrecorded"]]
            self.stopped.set()
        elif self._answer is not None and not self._answer.done():
            self._answer.set_result(event)

    def _send(self, request: dict[str, Any]) -> None:
        self.running.write((json.dumps(request) + "\n").encode())

    async def ask(self, request: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        self._answer = asyncio.get_running_loop().create_future()
        self._send(request)
        either: list[asyncio.Future[Any]] = [self._answer, self.running.exited]
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        if not self._answer.done():
            return "failed", {"problem": "the director ended"}
        answer = self._answer.result()
        return answer["outcome"], answer["result"]

    def cancel(self) -> None:
        self._send({"op": "cancel"})

    async def stop(self) -> None:
        self._send({"op": "stop"})
        stopped = asyncio.create_task(self.stopped.wait())
        either: set[asyncio.Task[Any]] = {stopped, self.running.exited}
        await asyncio.wait(either, timeout=_DIRECTOR_STOP_S, return_when=asyncio.FIRST_COMPLETED)
        stopped.cancel()
        if not self.stopped.is_set():
            self._record.problems.append("the recorder did not end in order; its bag was recovered")
        await self.running.wait_exit(1.0)
        await self.running.kill()


class Session:
    """One session under way."""

    def __init__(self, plan: SessionPlan) -> None:
        self.plan = plan
        self.isolation = Isolation.from_plain(plan.isolation)
        self.record = SessionRecord(
            plan.session,
            attempt=plan.attempt,
            disturbed_before=plan.disturbed_before,
            seed=plan.seed,
            isolation=self.isolation.describe(),
            versions=plan.versions,
        )
        self.folder, self.scratch = Path(plan.folder), Path(plan.scratch)
        self.workspace = self.scratch / "ws"
        #: Where launch files are evaluated: a copy, since reading one runs what it will.
        self.trial = self.scratch / "trial"
        #: Folders that the student's processes may change.
        self.areas = {
            WORKSPACE: self.workspace,
            HOME: self.scratch / "home",
            TEMPORARY: self.scratch / "tmp",
            SHARED_MEMORY: self.scratch / "shm",
        }
        confined = self.isolation.namespaces
        seen = {target: target if confined else str(folder) for target, folder in self.areas.items()}
        self.seen_workspace, self.seen_home, self.seen_temporary = seen[WORKSPACE], seen[HOME], seen[TEMPORARY]
        self.tools = {
            INSIDE: INSIDE_FOLDER,
            LAUNCHING: LAUNCHING_FOLDER,
            PARAMETERS: self.scratch / "parameters",
        }
        self.seen_tools = {t: t if confined else str(p) for t, p in self.tools.items()}
        self.processes: dict[str, RunningProcess] = {}
        self.director: _Director | None = None
        #: Student's programs that never began, and how the session would be disturbed by that.
        self._unstarted: list[tuple[ProcessRun, str]] = []
        self._room = OutputRoom()
        self._launch = LaunchRunner(self)
        self._filter = PacketFilter()
        places = self.isolation.groups
        user = student_uid(self.isolation, plan.slot)
        self._group = CellGroup(places, f"cell-{user or plan.slot}") if places is not None else None
        self._guard = Guard(
            self._students,
            self._group,
            self.areas,
            sized=confined,
            user=user,
            on_problem=self.record.problems.append,
        )

    async def run(self) -> None:
        """Run the session and leave its record, whatever happens."""
        self.record.started_ns = time.time_ns()
        write_session(self.folder, self.record)
        try:
            self._prepare()
            await self._start_director()
            put_self_first()
            watchers = [asyncio.create_task(self._sample()), asyncio.create_task(self._guard.watch())]
            try:
                await asyncio.wait_for(self._run_steps(), self.plan.timeout_s)
            except asyncio.TimeoutError:
                await self._stop_for_time()
            for watcher in watchers:
                if watcher.done():  # They go on until they are cancelled, unless they broke.
                    watcher.result()
                watcher.cancel()
        except Exception as problem:
            self.record.problems.append(f"{type(problem).__name__}: {problem}")
        try:
            await self._finish()
        finally:
            self._sweep()

    async def _stop_for_time(self) -> None:
        """End the student's processes, for which each step waited as long as it may; unless the machine stood still."""
        step, now_ns = self.record.steps[-1], time.time_ns()
        step.outcome, step.ended_ns = "timeout", now_ns
        alive = [process for process in self._students() if process.alive]
        sampled_s = len(self.record.machine) * _SAMPLE_PERIOD_S
        if not alive or sampled_s < _SAMPLED_SHARE * (now_ns - self.record.started_ns) / 1e9:
            self.record.problems.append(f"the session took longer than {self.plan.timeout_s:g} s and was stopped")
        for process in alive:
            await process.kill(limit="time")

    # -- start and end ------------------------------------------------------------------------

    def _prepare(self) -> None:
        """Bring the loopback up, and lay out the student's folders, each a file system of its own size."""
        (self.scratch / "trusted").mkdir()
        self.tools[PARAMETERS].mkdir()
        for folder in (*self.areas.values(), self.trial):
            folder.mkdir()
        if self.isolation.namespaces:
            _bring_loopback_up()
            _use_up_process_ids()
            _mount_tmpfs("/dev/shm", _SMALL_BYTES)
            for folder in (*self.areas.values(), self.trial):
                large = folder in (self.workspace, self.trial)
                _mount_tmpfs(str(folder), _WORKSPACE_BYTES if large else _SMALL_BYTES)
        else:
            _adopt_orphans()
            self.scratch.chmod(0o711)
        for area in (HOME, TEMPORARY, SHARED_MEMORY):
            self.areas[area].chmod(0o1777)
        if self._group is not None:
            self._group.make()
        self.copy_workspace(Path(self.plan.staged), self.workspace)

    def copy_workspace(self, source: Path, target: Path) -> None:
        """Make a folder a copy of a staged submission, owned by the student; links are copied as links."""
        for left in target.iterdir():
            if left.is_dir() and not left.is_symlink():
                remove_tree(left)
            else:
                left.unlink()
        copy_tree(source, target, student_uid(self.isolation, self.plan.slot))

    async def _start_director(self) -> None:
        settings = {
            "folder": self.plan.folder,
            "name": self.plan.session,
            "domain_id": self.plan.domain_id,
            "reference_nodes": [spec["node"] for spec in self.plan.reference.values()],
            "expected": self.plan.expected,
        }
        run = ProcessRun("director", "grader", ["python", "-m", "grader.live.director"])
        director = _Director(self.record)
        main = importlib.import_module("grader.live.director").main
        director.running = await self._start_trusted(run, main, [json.dumps(settings)], on_message=director.on_message)
        self.director = director
        ready = asyncio.create_task(director.ready.wait())
        await asyncio.wait(
            {ready, director.running.exited}, timeout=_DIRECTOR_START_S, return_when=asyncio.FIRST_COMPLETED
        )
        if not director.ready.is_set():
            said = "; ".join(line.text for line in run.output[-5:])
            raise RuntimeError(f"the director did not start: {said}")
        director.running.put_standing()
        self._filter.protect(director.running.root_pid() or 0)

    async def _start_trusted(
        self,
        run: ProcessRun,
        main: Callable[[], object],
        arguments: list[str],
        *,
        on_message: Callable[[bytes], None] | None = None,
    ) -> RunningProcess:
        self.record.processes.append(run)
        environment = trusted_environment(self.scratch / "trusted", self.plan.domain_id)
        program = Program(run.name, main, arguments, environment, _TRUSTED_BYTES)
        return await RunningProcess.fork(run, program, on_message=on_message)

    async def _finish(self) -> None:
        self._launch.end()
        await self._guard.look()  # while it can still be seen who took what
        for name, process in self.processes.items():
            if process.alive and process.run.role == "student":
                await process.kill()
            elif process.alive:
                await process.stop(2.0)
                if process.run.ended_by != "interrupt":
                    self.record.problems.append(f"the reference node {name} did not end when it was asked to")
            elif process.run.role == "reference":
                self.record.problems.append(f"the reference node {name} ended with status {process.run.exit_status}")
        if self.director is not None:
            if not self.director.running.alive:
                said = "; ".join(line.text for line in self.director.running.run.output[-3:])
                self.record.problems.append(f"the recorder died: {said}")
            await self.director.stop()
        take_told(self.record)
        await self._guard.look()
        self._blame_unstarted()
        _recover_bag(self.folder)
        self.record.ended_ns = time.time_ns()
        self.record.complete = True
        write_session(self.folder, self.record)

    def note_unstarted(self, run: ProcessRun, what: str) -> None:
        """Note that a program of the student's never began; whose doing that is, is told at the end."""
        said = run.output[-1].text if run.output else "nothing"
        self._unstarted.append((run, f"{what} in its cell: {said}"))

    def _blame_unstarted(self) -> None:
        """Lay it at the student's door where its own processes left no room for more; else it is a problem."""
        students = (run.limit for run in self.record.processes if run.role == "student")
        filled = next((limit for limit in students if limit in _LEAVES_NO_ROOM), None)
        for run, problem in self._unstarted:
            run.limit = run.limit or filled
            if filled is None:
                self.record.problems.append(problem)

    def _sweep(self) -> None:
        """See to it that none of the student's processes is left."""
        if self._group is not None:
            self._group.remove()
        self.end_strays()

    def end_strays(self) -> None:
        """End what the student's processes left behind, where no namespace does; none of them may be running."""
        if self.isolation.namespaces:
            return
        end_s = time.monotonic() + _SWEEP_S
        while (left := self._strays()) and time.monotonic() < end_s:
            for pid in left:
                with suppress(ProcessLookupError, PermissionError):
                    os.kill(pid, signal.SIGKILL)
                with suppress(ChildProcessError):
                    os.waitpid(pid, os.WNOHANG)

    def _strays(self) -> list[int]:
        """Return the processes below this one that are none of the grader's."""
        trusted = [p for p in self.processes.values() if p.run.role != "student"]
        trusted += [self.director.running] if self.director is not None else []
        roots = [root for p in trusted if p.alive and (root := p.root_pid()) is not None]
        ours = {os.getpid(), *(pid for root in roots for pid in descendants_of(root))}
        return [pid for pid in descendants_of(os.getpid()) if pid not in ours]

    async def _sample(self) -> None:
        while True:
            await asyncio.sleep(_SAMPLE_PERIOD_S)
            students_ns = self._group.cpu_ns() if self._group is not None else None
            self.record.machine.append(replace(sample_machine(), students_ns=students_ns))
            for process in self.processes.values():
                process.sample_usage()
                if process.run.role == "reference" and process.alive:
                    self._filter.protect(process.root_pid() or 0)  # it may have new sockets
            if self.director is not None:
                self.director.running.sample_usage()
                self._filter.protect(self.director.running.root_pid() or 0)

    # -- steps --------------------------------------------------------------------------------

    async def _run_steps(self) -> None:
        for raw in self.plan.steps:
            step = StepRun(raw["kind"], raw["parameters"], raw.get("label"), started_ns=time.time_ns())
            self.record.steps.append(step)
            _tell(
                {
                    "event": "step",
                    "text": raw["words"],
                    "index": len(self.record.steps),
                    "of": len(self.plan.steps),
                }
            )
            # What is not done here is an operation of the director's.
            action = getattr(self, f"_step_{step.kind}", None) or partial(self._direct, step.kind)
            step.outcome, step.result = await action(step.parameters)
            step.ended_ns = time.time_ns()
            if step.kind == "wait_for":
                self._hold_students_to_cores()
            if step.kind == "wait_for" and (name := step.result.get("name")):
                wanted = next(step.parameters[k] for k in _NAMED if step.parameters.get(k))
                if name != wanted:
                    self.record.names[wanted] = name

    def _hold_students_to_cores(self) -> None:
        cores = sorted(os.sched_getaffinity(0))
        for number, process in enumerate(self._students()):
            if process.alive:
                core = cores[(self.plan.slot + number) % len(cores)]
                process.hold_to_core(core, student_uid(self.isolation, self.plan.slot))
                process.put_standing()

    async def _step_start(self, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
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
        for wanted, new in {**parameters["remappings"], **(parameters["composed"] if composed else {})}.items():
            arguments += ["-r", f"{self.record.names.get(wanted, wanted)}:={new}"]
        command = [self.plan.interpreter, f"{self.seen_workspace}/{wrapper}"]
        command += ["--ros-args", *arguments] if arguments else []
        source = Path(self.plan.sources.get(artifact, ""))
        cwd = str(Path(self.seen_workspace) / "src" / source.parent)
        await self.start_student(name, command, artifact=artifact, cwd=cwd)
        return "done", {"started": True}

    async def start_student(
        self,
        name: str,
        command: list[str],
        *,
        artifact: str | None = None,
        cwd: str | None = None,
        environment: dict[str, str] | None = None,
    ) -> RunningProcess:
        """Start one of the student's processes, confined and with the tap."""
        run = ProcessRun(name, "student", command, artifact)
        tap_read, tap_write = os.pipe()
        base = self.student_environment({"GRADER_TAP_FD": str(tap_write), **(environment or {})})
        try:
            running = await self.start_confined(run, command, base, cwd, pass_fds=(tap_write,))
        except BaseException:
            os.close(tap_read)
            raise
        finally:
            os.close(tap_write)
        PipeReader(tap_read, _MAX_CLAIM_BYTES, lambda text: self._note_claims(run, text))
        self.processes[name] = running
        return running

    async def start_confined(
        self,
        run: ProcessRun,
        command: list[str],
        environment: Mapping[str, str],
        cwd: str | None,
        *,
        workspace: Path | None = None,
        folders: Mapping[str, Path] | None = None,
        pass_fds: tuple[int, ...] = (),
        with_input: bool = False,
    ) -> RunningProcess:
        """Start a command of the student's, confined, and record it as `run`.

        Parameters
        ----------
        workspace : Path or None
            What it sees as the workspace, instead of the session's.
        folders : mapping or None
            Folders that it may read besides: where it sees them -> where they are.
        """
        self.record.processes.append(run)
        if workspace is None and cwd is not None and PurePosixPath(cwd).is_relative_to(self.seen_workspace):
            # An earlier program may have made of it what it liked, which must not keep this one from its beginning.
            try:
                restore_way(self.workspace, PurePosixPath(cwd).relative_to(self.seen_workspace), _OPEN)
            except OSError:
                cwd = self.seen_workspace
        room = Room(
            {**self.areas, WORKSPACE: workspace or self.workspace},
            {**self.tools, **(folders or {})},
            Path(self.plan.interpreter),
        )
        with _descriptors_of_bubblewrap(self.isolation) as (info_read, passed):
            argv = student_argv(
                self.isolation,
                command,
                environment=environment,
                room=room,
                slot=self.plan.slot,
                descriptors=passed,
                cwd=cwd or self.seen_home,
                group=self._group,
            )
            return await RunningProcess.start(
                run,
                argv,
                environment={"PATH": os.environ.get("PATH", "/usr/bin:/bin")},
                cwd="/",
                pass_fds=(*passed, *pass_fds),
                child_pid_fd=info_read,
                with_input=with_input,
                room=self._room,
            )

    def student_environment(self, more: dict[str, str]) -> dict[str, str]:
        """Environment of a student's process, with some variables more."""
        base = student_environment(
            Path(self.plan.interpreter),
            self.seen_home,
            self.seen_workspace,
            self.seen_tools[INSIDE],
            self.plan.domain_id,
        )
        return {**base, "TMPDIR": self.seen_temporary, **more}

    def _note_claims(self, run: ProcessRun, text: str) -> None:
        if run.artifact is not None and not text.startswith('{"kind": "started"'):
            self.note_unstarted(run, f"{run.name} could not be started")
        claims = claims_in(text, run.name, f"{self.seen_workspace}/src/")
        self.record.claims += claims[: max(0, _MOST_CLAIMS - len(self.record.claims))]

    async def _start_reference(self, name: str, settings: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        spec = self.plan.reference[name]
        configuration = {
            "seed": self.plan.seed,
            "names": self.record.names,
            "with": settings,
            "subscriptions": self._subscriptions(),
            "types": self._types(),
        }
        run = ProcessRun(name, "reference", ["python", Path(spec["file"]).name, json.dumps(configuration)])
        # Not on the command line, which everybody can read where process ids are not the cell's own: the seed is in it.
        running = await self._start_trusted(run, script(spec["file"]), ["-"])
        running.write(json.dumps(configuration).encode())
        running.close_input()
        self.processes[name] = running
        outcome, result = await self._wait_output(name, "ready", _REFERENCE_START_S)
        if outcome != "done":
            self.record.problems.append(f"the reference node {name} did not get ready")
        running.put_standing()
        self._filter.protect(running.root_pid() or 0, next(participants_told(run), ""))
        return outcome, result

    def _types(self) -> dict[str, str]:
        """Return the types of the topics to which the student subscribes, which may not be the lab's."""
        waits = [s for s in self.record.steps if s.kind == "wait_for" and s.parameters.get("subscription")]
        return {s.result["name"]: s.result["type"] for s in waits if "type" in s.result}

    def _subscriptions(self) -> dict[str, int]:
        """Count the student's subscriptions by topic, those of a process that died included."""
        ours = {spec["node"] for spec in self.plan.reference.values()}
        endpoints = self.record.graph[-1].endpoints if self.record.graph else []
        return dict(Counter(e.topic for e in endpoints if e.kind == "subscription" and e.node not in ours))

    async def _step_wait_for(self, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        if parameters["output_of"]:
            return await self._wait_output(parameters["output_of"], parameters["text"] or "", parameters["timeout_s"])
        return await self._direct("wait_for", parameters)

    async def _direct(self, op: str, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        """Have the director do it, but not for longer than the student has processes."""
        assert self.director is not None
        if not any(p.alive for p in self._students()) and not self._launch.waiting:
            return "cancelled", {"problem": "the student's process had ended"}
        answer = asyncio.create_task(self.director.ask({"op": op, **parameters}))
        ended = asyncio.create_task(self._students_ended())
        await asyncio.wait({answer, ended}, return_when=asyncio.FIRST_COMPLETED)
        if not answer.done():
            self.director.cancel()
        ended.cancel()
        return await answer

    def _students(self) -> list[RunningProcess]:
        return [p for p in self.processes.values() if p.run.role == "student"]

    async def _students_ended(self) -> None:
        while self._launch.waiting or any(p.alive for p in self._students()):
            await asyncio.wait(
                {p.exited for p in self._students() if p.alive} | self._launch.waiting,
                return_when=asyncio.FIRST_COMPLETED,
            )
        await asyncio.sleep(_AFTER_EXIT_S)

    async def _wait_output(self, name: str, text: str, timeout_s: float) -> tuple[str, dict[str, Any]]:
        process = self.processes.get(name)
        if process is None:
            return "failed", {"problem": f"there is no process {name}"}
        seen = asyncio.Event()
        process.on_line = lambda line: seen.set() if text in line.text else None
        if any(text in line.text for line in process.run.output):
            seen.set()
        waiting = asyncio.create_task(seen.wait())
        await asyncio.wait({waiting, process.exited}, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        process.on_line = None
        return ("done" if seen.is_set() else "timeout"), {}

    async def _step_interrupt(self, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        everyone = parameters["process"] == "*"
        chosen = [p for p in self._students() if everyone or p.run.name == parameters["process"]]
        if everyone:
            self._launch.end()
        alive = [p for p in chosen if p.alive]
        await asyncio.gather(*(p.stop(parameters["timeout_s"]) for p in alive))
        for process in alive:
            if process.run.interrupted_ns is None and process.run.ended_by in ("terminate", "kill"):
                self.record.problems.append(f"{process.run.name} was not interrupted: its process was not found")
        ended = {p.run.name: p.run.ended_by for p in chosen}
        stubborn = [n for n, how in ended.items() if how in ("terminate", "kill")]
        return ("timeout" if stubborn else "done"), {"ended_by": ended}

    async def _step_wait_exit(self, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        process = self.processes.get(parameters["process"])
        if process is None:
            return "failed", {"problem": f"there is no process {parameters['process']}"}
        return ("done" if await process.wait_exit(parameters["timeout_s"]) else "timeout"), {}

    # -- launch files -------------------------------------------------------------------------

    async def _step_plan(self, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        outcome, result = await self._launch.plan(parameters)
        if self.record.plan is None and not parameters["arguments"]:
            self.record.plan = result.get("plan")
        return outcome, result


_NAMED = ("node", "publisher", "subscription", "service")


def _tell(event: dict[str, Any]) -> None:
    with suppress(BrokenPipeError):
        sys.stdout.write(json.dumps(event) + "\n")
        sys.stdout.flush()


@contextmanager
def _descriptors_of_bubblewrap(isolation: Isolation) -> Iterator[tuple[int | None, tuple[int, ...]]]:
    """Give where bubblewrap's child is told, and what to pass on to bubblewrap; where it is not used, nothing."""
    if not isolation.namespaces:
        yield None, ()
        return
    info_read, info_write = os.pipe()
    os.set_blocking(info_read, False)
    seccomp = open_filter()
    try:
        yield info_read, (info_write, seccomp)
    finally:
        os.close(info_write)
        os.close(seccomp)


def _bring_loopback_up() -> None:
    get_flags, set_flags, up = 0x8913, 0x8914, 0x1
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        request = struct.pack("16sh14x", b"lo", 0)
        flags = struct.unpack("16sh14x", fcntl.ioctl(sock, get_flags, request))[1]
        fcntl.ioctl(sock, set_flags, struct.pack("16sh14x", b"lo", flags | up))


def _use_up_process_ids() -> None:
    """Let our processes have other ids than the student's, which count anew in each sandbox.

    The identity that Fast DDS gives a participant is made of the process id and two random bytes.
    """
    for _ in range(_STUDENTS_IDS):
        thread = threading.Thread(target=int)  # A thread has an id of the same kind, and is cheaper than a fork.
        thread.start()
        thread.join()


def _adopt_orphans() -> None:
    """Become the parent of what the student's processes leave behind, so that it can be found."""
    ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def _mount_tmpfs(target: str, size_bytes: int) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    options = f"size={size_bytes},nr_inodes={_MAX_FILES},mode=0755"
    if libc.mount(b"tmpfs", target.encode(), b"tmpfs", 0, options.encode()) != 0:
        raise OSError(ctypes.get_errno(), f"no tmpfs on {target}")


def _recover_bag(folder: Path) -> None:
    from grader.recording.bag import recover

    recover(folder)


def run(plan: SessionPlan) -> None:
    """Run a session; this process must be the first of its cell."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    asyncio.run(Session(plan).run())
    _tell({"event": "ended"})
