"""Evaluate one launch file and write its plan; the program of the evaluating process.

A request is read from standard input as JSON, e.g.
`{"file": "/ws/src/robot.launch.py", "arguments": {"rate": "50"}, "root": "/ws/src", "native": false}`.
The plan is written as JSON to the descriptor behind `--result-fd`. The caller confines this process. The folder
`launch_plan` may be the only part of the installation that this process sees.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parent
STANDIN = HERE / "standin"


def main() -> int:
    """Evaluate the launch file of the request on standard input; return 0 once a plan is written."""
    result_fd = int(sys.argv[-1])
    os.set_inheritable(result_fd, False)
    request = json.load(sys.stdin)
    # A line feed tells the caller that the evaluation has started.
    os.write(result_fd, b"\n")
    process = os.getpid()
    evaluate = evaluation(native=bool(request.get("native")))
    plan = evaluate(request["file"], request.get("arguments") or {}, request["root"])
    if os.getpid() != process:
        # The launch file forked, and this is the child.
        os._exit(0)
    # Standard output may be closed, or may no longer be a file.
    with suppress(Exception):
        sys.stdout.flush()
    with os.fdopen(result_fd, "wb") as result:
        result.write(json.dumps(plan).encode())
    return 0


def evaluation(*, native: bool) -> Any:
    """Return the function that evaluates, with the stand-in or with the `launch` on the path of modules.

    The folder of this program is taken off that path, because a launch file could import its modules by bare names.
    """
    sys.dont_write_bytecode = True
    sys.path[:] = [entry for entry in sys.path if entry and Path(entry).resolve() != HERE]
    _import_package()
    if native:
        return importlib.import_module("launch_plan.inside.native").evaluate
    sys.path.insert(0, str(STANDIN))
    return importlib.import_module("launch._context").evaluate


def _import_package() -> None:
    """Import `launch_plan` from the folder around this program, whichever other one is installed."""
    spec = importlib.util.spec_from_file_location("launch_plan", PACKAGE / "__init__.py")
    if spec is None or spec.loader is None:
        raise ImportError(f"no package at {PACKAGE}")
    package = importlib.util.module_from_spec(spec)
    sys.modules["launch_plan"] = package
    spec.loader.exec_module(package)


if __name__ == "__main__":
    status = main()
    with suppress(Exception):
        sys.stdout.flush()
    # Threads of the launch file do not keep this process alive.
    os._exit(status)
