"""Events of processes."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

from ..._base import Event, Field


class RunningProcessEvent(Event):
    """Something happened to one process."""

    action = Field()
    name = Field()
    cmd = Field()
    cwd = Field()
    env = Field()
    pid = Field(0)

    def made(self) -> None:
        self.process_name, self.execute_process_action = self.given["name"], self.action


class ProcessStarted(RunningProcessEvent):
    """A process started."""


class ProcessExited(RunningProcessEvent):
    """A process ended."""

    returncode = Field()


class ProcessIO(RunningProcessEvent):
    """A process wrote or was written to."""

    text = Field()
    fd = Field()

    from_stdin = property(lambda self: self.fd == 0)
    from_stdout = property(lambda self: self.fd == 1)
    from_stderr = property(lambda self: self.fd == 2)


class ProcessStdin(ProcessIO):
    """Text for a process."""

    fd = Field(0)


class ProcessStdout(ProcessIO):
    """A process wrote to standard output."""

    fd = Field(1)


class ProcessStderr(ProcessIO):
    """A process wrote to standard error."""

    fd = Field(2)


class ProcessTargetedEvent(Event):
    """Something is wanted of the processes that match."""

    process_matcher = Field()


class ShutdownProcess(ProcessTargetedEvent):
    """The processes that match are to end."""


class SignalProcess(ProcessTargetedEvent):
    """The processes that match get a signal."""

    signal_number = Field()

    def made(self) -> None:
        wanted = self.signal_number
        self.signal = signal.Signals[wanted] if isinstance(wanted, str) else signal.Signals(wanted)
        self.signal_name = self.signal.name


def matches_pid(pid: int) -> Callable[[Any], bool]:
    """A matcher of one process id."""
    return lambda action: bool((action.process_details or {}).get("pid") == pid)


def matches_name(name: str) -> Callable[[Any], bool]:
    """A matcher of one process name."""
    return lambda action: bool((action.process_details or {}).get("name") == name)


def matches_executable(name: str) -> Callable[[Any], bool]:
    """A matcher of one program."""
    return lambda action: bool(action.process_details and action.process_details["cmd"][0].split("/")[-1] == name)
