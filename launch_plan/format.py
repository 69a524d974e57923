"""Constants of a plan's JSON form, shared by the evaluator and the readers of its answer."""

from __future__ import annotations

from pathlib import Path

#: Value of the key `schema`.
SCHEMA = "ros-lab-grader/launch-plan/v1"
#: Placeholder for the folder with the files of a plan, e.g. in `--params-file {parameters}/arm_1.yaml`.
PARAMETERS_PLACEHOLDER = "{parameters}"
#: Key of an infinite or undefined number, e.g. `{"!!float": "inf"}`, because JSON has no such numbers.
NO_JSON = "!!float"
#: Most processes of a plan; a session starts them one after another, and each again up to three times.
PROCESS_LIMIT = 100
#: Target of links to executables that are left out, because their programs are missing.
LEFT_OUT = "/bin/false"


def is_left_out(path: Path) -> bool:
    """Tell whether a file stands for an executable that is left out."""
    if not path.is_symlink():
        return False
    return str(path.readlink()) == LEFT_OUT
