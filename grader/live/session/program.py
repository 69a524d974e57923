"""A student's program: the installed file that runs for an artifact, and the command that starts it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

#: Starts a compiled program, after a line to the tap that it has begun; Python's tap writes the same line.
_BEGIN = 'echo \'{"kind": "started"}\' >"/proc/self/fd/$GRADER_TAP_FD"; exec "$@"'


@dataclass(frozen=True)
class StudentProgram:
    """A program that runs for an artifact.

    Attributes
    ----------
    path
        Installed file below the workspace, e.g. "install/lib/arm/talker".
    is_compiled
        True if the file holds machine code; otherwise Python runs it.
    """

    path: str
    is_compiled: bool = False

    def command(self, workspace: str, interpreter: Path) -> list[str]:
        """Return the command line, for a workspace where the sandbox has it."""
        file = f"{workspace}/{self.path}"
        if self.is_compiled:
            return ["sh", "-c", _BEGIN, "sh", file]
        return [str(interpreter), file]
