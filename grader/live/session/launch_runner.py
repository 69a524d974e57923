"""Launch files in a session: evaluated in confinement, then really run.

The stand-ins for `launch` and `launch_ros` make a *plan* of what `ros2 launch` would start. One mistake must not hide
all else: a misnamed executable or package, an argument that is not declared, a keyword of another ROS and a mistake that
one edit mends, such as a missing comma, are noted and repaired on a copy, and the evaluation goes on.
"""

from __future__ import annotations

import asyncio
import itertools
import os
import re
import shutil
import time
from collections.abc import Container, Coroutine, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from confine.helpers import find_tool
from confine.limits import attainable
from confine.scratch import remove_tree
from grader.evidence.near_miss import LEAST_RATIO, likeness
from grader.evidence.session_variables import is_sessions
from grader.lab.steps.base import Answer
from grader.lab.steps.plan import PlanResult, PlanStep, Repair, repair_of
from grader.lab.steps.start import StartResult
from grader.live.process.process import PipeReader, RunningProcess
from grader.live.sandbox.room import LAUNCHING, PARAMETERS, WORKSPACE
from grader.live.session.launch_edits import edit
from grader.live.session.student_sandbox import StudentSandbox
from grader.recording.session import OutputLine, ProcessRun
from grader.submission.beneath import is_regular_beneath
from grader.submission.file_names import MAX_TEXT_BYTES
from launch_plan.assumed import left_out, without_assumed_parameters
from launch_plan.exchange import MOST_ANSWER_BYTES, Ending, Request, command, plan_of_answer
from launch_plan.format import LEFT_OUT, PARAMETERS_PLACEHOLDER, is_left_out
from launch_plan.plan import Plan, Problem, Process, ros2_run

#: Path of one of the plan's own files in an evaluation.
_OWN_FILE = re.compile(re.escape(PARAMETERS_PLACEHOLDER) + r"/([\w-]+(?:\.\w+)?)")
_MAX_REPAIRS = 6
#: Files of one name: in the sources, and where packages install them.
_MOST_RENAMED = 20
#: Values for arguments without a known value, each with another one to find the parameters that depend on it.
_ASSUMED = (("", "assumed"), ("1", "true"))
#: Names among which the one that was meant is looked for.
_MOST_LIKENED = 100
#: Where a prefix lists its packages.
_INDEX = "share/ament_index/resource_index/packages"
#: Least time of a second evaluation in s: it shows mistakes after the repaired one.
_LEAST_EVALUATION_S = 1.0
_MAX_MEMORY_BYTES = 2 * 1024 * 1024 * 1024
#: Where it waits for a core, it may take so many times as long at most. A wait is known when it is over: so long one
#: may last. How often it is looked at then.
_MOST_EXTENDED, _WAIT_S, _LOOK_S = 4.0, 0.5, 0.1
#: A process that is to be started again and again is so at most this often.
_MAX_RESPAWNS = 3


class LaunchRunner:
    """Evaluates and runs the launch file of a session."""

    def __init__(self, sandbox: StudentSandbox) -> None:
        self._sandbox = sandbox
        self._ending = False
        #: Plans of files with an endless evaluation; these files are not evaluated again.
        self._given_up: dict[str, Plan] = {}
        #: Processes that cannot be started here; no other process waits for them.
        self._absent: set[str] = set()
        #: Text by name of the plan's own files.
        self._files: dict[str, str] = {}
        #: Tasks that may still start processes.
        self.waiting: set[asyncio.Task[None]] = set()

    def end(self) -> None:
        """Start nothing more."""
        self._ending = True
        for task in self.waiting:
            task.cancel()

    # -- evaluation ---------------------------------------------------------------------------

    async def plan(self, step: PlanStep) -> Answer:
        """Evaluate the launch file, and again after each repair of a known mistake."""
        source = self._sandbox.plan.sources.get(step.launch)
        if source is None:
            return Answer("failed", PlanResult("missing artifact", artifact=step.launch))
        evaluation = _Evaluation(source, step.timeout_s, time.monotonic() + step.timeout_s)
        arguments = dict(step.arguments)
        assumed: set[str] = set()
        repairs: list[Repair] = []
        while True:
            outcome, plan = await self._evaluate(evaluation, arguments)
            problem = plan.problem
            if problem is None:
                break
            if len(repairs) >= _MAX_REPAIRS:
                break
            known = {**plan.configurations, **step.assume}
            repair = self._repair(problem, known, arguments, assumed)
            if repair is None:
                break
            repairs.append(repair)
        result = PlanResult(plan=plan.to_plain(), mended=repairs)
        if assumed:
            outcome, full, plan = await self._assuming(
                evaluation, arguments, assumed, (outcome, plan)
            )
            result.plan = plan.to_plain()
            result.left_out = left_out(full, plan)
        return Answer(outcome, result)

    async def _assuming(
        self,
        evaluation: _Evaluation,
        arguments: Mapping[str, str],
        assumed: Iterable[str],
        result: tuple[str, Plan],
    ) -> tuple[str, Plan, Plan]:
        """Return outcome and plan for arguments without a known value, and the plan without their parameters.

        If the file stops with an empty text, e.g. in a condition, another value is tried.

        Parameters
        ----------
        result
            Outcome and plan with empty texts as values.
        """
        for value, other in _ASSUMED:
            given = {**arguments, **dict.fromkeys(assumed, value)}
            outcome, plan = result
            if value:
                outcome, plan = await self._evaluate(evaluation, given)
            if plan.problem is None:
                given |= dict.fromkeys(assumed, other)
                _, twin = await self._evaluate(evaluation, given)
                return outcome, plan, without_assumed_parameters(plan, twin)
        return *result, result[1]

    def _repair(
        self,
        problem: Problem,
        known: Mapping[str, str],
        arguments: dict[str, str],
        assumed: set[str],
    ) -> Repair | None:
        """Repair a known mistake on a copy, or give a missing argument; None if that cannot be done."""
        # A running program of the student could change the workspace.
        if self._sandbox.students():
            return None
        # Reading a launch file runs it, and without namespaces the workspace was open to it.
        self._sandbox.end_orphans()
        if problem.kind in ("undefined_configuration", "required_argument"):
            done = _give(problem, known, arguments, assumed)
            return repair_of(problem, done) if done else None
        copy = self._own_copy()
        try:
            repair = self._repair_copy(problem)
            if repair is not None:
                self._sandbox.copy_workspace(copy, self._sandbox.workspace)
        except OSError:  # The file system may refuse the name or have no room.
            remove_tree(copy)
            self._sandbox.copy_workspace(self._sandbox.plan.staged, self._sandbox.workspace)
            return None
        return repair

    def _repair_copy(self, problem: Problem) -> Repair | None:
        wanted, package = _quoted(problem)
        by_kind = {
            "unknown_executable": lambda: (
                self._put_executable(wanted, package) if _LACKS in problem.message else ""
            ),
            "unknown_package": lambda: self._put_package(wanted),
            "unknown_keyword": lambda: self._rename_keyword(wanted, problem),
            "include_not_found": lambda: self._install_file(wanted, problem),
            "file_not_found": lambda: self._install_file(wanted, problem),
        }
        if problem.kind not in by_kind:
            return self._edit(problem)
        is_file = problem.kind.endswith("_not_found")
        if "/" in wanted and not is_file:
            return None
        if not _NAME.fullmatch(wanted):
            return None
        done = by_kind[problem.kind]()
        return repair_of(problem, done) if done else None

    def _put_executable(self, wanted: str, package: str) -> str:
        folder = (
            self._own_copy()
            / "install/lib"
            / (package if re.fullmatch(r"[A-Za-z]\w{0,200}", package) else "\n")
        )
        target = folder / wanted
        if not folder.is_dir() or target.exists():
            return ""
        meant = self._executable_meant(wanted, folder)
        if meant is not None:
            shutil.copy(meant, target)
            return f"'{wanted}' was taken for '{meant.name}'"
        target.symlink_to(LEFT_OUT)
        return f"'{wanted}' was left out"

    def _put_package(self, wanted: str) -> str:
        install = self._own_copy() / "install"
        there = [path.name for path in (install / _INDEX).iterdir()]
        if len(there) != 1 or (install / "share" / wanted).exists():
            return ""
        for part in (_INDEX, "lib", "share"):
            source = install / part / there[0]
            (shutil.copytree if source.is_dir() else shutil.copy)(source, install / part / wanted)
        return f"'{wanted}' was taken for '{there[0]}'"

    def _install_file(self, wanted: str, problem: Problem) -> str:
        """Put a file of the package into the share folder where the launch file looks for it."""
        folder = re.search(r"data_files: \('(share(?:/\w[\w.+-]*)+)', ", problem.remedy)
        source = self._own_copy() / "src" / wanted
        if folder is None or not is_regular_beneath(
            self._own_copy() / "src", PurePosixPath(wanted)
        ):
            return ""
        target = self._own_copy() / "install" / folder[1] / source.name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, target)
        return f"'{wanted}' was installed in {folder[1]}"

    def _rename_keyword(self, wanted: str, problem: Problem) -> str:
        """Replace the keyword by the one that the remedy names, in the launch files of that name."""
        meant = re.search(r"'(\w{1,100})=?'", problem.remedy)
        files = self._scripts(problem)
        if meant is None or not files:
            return ""
        for path in files:
            parts = re.split(r"(\W+)", path.read_text(encoding="utf-8", errors="surrogateescape"))
            for place, (word, behind) in enumerate(pairwise(parts)):
                if (
                    word == wanted
                    and behind.lstrip().startswith("=")
                    and not behind.lstrip().startswith("==")
                ):
                    parts[place] = meant[1]
            path.write_text("".join(parts), encoding="utf-8", errors="surrogateescape")
        return f"'{wanted}=' was read as '{meant[1]}='"

    def _scripts(self, problem: Problem) -> list[Path]:
        """Return the Python files with the name of a problem's file, among sources and installed files."""
        name = PurePosixPath(problem.file or "").name
        # The names in a plan are a student's: they are no patterns, and there may be many.
        scripts = (
            path for path in self._own_copy().rglob("*.py") if path.name == name and path.is_file()
        )
        return [path for path in scripts if path.stat().st_size <= MAX_TEXT_BYTES][:_MOST_RENAMED]

    def _edit(self, problem: Problem) -> Repair | None:
        """Mend a problem by one edit of its file, if one does."""
        done = None
        for path in self._scripts(problem):
            text = path.read_text(encoding="utf-8", errors="surrogateescape")
            done = edit(text, problem)
            if done is None:
                return None
            path.write_text(done.text, encoding="utf-8", errors="surrogateescape")
        if done is None:
            return None
        return repair_of(replace(problem, remedy=done.remedy), done.done)

    def _own_copy(self) -> Path:
        """Return a copy of the staged submission to which the student's processes have no access."""
        copy = self._sandbox.plan.scratch / "staged"
        if not copy.exists():
            shutil.copytree(self._sandbox.plan.staged, copy)
        return copy

    def _executable_meant(self, wanted: str, folder: Path) -> Path | None:
        """Find an artifact that no entry point runs by its module's name, else the executable of the likest name."""
        plan = self._sandbox.plan
        for artifact, source in plan.sources.items():
            if Path(source).stem == wanted.removesuffix(".py") and artifact in plan.programs:
                return plan.staged / plan.programs[artifact].path
        names = []
        for path in folder.iterdir():
            if is_left_out(path):
                continue
            if path.suffix != ".py":
                names.append(path.name)
        meant = _meant(wanted, names)
        return folder / meant if meant is not None else None

    async def _evaluate(
        self, evaluation: _Evaluation, arguments: Mapping[str, str]
    ) -> tuple[str, Plan]:
        """Execute the launch file in confinement, and read its plan from a pipe.

        All evaluations share the time of one: a file that sleeps before each mistake gains no time.
        """
        source = evaluation.source
        if source in self._given_up:
            return "failed", self._given_up[source]
        result_read, result_write = os.pipe()
        command = self._evaluation_command(result_write)
        run = ProcessRun(_title(arguments), "student", command)
        running = await self._start_evaluation(run, source, result_write)
        os.close(result_write)
        received: list[str] = []
        reader = PipeReader(result_read, MOST_ANSWER_BYTES, received.append)
        running.write(self._evaluation_request(source, arguments), last=True)
        outcome = await _run_until(running, evaluation.left_s())
        await running.kill()
        reader.close()
        text = received[0] if received else ""
        if not text:
            self._sandbox.note_unstarted(run, "the launch file could not be evaluated")
        plan = plan_of_answer(text, _ending(run, outcome == "done", evaluation.timeout_s), source)
        if plan.problem is not None and plan.problem.kind in ("too_slow", "no_plan"):
            self._given_up[source] = plan
        return outcome, plan

    def _evaluation_request(self, source: str, arguments: Mapping[str, str]) -> bytes:
        is_native = self._sandbox.plan.native is not None
        return Request(f"{self._root}/{source}", dict(arguments), self._root, is_native).to_json()

    def _evaluation_command(self, result_write: int) -> list[str]:
        """Return the command of an evaluation that writes its plan to a file descriptor."""
        sandbox = self._sandbox
        memory_bytes = attainable("as", _MAX_MEMORY_BYTES)
        interpreter = sandbox.plan.installation.interpreter
        program = command(interpreter, sandbox.seen[LAUNCHING], result_write)
        return ["prlimit", f"--as={memory_bytes}", *program]

    async def _start_evaluation(
        self, run: ProcessRun, source: str, result_write: int
    ) -> RunningProcess:
        sandbox = self._sandbox
        workspace = None
        if sandbox.isolation.namespaces:
            workspace = sandbox.launch_workspace
            sandbox.copy_workspace(sandbox.workspace, workspace)
        modules = ":".join(sandbox.plan.installation.modules)
        environment = sandbox.environment({"PYTHONPATH": modules})
        folders: Mapping[str, Path] = {}
        native = sandbox.plan.native
        if native is not None:
            environment |= native.environment(f"{sandbox.seen[WORKSPACE]}/install")
            folders = native.folders
        return await sandbox.start_confined(
            run,
            environment,
            f"{self._root}/{Path(source).parent}",
            workspace=workspace,
            folders=folders,
            pass_fds=(result_write,),
            with_input=True,
        )

    @property
    def _root(self) -> str:
        """Folder of the sources, as the student's processes see it."""
        return f"{self._sandbox.seen[WORKSPACE]}/src"

    # -- running ------------------------------------------------------------------------------

    async def start(self, plain: Mapping[str, Any] | None) -> Answer:
        """Start the processes of a plan, now or when it says."""
        if plain is None or plain.get("outcome") != "ok":
            return Answer("failed", StartResult("the launch file could not be evaluated"))
        plan = Plan.from_plain(plain)
        self._write_files(plan)
        self._absent = {process.id for process in plan.processes if process.absent}
        left_out = self._prefixes_left_out(plan)
        present = []
        for process in plan.processes:
            if process.absent:
                continue
            if process.id in left_out:
                process = replace(process, prefix=())
            present.append(process)
        for process in present:
            if process.when is None:
                await self._start(process)
            else:
                self._later(self._start_when(process, process.when))
        started = [process.id for process in present]
        result = StartResult(processes=started)
        if left_out:
            result.without_prefix = left_out
        return Answer("done", result)

    def _prefixes_left_out(self, plan: Plan) -> dict[str, str]:
        """Return the prefixes with programs that are missing here or need a screen, by process."""
        found = {}
        for process in plan.processes:
            if not process.prefix:
                continue
            if not _runs_here(process.prefix):
                found[process.id] = " ".join(process.prefix)
        return found

    def _write_files(self, plan: Plan) -> None:
        """Write the files that the launch file made, or had made, for its nodes."""
        self._files = dict(plan.parameter_files)
        for process in plan.processes:
            self._files |= process.parameter_files
        for name, text in self._files.items():
            path = self._sandbox.parameters / name
            with suppress(OSError, ValueError):  # a name that no file can have
                path.write_text(self._placed(text), encoding="utf-8")
                path.chmod(
                    0o755 if text.startswith("#!") else 0o644
                )  # for the student's user, whatever the umask is

    def _placed(self, text: str) -> str:
        return with_places(text, self._files, self._sandbox.seen[PARAMETERS])

    def _later(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self.waiting.add(task)
        task.add_done_callback(self.waiting.discard)

    async def _start(self, process: Process, respawns: int = 0) -> None:
        name = self._free_name(process.id + (f" (start {respawns + 1})" if respawns else ""))
        run = ProcessRun(name, "student", self._command(process))
        environment = self._environment(process)
        try:
            running = await self._sandbox.start(run, environment=environment, cwd=process.cwd)
        except (OSError, ValueError) as error:  # a command line that no system takes
            run.exited_ns, run.exit_status = run.started_ns, 127
            run.output.append(
                OutputLine(run.started_ns, "stderr", f"this cannot be started: {error}")
            )
            return
        if process.respawn and respawns < _MAX_RESPAWNS:
            self._later(self._restart(process, running, respawns + 1))

    def _environment(self, process: Process) -> dict[str, str]:
        """Return the variables of a process, without the session's own."""
        environment = {}
        for variable, value in process.env.items():
            if not is_sessions(variable):
                environment[variable] = self._placed(value)
        return environment

    def _free_name(self, wanted: str) -> str:
        """Return a name that no process of the session has, so that no process replaces another one in the list."""
        taken = {"", *self._sandbox.processes, *self._sandbox.plan.reference}
        return next(
            name
            for n in itertools.count()
            if (name := f"{wanted} ({n})" if n else wanted) not in taken
        )

    def _command(self, process: Process) -> list[str]:
        """Return the command line, with `ros2 run` and Python as they are found here."""
        sandbox = self._sandbox
        command = process.command(sandbox.seen[PARAMETERS])
        if process.shell and re.search(r"[^\w\s./:=+,@%-]", " ".join(command)):
            return ["sh", "-c", " ".join(command)]
        if process.shell:
            command = " ".join(command).split() or ["true"]
        program = 0
        if not process.shell:
            program = len(process.prefix)
        named, rest = Path(command[program]).name, command[program + 1 :]
        if re.fullmatch(r"python3?(\.\d+)?", named):
            return [*command[:program], str(sandbox.plan.installation.interpreter), *rest]
        if named == "ros2" and (run := ros2_run(rest)) is not None:
            package, executable, arguments = run
            installed = PurePosixPath("install/lib", package, executable)
            if not is_regular_beneath(sandbox.workspace, installed):
                return ["sh", "-c", "echo No executable found >&2; exit 1"]
            return [*command[:program], f"{sandbox.seen[WORKSPACE]}/{installed}", *arguments]
        return command

    async def _restart(self, process: Process, running: RunningProcess, respawns: int) -> None:
        await running.wait_exit(self._sandbox.plan.timeout_s)
        await asyncio.sleep(process.respawn_delay_s)
        if not self._ending:
            await self._start(process, respawns)

    async def _start_when(self, process: Process, when: Mapping[str, Any]) -> None:
        # Lifecycle nodes change no states here: an action that waits for one starts with the node.
        awaited = when.get("on_exit_of") or when.get("on_start_of") or when.get("on_transition_of")
        if awaited is None and "after_s" not in when:
            return  # This process waits for the shutdown, which ends the session.
        if awaited is not None and awaited not in self._absent:
            while awaited not in self._sandbox.processes:
                await asyncio.sleep(0.05)
            if "on_exit_of" in when:
                await self._sandbox.processes[awaited].wait_exit(self._sandbox.plan.timeout_s)
        await asyncio.sleep(float(when.get("after_s", 0.0)))
        if not self._ending:
            await self._start(process)


#: Terminals, debuggers and other programs with a need for a screen, a person or another account.
_ATTENDED = frozenset([
    "alacritty", "ddd", "gdb", "gdbserver", "gnome-terminal", "kitty", "konsole", "lldb", "lxterminal",
    "mate-terminal", "ptyxis", "qterminal", "rxvt", "screen", "st", "sudo", "terminator", "tilix", "tmux",
    "urxvt", "wezterm", "x-terminal-emulator", "xfce4-terminal", "xterm",
])  # fmt: skip


def _runs_here(prefix: Sequence[str]) -> bool:
    """Tell whether the words before a program's command line can be run in a session."""
    if find_tool(prefix[0]) is None:
        return False
    return all(PurePosixPath(word).name not in _ATTENDED for word in prefix)


#: A name of something that is missing, or a path below the submission.
_NAME = re.compile(r"(?:\w[\w.+-]{0,99}/){0,9}[\w.+-]{0,199}\w")
#: Words about an executable that is missing in its package.
_LACKS = "found in package"


class _Evaluation(NamedTuple):
    """A launch file to be evaluated, with the time for all its evaluations and the end of that time."""

    source: str
    timeout_s: float
    end_s: float

    def left_s(self) -> float:
        """Return the time for the next evaluation in s."""
        return max(_LEAST_EVALUATION_S, round(self.end_s - time.monotonic(), 1))


def _title(arguments: Mapping[str, str]) -> str:
    """Return the name of an evaluation in the record."""
    shown = [f" {name}:={value}" for name, value in arguments.items()]
    return "launch file" + "".join(shown)


def _quoted(problem: Problem) -> tuple[str, str]:
    """Return the first two names in quotes of a message, empty texts if there are fewer."""
    found: list[str] = [*re.findall(r"'([^']+)'", problem.message), "", ""]
    return found[0], found[1]


def _give(
    problem: Problem, known: Mapping[str, str], arguments: dict[str, str], assumed: set[str]
) -> str:
    """Give a missing argument the value of the likest known one, or an assumed one; return the repair in words."""
    wanted, _ = _quoted(problem)
    if wanted in arguments:
        return ""
    if not _NAME.fullmatch(wanted):
        return ""
    meant = _meant(wanted, known)
    if meant is not None:
        arguments[wanted] = arguments.get(meant, known[meant])
        return f"'{wanted}' was given as '{arguments[wanted]}'"
    arguments[wanted] = ""
    assumed.add(wanted)
    return f"'{wanted}' was left out, so that parameters set by it keep the node's own defaults"


def _ending(run: ProcessRun, in_time: bool, timeout_s: float) -> Ending:
    """Return the end of the process of an evaluation."""
    output = run.output[-1].text if run.output else ""
    return Ending(in_time, timeout_s, run.exit_status, run.limit, output)


def _meant(wanted: str, names: Iterable[str]) -> str | None:
    """Return the likest of some names, the first in the alphabet of several, if one is like enough."""
    likest = min(
        sorted(names)[:_MOST_LIKENED], key=lambda name: -likeness(wanted, name), default=""
    )
    return likest if likest and likeness(wanted, likest) >= LEAST_RATIO else None


def with_places(text: str, names: Container[str], folder: str) -> str:
    """Replace the placeholders of the plan's own files in a text by their paths in a folder."""
    return _OWN_FILE.sub(
        lambda match: f"{folder}/{match[1]}" if match[1] in names else match[0], text
    )


async def _run_until(running: RunningProcess, time_s: float, most: float = _MOST_EXTENDED) -> str:
    """Wait until a program has ended: as long as it may take, and as long as other programs keep it from a core besides.

    Return "failed" if it had that time, and "timeout" if they kept it from a core for too long to tell.
    """
    began_s = time.monotonic()
    while not await running.wait_exit(max(_LOOK_S, began_s + time_s - time.monotonic())):
        running.sample_usage()
        delay_s = running.delay_by_others_s()
        if (took_s := time.monotonic() - began_s) > min(time_s + delay_s + _WAIT_S, most * time_s):
            return "timeout" if took_s < time_s + delay_s else "failed"
    return "done"
