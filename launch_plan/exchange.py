"""The exchange with an evaluating process: its command line, the request to it, and its answer.

A caller that confines the process starts it by itself, and uses these functions instead of `evaluation.evaluate`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path, PurePath

from launch_plan.plan import MalformedPlanError, Plan, Problem

#: The folder that the evaluating process must be able to read.
PACKAGE = Path(__file__).resolve().parent
#: Path of the program in that folder.
PROGRAM = "inside/evaluate.py"
#: Longest answer that a caller should read, in bytes.
MOST_ANSWER_BYTES = 4 * 1024 * 1024
_LONGEST_QUOTE = 300


@dataclass(frozen=True)
class Request:
    """One launch file with its arguments, as the evaluating process sees them."""

    #: Absolute path.
    file: str
    #: Value by name, as in `ros2 launch FILE name:=value`.
    arguments: Mapping[str, str]
    #: Folder of the submission; a plan names its files relative to this folder.
    root: str
    #: True for the real `launch` on the path of modules, false for the stand-in.
    native: bool = False

    def to_json(self) -> bytes:
        """Return the text for the standard input of the process."""
        return json.dumps(asdict(self)).encode()


@dataclass(frozen=True)
class Ending:
    """End of an evaluating process."""

    #: False if the process was killed after its time.
    in_time: bool
    #: Time that the process had, in seconds.
    timeout_s: float
    #: Status as of a shell or of `subprocess`: 128 plus a signal, or minus a signal.
    exit_status: int | None = None
    #: Name of the limit at which the process was killed, e.g. `output`; None if there was none.
    limit: str | None = None
    #: Last text that the process printed.
    output: str = ""


def command(interpreter: PurePath | str, package: PurePath | str, result_fd: int) -> list[str]:
    """Return the command line of an evaluating process that sees `launch_plan` in the folder `package`."""
    return [str(interpreter), f"{package}/{PROGRAM}", "--result-fd", str(result_fd)]


def plan_of_answer(answer: str, ending: Ending, file: str) -> Plan:
    """Return the plan in an answer, or else a plan with the problem `too_slow` or `no_plan` in `file`."""
    reason = ""
    try:
        return _valid_plan(answer)
    except MalformedPlanError as malformed:
        reason = f": {malformed}"
    except (ValueError, RecursionError):
        pass
    return Plan("error", _problem(answer, reason, ending, file))


def _valid_plan(answer: str) -> Plan:
    """Return the plan in an answer; its own plain form is a plan too."""
    # Lone surrogates cannot be written to a file.
    text = json.dumps(json.loads(answer), ensure_ascii=False).encode("utf-8", "replace")
    plan = Plan.from_plain(json.loads(text))
    return Plan.from_plain(plan.to_plain())


def _problem(answer: str, reason: str, ending: Ending, file: str) -> Problem:
    kind = "no_plan"
    if not ending.in_time:
        kind = "too_slow"
        message = f"was still busy after {ending.timeout_s:g} s; it should describe processes and return at once"
        remedy = "Take out what waits or loops: `ros2 launch` reads the whole file before it starts anything."
    elif answer.strip():
        message = f"gave no description that can be read{reason}"
        remedy = "Return a LaunchDescription of a few entities, and write to no file descriptor but your own."
    elif ending.limit is not None:
        message = f"was stopped at the limit of {ending.limit}, before it gave a description"
        remedy = "Take out what prints, writes or starts programs without end: `ros2 launch` reads the whole file first."
    else:
        message = f"cannot be read: the reading program was ended by it ({_end(ending)}), before it gave a description"
        if ending.output:
            message += f"; it said: {ending.output[:_LONGEST_QUOTE]}"
        remedy = "Take out what ends or replaces the program (os._exit, exec, signals), and return a LaunchDescription."
    return Problem(kind, f"the launch file {message}", file, None, remedy)


def _end(ending: Ending) -> str:
    """Return how a process ended, e.g. "by signal 9" or "with status 1"."""
    status = ending.exit_status or 0
    signal = status - 128 if status > 128 else -status
    return f"by signal {signal}" if signal > 0 else f"with status {status}"
