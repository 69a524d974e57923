"""A session, as the first process of its cell: start, steps, stop → recording.

Started by `grader.live.cells` with a `SessionPlan` as JSON in a file. It starts the director, the
reference nodes and the student's processes, runs the steps, and writes `session.json` beside the
bag. It touches no ROS itself. Progress goes to standard output, one JSON line each.
"""

from __future__ import annotations

import asyncio
import ctypes
import fcntl
import json
import os
import shutil
import signal
import socket
import struct
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from grader.live.environment import INSIDE_FOLDER, student_environment, trusted_environment
from grader.live.isolation import HOME, INSIDE, LAUNCHING, WORKSPACE, Form, Isolation, student_argv, student_uid
from grader.live.process import RunningProcess
from grader.recording.session import (
    Claim,
    GraphSnapshot,
    ProcessRun,
    Qos,
    SessionRecord,
    StepRun,
    from_plain,
    write_session,
)

_HERE = Path(__file__).parent
_WORKSPACE_BYTES = 256 * 1024 * 1024
_MAX_CLAIM_BYTES = 512 * 1024
_MAX_PLAN_BYTES = 4 * 1024 * 1024
_DIRECTOR_START_S = 20.0
_DIRECTOR_STOP_S = 8.0
_REFERENCE_START_S = 15.0
_SAMPLE_PERIOD_S = 0.5
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
    versions: dict[str, str] = field(default_factory=dict)


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
            self.ready.set()
        elif event["event"] == "stopped":
            self._record.problems += event["problems"]
            self.stopped.set()
        elif self._answer is not None and not self._answer.done():
            self._answer.set_result(event)

    def _send(self, request: dict[str, Any]) -> None:
        self.running.write((json.dumps(request) + "\n").encode())

    async def ask(self, request: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        self._answer = asyncio.get_running_loop().create_future()
        self._send(request)
        done, _ = await asyncio.wait({self._answer, self.running.exited}, return_when=asyncio.FIRST_COMPLETED)
        if self._answer not in done:
            return "failed", {"problem": "the director ended"}
        answer = self._answer.result()
        return answer["outcome"], answer["result"]

    def cancel(self) -> None:
        self._send({"op": "cancel"})

    async def stop(self) -> None:
        self._send({"op": "stop"})
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self.stopped.wait(), _DIRECTOR_STOP_S)
        if not self.stopped.is_set():
            self._record.problems.append("the recorder did not end in order; its bag was recovered")
        await self.running.wait_exit(1.0)
        await self.running.kill()


class Session:
    """One session under way."""

    def __init__(self, plan: SessionPlan) -> None:
        self.plan = plan
        self.isolation = Isolation.from_plain(plan.isolation)
        self.record = SessionRecord(plan.session, seed=plan.seed, isolation=self.isolation.describe(), versions=plan.versions)
        self.folder, self.scratch = Path(plan.folder), Path(plan.scratch)
        self.workspace = self.scratch / "ws"
        confined = self.isolation.form is not Form.NONE
        self.seen_workspace = WORKSPACE if confined else str(self.workspace)
        self.seen_home = HOME if confined else str(self.scratch / "home")
        self.tools = {INSIDE: INSIDE_FOLDER, LAUNCHING: _HERE / "launching"}
        self.seen_tools = {t: t if confined else str(p) for t, p in self.tools.items()}
        self.processes: dict[str, RunningProcess] = {}
        self.director: _Director | None = None
        self._deferred: set[asyncio.Task[None]] = set()
        self._ending = False

    async def run(self) -> None:
        """Run the session and leave its record, whatever happens."""
        self.record.started_ns = time.time_ns()
        write_session(self.folder, self.record)
        try:
            self._prepare()
            await self._start_director()
            sampler = asyncio.create_task(self._sample())
            try:
                await asyncio.wait_for(self._run_steps(), self.plan.timeout_s)
            except asyncio.TimeoutError:
                self.record.problems.append(f"the session took longer than {self.plan.timeout_s:g} s and was stopped")
            sampler.cancel()
        except Exception as problem:
            self.record.problems.append(f"{type(problem).__name__}: {problem}")
        await self._finish()

    # -- start and end ------------------------------------------------------------------------

    def _prepare(self) -> None:
        """Bring the loopback up, and lay out the workspace on a sized file system of its own."""
        self.workspace.mkdir()
        (self.scratch / "home").mkdir()
        (self.scratch / "trusted").mkdir()
        if self.isolation.form is not Form.NONE:
            _bring_loopback_up()
            _mount_tmpfs("/dev/shm", 64 * 1024 * 1024)
            _mount_tmpfs(str(self.workspace), _WORKSPACE_BYTES)
        shutil.copytree(self.plan.staged, self.workspace, dirs_exist_ok=True, copy_function=shutil.copy)
        uid = student_uid(self.isolation, self.plan.slot)
        for path in (self.workspace, *self.workspace.rglob("*")):
            path.chmod(0o755 if path.is_dir() else path.stat().st_mode & 0o777 | 0o644)
            if uid is not None:
                os.chown(path, uid, uid, follow_symlinks=False)

    async def _start_director(self) -> None:
        settings = {
            "folder": self.plan.folder, "name": self.plan.session, "domain_id": self.plan.domain_id,
            "reference_nodes": [spec["node"] for spec in self.plan.reference.values()], "expected": self.plan.expected,
        }
        run = ProcessRun("director", "grader", ["python", "-m", "grader.live.director"])
        director = _Director(self.record)
        arguments = ["-m", "grader.live.director", json.dumps(settings)]
        director.running = await self._start_trusted(run, arguments, with_input=True, on_message=director.on_message)
        self.director = director
        ready = asyncio.create_task(director.ready.wait())
        await asyncio.wait({ready, director.running.exited}, timeout=_DIRECTOR_START_S, return_when=asyncio.FIRST_COMPLETED)
        if not director.ready.is_set():
            said = "; ".join(line.text for line in run.output[-5:])
            raise RuntimeError(f"the director did not start: {said}")

    async def _start_trusted(
        self, run: ProcessRun, arguments: list[str], *, with_input: bool = False, on_message: Callable[[bytes], None] | None = None
    ) -> RunningProcess:
        self.record.processes.append(run)
        home = self.scratch / "trusted"
        environment = trusted_environment(home, self.plan.domain_id)
        argv = ["setpriv", "--pdeathsig", "KILL", sys.executable, "-I", *arguments]
        return await RunningProcess.start(run, argv, environment=environment, cwd="/", with_input=with_input, on_message=on_message)

    async def _finish(self) -> None:
        self._ending = True
        for task in self._deferred:
            task.cancel()
        for name, process in self.processes.items():
            if process.alive and process.run.role == "student":
                await process.kill()
            elif process.alive:
                await process.stop(2.0)
            elif process.run.role == "reference" and process.run.exit_status != 0:
                self.record.problems.append(f"the reference node {name} ended with status {process.run.exit_status}")
        if self.director is not None:
            if not self.director.running.alive:
                said = "; ".join(line.text for line in self.director.running.run.output[-3:])
                self.record.problems.append(f"the recorder died: {said}")
            await self.director.stop()
        _recover_bag(self.folder)
        self.record.ended_ns = time.time_ns()
        self.record.complete = True
        write_session(self.folder, self.record)

    async def _sample(self) -> None:
        while True:
            await asyncio.sleep(_SAMPLE_PERIOD_S)
            for process in self.processes.values():
                process.sample_usage()
            if self.director is not None:
                self.director.running.sample_usage()

    # -- steps --------------------------------------------------------------------------------

    async def _run_steps(self) -> None:
        for raw in self.plan.steps:
            step = StepRun(raw["kind"], raw["parameters"], raw.get("label"), started_ns=time.time_ns())
            self.record.steps.append(step)
            _tell({"event": "step", "text": _describe(step), "index": len(self.record.steps), "of": len(self.plan.steps)})
            step.outcome, step.result = await getattr(self, f"_step_{step.kind}")(step.parameters)
            step.ended_ns = time.time_ns()
            if step.kind == "wait_for" and (name := step.result.get("name")):
                wanted = next(step.parameters[k] for k in _NAMED if step.parameters.get(k))
                if name != wanted:
                    self.record.names[wanted] = name

    async def _step_start(self, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        if parameters["reference"]:
            return await self._start_reference(parameters["reference"], parameters["with"])
        if parameters["launch"]:
            return await self._start_launch(parameters["launch"])
        artifact = parameters["student"]
        wrapper = self.plan.executables.get(artifact)
        if wrapper is None:
            return "failed", {"problem": "missing artifact", "artifact": artifact}
        name = parameters["name"] or artifact
        if parameters["if_ended"] and self.processes[name].alive:
            return "done", {"started": False}
        arguments = []
        for parameter, value in parameters["parameters"].items():
            arguments += ["-p", f"{parameter}:={json.dumps(value)}"]
        for wanted, new in parameters["remappings"].items():
            arguments += ["-r", f"{self.record.names.get(wanted, wanted)}:={new}"]
        command = [self.plan.interpreter, f"{self.seen_workspace}/{wrapper}"]
        command += ["--ros-args", *arguments] if arguments else []
        source = Path(self.plan.sources.get(artifact, ""))
        cwd = str(Path(self.seen_workspace) / "src" / source.parent)
        await self._start_student(name, command, artifact=artifact, cwd=cwd)
        return "done", {"started": True}

    async def _start_student(
        self, name: str, command: list[str], *, artifact: str | None = None, cwd: str | None = None,
        environment: dict[str, str] | None = None,
    ) -> RunningProcess:
        run = ProcessRun(name, "student", command, artifact)
        self.record.processes.append(run)
        info_read, info_write = os.pipe()
        tap_read, tap_write = os.pipe()
        os.set_blocking(info_read, False)
        base = self._student_environment({"GRADER_TAP_FD": str(tap_write), **(environment or {})})
        argv = self._confined(command, base, info_write, cwd)
        running = await RunningProcess.start(
            run, argv, environment={"PATH": os.environ.get("PATH", "/usr/bin:/bin")}, cwd="/",
            pass_fds=(info_write, tap_write), child_pid_fd=info_read if self.isolation.form is not Form.NONE else None,
        )
        os.close(info_write)
        os.close(tap_write)
        _PipeReader(tap_read, _MAX_CLAIM_BYTES, lambda text: self._note_claims(run, text))
        self.processes[name] = running
        return running

    def _student_environment(self, more: dict[str, str]) -> dict[str, str]:
        base = student_environment(
            Path(self.plan.interpreter), self.seen_home, self.seen_workspace, self.seen_tools[INSIDE], self.plan.domain_id
        )
        return {**base, **more}

    def _confined(self, command: list[str], environment: dict[str, str], info_fd: int, cwd: str | None) -> list[str]:
        return student_argv(
            self.isolation, command, environment=environment, workspace=self.workspace, tools=self.tools,
            interpreter=Path(self.plan.interpreter), slot=self.plan.slot, info_fd=info_fd, cwd=cwd or self.seen_home,
        )

    def _note_claims(self, run: ProcessRun, text: str) -> None:
        if run.artifact is not None and not text.startswith('{"kind": "started"'):
            said = run.output[-1].text if run.output else "nothing"
            self.record.problems.append(f"{run.name} could not be started in its cell: {said}")
        for line in text.splitlines()[1:]:
            with suppress(ValueError, TypeError, KeyError, AttributeError):
                note = json.loads(line)
                qos = Qos(**note["qos"]) if note.get("qos") else None
                claim = Claim(
                    run.name, str(note["kind"]), str(note["name"]), str(note["node"]), str(note.get("type", "")),
                    str(note["file"]).removeprefix(f"{self.seen_workspace}/src/"), int(note["line"]), qos, note.get("value"),
                )
                self.record.claims.append(claim)

    async def _start_reference(self, name: str, settings: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        spec = self.plan.reference[name]
        configuration = {"seed": self.plan.seed, "names": self.record.names, "with": settings}
        run = ProcessRun(name, "reference", ["python", Path(spec["file"]).name, json.dumps(configuration)])
        self.processes[name] = await self._start_trusted(run, [spec["file"], json.dumps(configuration)])
        outcome, result = await self._wait_output(name, "ready", _REFERENCE_START_S)
        if outcome != "done":
            self.record.problems.append(f"the reference node {name} did not get ready")
        return outcome, result

    async def _step_wait_for(self, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        if parameters["output_of"]:
            return await self._wait_output(parameters["output_of"], parameters["text"] or "", parameters["timeout_s"])
        return await self._direct("wait_for", parameters)

    async def _step_observe(self, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        return await self._direct("observe", parameters)

    async def _step_publish(self, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        return await self._direct("publish", parameters)

    async def _step_call(self, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        return await self._direct("call", parameters)

    async def _step_get_parameters(self, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        return await self._direct("get_parameters", parameters)

    async def _step_set_parameters(self, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        return await self._direct("set_parameters", parameters)

    async def _direct(self, op: str, parameters: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        """Have the director do it, but not for longer than the student has processes."""
        assert self.director is not None
        if not any(p.alive for p in self._students()) and not self._deferred:
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
        while self._deferred or any(p.alive for p in self._students()):
            await asyncio.wait({p.exited for p in self._students() if p.alive} | self._deferred, return_when=asyncio.FIRST_COMPLETED)
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
            self._ending = True
        alive = [p for p in chosen if p.alive]
        await asyncio.gather(*(p.stop(parameters["timeout_s"]) for p in alive))
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
        source = self.plan.sources.get(parameters["launch"])
        if source is None:
            return "failed", {"problem": "missing artifact", "artifact": parameters["launch"]}
        outcome, plan = await self._evaluate(source, parameters["arguments"], parameters["timeout_s"])
        if self.record.plan is None and not parameters["arguments"]:
            self.record.plan = plan
        return outcome, {"plan": plan}

    async def _evaluate(self, source: str, arguments: dict[str, str], timeout_s: float) -> tuple[str, dict[str, Any]]:
        """Execute the launch file, confined, and read its plan from a pipe of its own."""
        root = f"{self.seen_workspace}/src"
        request = {"file": f"{root}/{source}", "arguments": arguments, "root": root}
        result_read, result_write = os.pipe()
        info_read, info_write = os.pipe()
        os.set_blocking(info_read, False)
        command = [self.plan.interpreter, f"{self.seen_tools[LAUNCHING]}/evaluate.py", "--result-fd", str(result_write)]
        environment = self._student_environment({"PYTHONPATH": ""})
        run = ProcessRun("launch file" + "".join(f" {k}:={v}" for k, v in arguments.items()), "student", command)
        self.record.processes.append(run)
        received: list[str] = []
        running = await RunningProcess.start(
            run, self._confined(command, environment, info_write, f"{root}/{Path(source).parent}"),
            environment={"PATH": os.environ.get("PATH", "/usr/bin:/bin")}, cwd="/", pass_fds=(info_write, result_write),
            child_pid_fd=info_read if self.isolation.form is not Form.NONE else None, with_input=True,
        )
        os.close(info_write)
        os.close(result_write)
        reader = _PipeReader(result_read, _MAX_PLAN_BYTES, received.append)
        running.write(json.dumps(request).encode())
        running.close_input()
        in_time = await running.wait_exit(timeout_s)
        await running.kill()
        reader.close()
        return _read_plan(received, in_time, timeout_s, run)

    async def _start_launch(self, artifact: str) -> tuple[str, dict[str, Any]]:
        plan = self.record.plan
        if plan is None or plan.get("outcome") != "ok":
            return "failed", {"problem": "the launch file could not be evaluated"}
        files = self.workspace / "parameters"
        files.mkdir(exist_ok=True)
        started, waiting = [], []
        for entry in plan["processes"]:
            for name, text in entry.get("parameter_files", {}).items():
                (files / Path(name).name).write_text(text, encoding="utf-8")
            if entry.get("when"):
                waiting.append(entry)
            elif entry.get("path"):
                started.append(entry["id"])
                await self._start_planned(entry)
        for entry in waiting:
            task = asyncio.create_task(self._start_later(entry))
            self._deferred.add(task)
            task.add_done_callback(self._deferred.discard)
        return "done", {"started": started, "later": [e["id"] for e in waiting]}

    async def _start_planned(self, entry: dict[str, Any]) -> None:
        argv = [a.replace("{parameters}", f"{self.seen_workspace}/parameters") for a in entry["argv"]]
        running = await self._start_student(
            entry["id"], [entry["path"], *argv], environment=entry.get("env") or {}, cwd=entry.get("cwd") or None
        )
        if entry.get("respawn"):
            task = asyncio.create_task(self._respawn(entry, running))
            self._deferred.add(task)
            task.add_done_callback(self._deferred.discard)

    async def _respawn(self, entry: dict[str, Any], running: RunningProcess, limit: int = 3) -> None:
        await running.wait_exit(self.plan.timeout_s)
        if not self._ending and limit > 0:
            await asyncio.sleep(float(entry.get("respawn_delay_s") or 0.0))
            again = {**entry, "id": f"{entry['id']} (again)", "respawn": False}
            await self._start_planned(again)

    async def _start_later(self, entry: dict[str, Any]) -> None:
        when = entry["when"]
        if "after_s" in when:
            await asyncio.sleep(float(when["after_s"]))
        elif "on_exit_of" in when or "on_start_of" in when:
            awaited = when.get("on_exit_of") or when.get("on_start_of")
            while awaited not in self.processes:
                await asyncio.sleep(0.05)
            if "on_exit_of" in when:
                await self.processes[awaited].wait_exit(self.plan.timeout_s)
        else:
            return
        if not self._ending:
            await self._start_planned(entry)


_NAMED = ("node", "publisher", "subscription", "service")


class _PipeReader:
    """Collects what comes through a pipe, up to a limit, and hands it on when the pipe closes."""

    def __init__(self, fd: int, limit_bytes: int, on_end: Any) -> None:
        self._fd, self._limit, self._on_end = fd, limit_bytes, on_end
        self._blocks: list[bytes] = []
        self._size = 0
        os.set_blocking(fd, False)
        asyncio.get_running_loop().add_reader(fd, self._read)

    def _read(self) -> None:
        try:
            block = os.read(self._fd, 65536)
        except BlockingIOError:
            return
        if not block:
            self.close()
        elif self._size < self._limit:
            self._size += len(block)
            self._blocks.append(block)

    def close(self) -> None:
        if self._fd < 0:
            return
        with suppress(BlockingIOError):
            while self._size < self._limit and (block := os.read(self._fd, 65536)):
                self._size += len(block)
                self._blocks.append(block)
        asyncio.get_running_loop().remove_reader(self._fd)
        os.close(self._fd)
        self._fd = -1
        self._on_end(b"".join(self._blocks).decode("utf-8", "replace"))


def _read_plan(received: list[str], in_time: bool, timeout_s: float, run: ProcessRun) -> tuple[str, dict[str, Any]]:
    """Make a plan out of what the evaluation wrote, or of its silence."""
    with suppress(ValueError, IndexError, TypeError):
        plan = json.loads(received[0])
        if isinstance(plan, dict) and plan.get("outcome") in ("ok", "error", "not_assessable"):
            return "done", plan
    said = run.output[-1].text if run.output else ""
    message = (
        f"evaluating the launch file ended with status {run.exit_status} and no description. {said}".strip()
        if in_time
        else f"the launch file was still busy after {timeout_s:g} s; a launch file describes processes and returns at once"
    )
    problem = {"kind": "no_plan" if in_time else "too_slow", "message": message, "file": "", "line": 0, "remedy": ""}
    return ("done" if in_time else "timeout"), {"outcome": "error", "problem": problem, "processes": [], "arguments": []}


def _describe(step: StepRun) -> str:
    """Say in a few words what a step does, for the progress display."""
    p = step.parameters
    named = next((str(p[k]) for k in (*_NAMED, "output_of", "student", "launch", "reference", "process") if p.get(k)), "")
    words = {
        "start": f"starting {named}", "wait_for": f"waiting for {named}", "call": f"calling {named}",
        "publish": f"publishing on {p.get('topic', '')}",
        "observe": f"observing for {p.get('duration_s', 0):g} s" if step.kind == "observe" else "",
        "interrupt": f"interrupting {named}", "wait_exit": f"waiting until {named} ends",
        "plan": f"evaluating {named}", "get_parameters": f"reading parameters of {named}",
        "set_parameters": f"setting parameters of {named}",
    }
    return words[step.kind]


def _tell(event: dict[str, Any]) -> None:
    with suppress(BrokenPipeError):
        sys.stdout.write(json.dumps(event) + "\n")
        sys.stdout.flush()


def _bring_loopback_up() -> None:
    get_flags, set_flags, up = 0x8913, 0x8914, 0x1
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        request = struct.pack("16sh14x", b"lo", 0)
        flags = struct.unpack("16sh14x", fcntl.ioctl(sock, get_flags, request))[1]
        fcntl.ioctl(sock, set_flags, struct.pack("16sh14x", b"lo", flags | up))


def _mount_tmpfs(target: str, size_bytes: int) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mount(b"tmpfs", target.encode(), b"tmpfs", 0, f"size={size_bytes},mode=0755".encode()) != 0:
        raise OSError(ctypes.get_errno(), f"no tmpfs on {target}")


def _recover_bag(folder: Path) -> None:
    from grader.recording.bag import recover

    recover(folder)


def main() -> None:
    """Run the session whose plan is in the file named by argv[1]."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    plan = SessionPlan(**json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
    asyncio.run(Session(plan).run())
    _tell({"event": "ended"})


if __name__ == "__main__":
    main()


