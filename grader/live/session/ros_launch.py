"""Where the real `launch` and `launch_ros` are, on a machine that has them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from grader.errors import PlatformError
from grader.live.sandbox.environment import ask_interpreter

_PROBE = """
import json, os, sys
import launch, launch_ros, launch.actions, launch_ros.actions, launch.launch_description_sources
print(json.dumps({
    "python_path": [p for p in sys.path if p and os.path.isdir(p)],
    "prefixes": [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if os.path.isdir(p)],
    "library_path": os.environ.get("LD_LIBRARY_PATH", ""),
}))
"""


class LaunchChoice(str, Enum):
    """Which implementation of `launch` evaluates launch files."""

    STANDIN = "standin"
    NATIVE = "native"
    AUTO = "auto"


@dataclass(frozen=True)
class NativeLaunch:
    """What an interpreter needs in order to import the real `launch`."""

    python_path: list[str]
    prefixes: list[str]
    library_path: str

    def environment(self, prefix: str) -> dict[str, str]:
        """Variables for an evaluation; `prefix` is where the submission is installed."""
        return {
            "PYTHONPATH": ":".join(self.python_path),
            "AMENT_PREFIX_PATH": ":".join([prefix, *self.prefixes]),
            "LD_LIBRARY_PATH": self.library_path,
        }

    @property
    def folders(self) -> dict[str, Path]:
        """Folders that must be seen, where they are, besides those that always are."""
        return {p: Path(p) for p in [*self.prefixes, *self.python_path] if not p.startswith("/usr")}


def find_native_launch(interpreter: Path, choice: LaunchChoice) -> NativeLaunch | None:
    """Find the real `launch` in the environment from which the grader was started; None for the stand-in.

    It raises `PlatformError` if it was asked for and cannot be imported.
    """
    if choice is LaunchChoice.STANDIN:
        return None
    try:
        return NativeLaunch(**json.loads(ask_interpreter(interpreter, _PROBE, isolated=False)))
    except (ValueError, TypeError) as error:
        problem = error
    if choice is LaunchChoice.AUTO:
        return None
    raise PlatformError(
        f"the real launch and launch_ros cannot be imported ({problem})",
        location=str(interpreter),
        remedy="Source a ROS 2 installation in this terminal first. The interpreter (that of grade, or --python) "
        "must be of the Python version that the installation was built for, as 3.12 for Jazzy on Ubuntu 24.04, "
        "with the pip packages of grade's constraints.txt in it. Or leave --launch out: the stand-in needs no "
        "ROS installation.",
    )
