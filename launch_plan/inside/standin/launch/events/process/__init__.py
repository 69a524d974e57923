"""Events of processes."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

from ..._base import Event, Field


class RunningProcessEvent(Event):
    action = Field()
    name = Field()
    cmd = Field()
    cwd = Field()
    env = Field()
    pid = Field(0)

    def made(self) -> None:
        self.process_name = self.given["name"]
        self.execute_process_action = self.action


class ProcessStarted(RunningProcessEvent):
    """The start of a process."""


class ProcessExited(RunningProcessEvent):
    returncode = Field()


class ProcessIO(RunningProcessEvent):
    text = Field()
    fd = Field()

    from_stdin = property(lambda self: self.fd == 0)
    from_stdout = property(lambda self: self.fd == 1)
    from_stderr = property(lambda self: self.fd == 2)


class ProcessStdin(ProcessIO):
    fd = Field(0)


class ProcessStdout(ProcessIO):
    fd = Field(1)


class ProcessStderr(ProcessIO):
    fd = Field(2)


class ProcessTargetedEvent(Event):
    process_matcher = Field()


class ShutdownProcess(ProcessTargetedEvent):
    """A request to end the matching processes."""


class SignalProcess(ProcessTargetedEvent):
    signal_number = Field()

    def made(self) -> None:
        wanted = self.signal_number
        self.signal = signal.Signals[wanted] if isinstance(wanted, str) else signal.Signals(wanted)
        self.signal_name = self.signal.name


def _details(action: Any) -> dict[str, Any]:
    return action.process_details or {}


def matches_pid(pid: int) -> Callable[[Any], bool]:
    return lambda action: bool(_details(action).get("pid") == pid)


def matches_name(name: str) -> Callable[[Any], bool]:
    return lambda action: bool(_details(action).get("name") == name)


def matches_executable(name: str) -> Callable[[Any], bool]:
    def matches(action: Any) -> bool:
        details = _details(action)
        return bool(details and details["cmd"][0].split("/")[-1] == name)

    return matches
