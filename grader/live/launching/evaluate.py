"""Evaluates one launch file, as a script in a process that somebody else confines.

Reads a request as JSON from standard input: `{"file": ..., "arguments": {...}, "root": ...,
"native": false}`; `native` asks for the real `launch` instead of the stand-in beside this script. Writes the plan
as JSON to the file descriptor that `--result-fd` names. The launch file's own output goes where it would.
Nothing of the rest of the grader is imported, so that the script and the stand-in beside it can be all that
the process sees.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
STANDIN = HERE / "standin"


def main(argv: list[str] | None = None) -> int:
    """Evaluate the launch file of the request on standard input.

    Returns
    -------
    int
        The exit status: always 0 once a plan is written.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--result-fd", type=int, required=True, help="where the plan is written")
    options = parser.parse_args(argv)
    os.set_inheritable(options.result_fd, False)
    request = json.load(sys.stdin)
    os.write(options.result_fd, b"\n")  # whatever happens now, the evaluation itself has started
    process = os.getpid()
    _see_only(*([] if request.get("native") else [str(STANDIN)]))
    plan = _evaluate(request)
    if os.getpid() != process:
        os._exit(0)  # the launch file forked, and this is its child
    with suppress(Exception):
        sys.stdout.flush()  # it may be closed, or no file at all
    with os.fdopen(options.result_fd, "wb") as result:
        result.write(json.dumps(plan).encode())
    return 0


def _see_only(*folders: str) -> None:
    # A launch file must not be able to import this script's neighbours.
    kept = [p for p in sys.path if p and Path(p).resolve() != HERE]
    sys.path[:] = [*folders, *kept]
    sys.dont_write_bytecode = True


def _evaluate(request: dict[str, Any]) -> dict[str, Any]:
    if request.get("native"):
        spec = importlib.util.spec_from_file_location("native_evaluation", HERE / "native.py")
        assert spec is not None
        assert spec.loader is not None
        native = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(native)
        evaluate = native.evaluate
    else:
        from launch._evaluation import evaluate

    plan: dict[str, Any] = evaluate(request["file"], request.get("arguments") or {}, request["root"])
    return plan


if __name__ == "__main__":
    status = main()
    with suppress(Exception):
        sys.stdout.flush()
    os._exit(status)  # threads that the launch file has started keep no launch from going on
