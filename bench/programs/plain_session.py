"""Runs a session of the rubric with plain programs: no sandbox, no tap, no priorities, no limits.

It takes the director's actions and the reference nodes of a session. Prints the CPU time of each of the student's
programs in s, e.g. `{"publisher": 1.1}`. Arguments: the session's name, and the folder of its recording for the
commands of a launch file.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from bench.submissions import SOLUTION
from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric
from grader.lab.steps.base import Step
from grader.lab.steps.interrupt import InterruptStep
from grader.lab.steps.start import StartStep
from grader.lab.steps.wait_exit import WaitExitStep
from grader.lab.steps.wait_for import WaitForStep
from grader.live.ros_node.probe import Probe
from grader.live.ros_node.steps import ACTIONS
from grader.live.ros_node.steps.wait_for import wait_for
from grader.recording.session import read_session

#: Variables that no program of a student has in its own terminal.
_OF_THE_GRADER = ("FASTRTPS_DEFAULT_PROFILES_FILE", "PYTHONPATH")
_START_S, _END_S = 10.0, 15.0


class _PlainSession:
    """The programs of a session, and the CPU time of those that have ended."""

    def __init__(self, rubric: Rubric, scratch: Path, recording: Path) -> None:
        self._rubric = rubric
        self._scratch = scratch
        self._recording = recording
        self._probe = Probe(
            scratch / "bag", "plain", int(os.environ["ROS_DOMAIN_ID"]), set(), set()
        )
        self._running: dict[str, subprocess.Popen[str]] = {}
        self._references: dict[str, subprocess.Popen[str]] = {}
        self._said: dict[str, list[str]] = {}
        self.cpu_s: dict[str, float] = {}

    def do(self, step: Step) -> None:
        """Do a step; steps that only a sandbox can do are passed over."""
        if isinstance(step, StartStep):
            self._start(step)
        elif isinstance(step, WaitForStep):
            self._wait_for(step)
        elif isinstance(step, WaitExitStep):
            ended = self._running[step.process]
            self._probe.until(lambda: _has_ended(ended), step.timeout_s)
            self._end(step.process)
        elif isinstance(step, InterruptStep):
            for name in list(self._running):
                if step.process in ("*", name):
                    self._end(name)
        elif type(step) in ACTIONS:
            self._probe.processes += 1
            ACTIONS[type(step)](self._probe, step)

    def _wait_for(self, step: WaitForStep) -> None:
        if step.output_of is None:
            self._probe.processes += 1
            wait_for(self._probe, step)
            return
        assert step.text is not None
        self._wait_for_text(step.output_of, step.text, step.timeout_s)

    def _start(self, step: StartStep) -> None:
        if step.reference:
            self._start_reference(step.reference, step.with_)
        elif step.launch:
            for name, command in self._launched():
                self._run(name, command)
        elif not step.if_ended:
            assert step.student is not None
            file = self._rubric.artifacts[step.student].file
            command = [str(SOLUTION / file), *_ros_arguments(step)]
            name = step.student if step.name is None else step.name
            self._run(name, command)

    def _run(self, name: str, command: Sequence[str]) -> None:
        environment = {key: os.environ[key] for key in os.environ if key not in _OF_THE_GRADER}
        self._running[name] = subprocess.Popen(
            [sys.executable, *command], env=environment, stdout=subprocess.DEVNULL, text=True
        )

    def _launched(self) -> Iterator[tuple[str, list[str]]]:
        """Yield names and commands of the processes that a launch file started in a recording."""
        plan = read_session(self._recording).plan
        assert plan is not None
        for name, text in plan["parameter_files"].items():
            (self._scratch / name).write_text(text, encoding="utf-8")
        for process in plan["processes"]:
            file = SOLUTION / f"{process['executable']}.py"
            arguments = [each.format(parameters=self._scratch) for each in process["argv"]]
            yield process["executable"], [str(file), *arguments]

    def _start_reference(self, name: str, settings: dict[str, Any]) -> None:
        file = self._rubric.folder / self._rubric.reference[name].file
        configuration = json.dumps({"seed": 1, "with": settings})
        node = subprocess.Popen(
            [sys.executable, str(file), configuration], stdout=subprocess.PIPE, text=True
        )
        self._references[name] = node
        self._said[name] = []
        threading.Thread(target=self._hear, args=(name,), daemon=True).start()
        self._wait_for_text(name, "ready", _START_S)

    def _hear(self, name: str) -> None:
        stdout = self._references[name].stdout
        assert stdout is not None
        for line in stdout:
            self._said[name].append(line)

    def _wait_for_text(self, name: str, text: str, timeout_s: float) -> None:
        """Wait for an output of a reference node, while the recorder follows the graph."""
        self._probe.until(lambda: any(text in line for line in self._said[name]), timeout_s)

    def _end(self, name: str) -> None:
        """End a program as Ctrl-C does, and note its CPU time."""
        process = self._running.pop(name)
        if not _has_ended(process):
            os.kill(process.pid, signal.SIGINT)
        if not self._probe.until(lambda: _has_ended(process), _END_S):
            os.kill(process.pid, signal.SIGKILL)
        _, _, used = os.wait4(process.pid, 0)
        process.returncode = 0
        self.cpu_s[name] = used.ru_utime + used.ru_stime

    def end(self) -> None:
        """End all programs and the recorder."""
        for name in list(self._running):
            self._end(name)
        for node in self._references.values():
            node.terminate()
            node.wait(_END_S)
        self._probe.recorder.stop()


def _has_ended(process: subprocess.Popen[str]) -> bool:
    """Tell whether a process has ended, and leave its CPU time to be read."""
    return os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def _ros_arguments(step: StartStep) -> list[str]:
    """Return the ROS arguments of a started program."""
    arguments = []
    for name, value in step.parameters.items():
        arguments += ["-p", f"{name}:={json.dumps(value)}"]
    for wanted, new in step.remappings.items():
        arguments += ["-r", f"{wanted}:={new}"]
    if not arguments:
        return []
    return ["--ros-args", *arguments]


def main() -> None:
    """Run the session, and print the CPU times of its programs."""
    name, recording = sys.argv[1:]
    rubric = read_rubric(None)
    with tempfile.TemporaryDirectory(prefix="bench-plain-") as scratch:
        (Path(scratch) / "bag").mkdir()
        session = _PlainSession(rubric, Path(scratch), Path(recording))
        try:
            for spec in rubric.sessions[name].steps:
                session.do(spec.step)
        finally:
            session.end()
    print(json.dumps(session.cpu_s), flush=True)
    os._exit(0)  # Threads of ROS may still run.


if __name__ == "__main__":
    main()
