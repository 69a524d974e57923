"""Evaluates one launch file, as a script in a process that somebody else confines.

Reads a request as JSON from standard input: `{"file": ..., "arguments": {...}, "root": ..., "native": false}`;
`native` asks for the real `launch`. Writes the plan as JSON to the descriptor that follows --result-fd. Nothing of the
rest of the grader is imported: this script and the stand-in beside it can be all that the process sees.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

HERE = Path(__file__).resolve().parent
STANDIN = HERE / "standin"


def main() -> int:
    """Evaluate the launch file of the request on standard input; returns 0 once a plan is written."""
    result_fd = int(sys.argv[-1])
    os.set_inheritable(result_fd, False)
    request = json.load(sys.stdin)
    os.write(result_fd, b"\n")  # whatever happens now, the evaluation itself has started
    process = os.getpid()
    evaluate = evaluation(native=bool(request.get("native")))
    plan = evaluate(request["file"], request.get("arguments") or {}, request["root"])
    if os.getpid() != process:
        os._exit(0)  # the launch file forked, and this is its child
    with suppress(Exception):
        sys.stdout.flush()  # it may be closed, or no file at all
    with os.fdopen(result_fd, "wb") as result:
        result.write(json.dumps(plan).encode())
    return 0


def evaluation(*, native: bool) -> Any:
    """The function that evaluates, with the stand-in or else with the `launch` that Python finds.

    Its neighbours are in a package of their own, so that no launch file imports them by their bare names.
    """
    package = ModuleType("grader_launching")
    package.__path__ = [str(HERE)]
    sys.modules["grader_launching"] = package
    sys.path[:] = [p for p in sys.path if p and Path(p).resolve() != HERE]
    if not native:
        sys.path.insert(0, str(STANDIN))
    sys.dont_write_bytecode = True
    return importlib.import_module(
        "grader_launching.native" if native else "launch._context"
    ).evaluate


if __name__ == "__main__":
    status = main()
    with suppress(Exception):
        sys.stdout.flush()
    os._exit(status)  # threads that the launch file has started keep no launch from going on
