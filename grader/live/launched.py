"""Launch files in a session: evaluated in confinement, then really run.

The stand-ins for `launch` and `launch_ros` make a *plan* of what `ros2 launch` would start; its processes
are then started like any other of the student's. A mistake that is charged by one check must not hide all
else, so a misnamed executable or package and an argument that is not declared are mended after they were
noted, and the evaluation goes on.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
from collections.abc import Coroutine, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grader.live.isolation import LAUNCHING, Form
from grader.live.names import LEAST_RATIO, likeness
from grader.live.process import PipeReader, RunningProcess
from grader.recording.plan import MalformedPlanError, Plan, Problem, Process
from grader.recording.session import ProcessRun

if TYPE_CHECKING:
    from grader.live.session import Session

_MAX_PLAN_BYTES = 4 * 1024 * 1024
_MAX_MENDS = 6
#: A process that is to be started again and again is so at most this often.
_MAX_RESPAWNS = 3


class LaunchRunner:
    """Evaluates and runs the launch file of a session."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._ending = False
        #: Tasks that may still start processes.
        self.waiting: set[asyncio.Task[None]] = set()

    def end(self) -> None:
        """Start nothing more."""
        self._ending = True
        for task in self.waiting:
            task.cancel()

    # -- evaluation ---------------------------------------------------------------------------

    async def plan(self, parameters: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
        """Evaluate the launch file; returns (outcome, {"plan": ..., "mended": [problem, ...]})."""
        source = self._session.plan.sources.get(parameters["launch"])
        if source is None:
            return "failed", {"problem": "missing artifact", "artifact": parameters["launch"]}
        arguments = dict(parameters["arguments"])
        mended: list[dict[str, Any]] = []
        while True:
            outcome, plan = await self._evaluate(source, arguments, parameters["timeout_s"])
            problem = plan.problem
            if problem is None or len(mended) >= _MAX_MENDS or not self._mend(problem, parameters["assume"], arguments):
                break
            mended.append(
                {
                    "kind": problem.kind,
                    "message": problem.message,
                    "file": problem.file,
                    "line": problem.line,
                    "remedy": problem.remedy,
                }
            )
        return outcome, {"plan": plan.to_plain(), "mended": mended}

    def _mend(self, problem: Problem, assume: Mapping[str, str], arguments: dict[str, str]) -> bool:
        """Make good a problem that a check of its own charges; False if that cannot be done."""
        quoted = re.findall(r"'([^']+)'", problem.message)
        install = self._session.workspace / "install"
        if problem.kind == "unknown_executable" and len(quoted) >= 2 and "found in package" in problem.message:
            return _mend_executable(install / "lib" / quoted[1], quoted[0])
        if problem.kind == "unknown_package" and quoted:
            return _mend_package(install, quoted[0])
        if problem.kind == "undefined_configuration" and quoted and quoted[0] in assume and quoted[0] not in arguments:
            arguments[quoted[0]] = assume[quoted[0]]
            return True
        return False

    async def _evaluate(self, source: str, arguments: dict[str, str], timeout_s: float) -> tuple[str, Plan]:
        """Execute the launch file, confined, and read its plan from a pipe of its own."""
        session = self._session
        root = f"{session.seen_workspace}/src"
        result_read, result_write = os.pipe()
        info_read, info_write = os.pipe()
        os.set_blocking(info_read, False)
        command = [
            session.plan.interpreter,
            f"{session.seen_tools[LAUNCHING]}/evaluate.py",
            "--result-fd",
            str(result_write),
        ]
        environment = session.student_environment({"PYTHONPATH": ""})
        run = ProcessRun("launch file" + "".join(f" {k}:={v}" for k, v in arguments.items()), "student", command)
        session.record.processes.append(run)
        running = await RunningProcess.start(
            run,
            session.confined(command, environment, info_write, f"{root}/{Path(source).parent}"),
            environment={"PATH": os.environ.get("PATH", "/usr/bin:/bin")},
            cwd="/",
            pass_fds=(info_write, result_write),
            child_pid_fd=info_read if session.isolation.form is not Form.NONE else None,
            with_input=True,
        )
        os.close(info_write)
        os.close(result_write)
        received: list[str] = []
        reader = PipeReader(result_read, _MAX_PLAN_BYTES, received.append)
        running.write(json.dumps({"file": f"{root}/{source}", "arguments": arguments, "root": root}).encode())
        running.close_input()
        in_time = await running.wait_exit(timeout_s)
        await running.kill()
        reader.close()
        os.close(info_read)
        return ("done" if in_time else "timeout"), _read_plan(received, in_time, timeout_s, run)

    # -- running ------------------------------------------------------------------------------

    async def start(self, plain: Mapping[str, Any] | None) -> tuple[str, dict[str, Any]]:
        """Start the processes of a plan, now or when it says."""
        if plain is None or plain.get("outcome") != "ok":
            return "failed", {"problem": "the launch file could not be evaluated"}
        plan = Plan.from_plain(plain)
        folder = self._session.workspace / "parameters"
        folder.mkdir(exist_ok=True)
        files = dict(plan.parameter_files)
        for process in plan.processes:
            files.update(process.parameter_files)
        for name, text in files.items():
            (folder / Path(name).name).write_text(text, encoding="utf-8")
        for process in plan.processes:
            if process.when is None:
                await self._start(process)
            else:
                self._later(self._start_when(process, process.when))
        return "done", {"processes": [process.id for process in plan.processes]}

    def _later(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self.waiting.add(task)
        task.add_done_callback(self.waiting.discard)

    async def _start(self, process: Process, respawns: int = 0) -> None:
        name = process.id + (f" (start {respawns + 1})" if respawns else "")
        command = process.command(f"{self._session.seen_workspace}/parameters")
        running = await self._session.start_student(name, command, environment=dict(process.env), cwd=process.cwd)
        if process.respawn and respawns < _MAX_RESPAWNS:
            self._later(self._start_again(process, running, respawns + 1))

    async def _start_again(self, process: Process, running: RunningProcess, respawns: int) -> None:
        await running.wait_exit(self._session.plan.timeout_s)
        await asyncio.sleep(process.respawn_delay_s)
        if not self._ending:
            await self._start(process, respawns)

    async def _start_when(self, process: Process, when: Mapping[str, Any]) -> None:
        awaited = when.get("on_exit_of") or when.get("on_start_of")
        if awaited is not None:
            while awaited not in self._session.processes:
                await asyncio.sleep(0.05)
            if "on_exit_of" in when:
                await self._session.processes[awaited].wait_exit(self._session.plan.timeout_s)
        elif "after_s" not in when:
            return  # It waits for the shutdown, which ends the session.
        await asyncio.sleep(float(when.get("after_s", 0.0)))
        if not self._ending:
            await self._start(process)


def _mend_executable(folder: Path, wanted: str) -> bool:
    """Install the executable that was meant under the name that was used."""
    if not folder.is_dir() or not re.fullmatch(r"[\w.+-]{1,200}", wanted):
        return False
    there = [p for p in folder.iterdir() if p.suffix != ".py" and p.is_file()]
    near = sorted(there, key=lambda p: (-likeness(wanted, p.name), p.name))
    if not near or likeness(wanted, near[0].name) < LEAST_RATIO:
        return False
    shutil.copy(near[0], folder / wanted)
    return True


def _mend_package(install: Path, wanted: str) -> bool:
    """Install the submission's package under the name that was used, if it has only one."""
    index = install / "share/ament_index/resource_index/packages"
    there = sorted(p.name for p in index.iterdir()) if index.is_dir() else []
    if len(there) != 1 or not re.fullmatch(r"[A-Za-z]\w{0,200}", wanted):
        return False
    for part in ("lib", "share"):
        shutil.copytree(install / part / there[0], install / part / wanted)
    (index / wanted).touch()
    return True


def _read_plan(received: list[str], in_time: bool, timeout_s: float, run: ProcessRun) -> Plan:
    """Make a plan out of what the evaluation wrote, or of its silence."""
    with suppress(ValueError, IndexError, MalformedPlanError):
        return Plan.from_plain(json.loads(received[0]))
    if not in_time:
        message = (
            f"the launch file was still busy after {timeout_s:g} s; it should describe processes and return at once"
        )
        return Plan("error", Problem("too_slow", message))
    said = run.output[-1].text if run.output else ""
    message = f"evaluating the launch file ended with status {run.exit_status} and no description. {said}".strip()
    return Plan("error", Problem("no_plan", message))
