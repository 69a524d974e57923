"""Evaluates one launch file, as a script in a process that somebody else confines.

Reads a request as JSON from standard input: `{"file": ..., "arguments": {...}, "root": ...}`. Writes the plan
as JSON to the file descriptor that `--result-fd` names. The launch file's own output goes where it would.
Nothing of the rest of the grader is imported, so that the script and the stand-in beside it can be all that
the process sees.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
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
    process = os.getpid()
    _see_only_the_standin()
    plan = _evaluate(request)
    if os.getpid() != process:
        os._exit(0)  # the launch file forked, and this is its child
    sys.stdout.flush()
    with os.fdopen(options.result_fd, "wb") as result:
        result.write(json.dumps(plan).encode())
    return 0


def _see_only_the_standin() -> None:
    # A launch file must not be able to import this script's neighbours.
    kept = [p for p in sys.path if p and Path(p).resolve() != HERE]
    sys.path[:] = [str(STANDIN), *kept]
    sys.dont_write_bytecode = True


def _evaluate(request: dict[str, Any]) -> dict[str, Any]:
    from launch._evaluation import evaluate

    return evaluate(request["file"], request.get("arguments") or {}, request["root"])


if __name__ == "__main__":
    sys.exit(main())
