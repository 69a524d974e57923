"""Evaluates many launch files in one interpreter: with the stand-in, or natively with whichever `launch` it finds."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
INSIDE = ROOT / "launch_plan/inside"
STANDIN = INSIDE / "standin"
#: The real `launch` and `launch_ros` of Jazzy, which are no part of the project.
ORIGINAL = Path(os.environ.get("REAL_LAUNCH", ROOT.parent / "shared" / "real-launch"))
needs_the_original = pytest.mark.skipif(
    not (ORIGINAL / "launch").is_dir(),
    reason=f"the real launch is not at {ORIGINAL} (REAL_LAUNCH names another place)",
)

# Each request is evaluated in a child of its own, so that they share nothing but the imports; the original reads its
# grammar and its extensions once for all of them. Nobody waits for a file that sleeps: its plan is the same.
_BATCH = """
import importlib.util, json, os, signal, sys, time, warnings
warnings.simplefilter("ignore")
spec = importlib.util.spec_from_file_location("evaluate", sys.argv[1])
script = importlib.util.module_from_spec(spec)
spec.loader.exec_module(script)
sys.path.insert(0, sys.argv[2])
evaluate = script.evaluation(native=sys.argv[3] == "native")
import yaml, launch, launch_ros.actions
if hasattr(launch.frontend.Parser, "load_launch_extensions"):
    launch.frontend.Parser.load_launch_extensions()
    launch.frontend.Parser.load_parser_implementations()
    launch.frontend.parse_substitution.parse_substitution("text")
time.sleep = lambda seconds, sleep=time.sleep: sleep(min(seconds, 0.05))
for request in json.load(sys.stdin):
    if os.fork() == 0:
        signal.alarm(10)
        keep = os.dup(1)
        os.dup2(2, 1)
        plan = evaluate(request["file"], request["arguments"], request["root"])
        os.write(keep, json.dumps(plan).encode() + b"\\n")
        os._exit(0)
    if os.wait()[1] != 0:
        os.write(1, b"{}\\n")
"""


def environment(prefix: Path) -> dict[str, str]:
    """Return the environment variables of an evaluation."""
    kept = ("PATH", "HOME", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
    return {**{n: os.environ[n] for n in kept if n in os.environ}, "AMENT_PREFIX_PATH": str(prefix)}


def original_environment(prefix: Path) -> dict[str, str]:
    """Return the environment variables of the original.

    Its own prefix holds the grammar of substitutions.
    """
    return {
        **environment(prefix),
        "AMENT_PREFIX_PATH": f"{prefix}:{ORIGINAL / 'prefix'}",
        "PYTHONPATH": str(ORIGINAL),
    }


def plans_of(
    requests: Sequence[dict[str, Any]],
    surroundings: dict[str, str],
    *,
    path: Path = STANDIN,
    native: bool = False,
) -> list[dict[str, Any]]:
    """The plans of requests in their order; an empty one where the evaluation died.

    Parameters
    ----------
    path : Path
        Where `launch` is found.
    native : bool
        Evaluate as on a ROS machine, whatever `launch` that is.
    """
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            _BATCH,
            str(INSIDE / "evaluate.py"),
            str(path),
            "native" if native else "standin",
        ],
        input=json.dumps(list(requests)),
        capture_output=True,
        text=True,
        env=surroundings,
        timeout=240,
        check=False,
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(lines) == len(requests), done.stderr
    return lines


def make_package(prefix: Path, package: str, *executables: str) -> Path:
    """Install a package with some executables in an ament prefix."""
    index = prefix / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True, exist_ok=True)
    (index / package).touch()
    (prefix / "share" / package).mkdir(parents=True)
    for name in executables:
        path = prefix / "lib" / package / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("#!/bin/sh\n")
        path.chmod(0o644 if name == "not_executable" else 0o755)
    return prefix
