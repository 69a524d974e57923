"""Runs receivers and a publisher together, in a network of their own if the system permits it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from grader.live.sandbox.environment import trusted_environment

_ROOT = Path(__file__).resolve().parent.parent
_DOMAIN = 97
_LONGEST_S = 60.0

Words = Sequence[str]


def own_network() -> list[str]:
    """Return the start of a command line for a network of its own; empty if the system forbids it."""
    wrapper = ["unshare", "--net", "--map-root-user"]
    if not shutil.which("unshare"):
        return []
    tried = subprocess.run([*wrapper, "true"], capture_output=True, check=False)
    if tried.returncode != 0:
        return []
    return [*wrapper, "sh", "-c", 'ip link set lo up && exec "$@"', "sh"]


def run_together(receivers: Sequence[Words], publisher: Words) -> list[dict[str, Any]]:
    """Run programs of `bench.programs`, given by name and arguments; return their outputs, the publisher's first.

    Raises
    ------
    RuntimeError
        If a program failed.
    """
    with tempfile.TemporaryDirectory(prefix="bench-") as home:
        environment = {**trusted_environment(Path(home), _DOMAIN), "PYTHONPATH": str(_ROOT)}
        run = subprocess.run(
            [
                *own_network(),
                sys.executable,
                "-m",
                "bench.together",
                json.dumps([publisher, *receivers]),
            ],
            capture_output=True,
            text=True,
            env=environment,
            cwd=_ROOT,
            timeout=_LONGEST_S,
            check=False,
        )
    if run.returncode != 0:
        raise RuntimeError(run.stderr.strip() or "a program failed")
    said: list[dict[str, Any]] = json.loads(run.stdout.splitlines()[-1])
    return said


def _start(words: Words) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", f"bench.programs.{words[0]}", *words[1:]]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def main() -> None:
    """Start all programs, wait for the publisher, and end the receivers by closing their standard input."""
    publisher, *receivers = json.loads(sys.argv[1])
    running = [_start(words) for words in [*receivers, publisher]]
    said = [running[-1].communicate()[0]]
    said += [process.communicate()[0] for process in running[:-1]]
    print(json.dumps([json.loads(text.splitlines()[-1]) for text in said]))


if __name__ == "__main__":
    main()
