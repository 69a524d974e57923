"""Runs a command confined: `python -m confine -- COMMAND`."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from confine.command import confined
from confine.helpers import run_attached, search_path
from confine.interpreters import OWN_INTERPRETER
from confine.isolation import ConfinementError, Isolation, Level, free_slot, sandbox_cgroup
from confine.machine import descendants_of
from confine.namespaces import adopt_orphans, bring_loopback_up, mount_tmpfs
from confine.probing import probe_isolation
from confine.room import HOME, TEMPORARY, Room, private_room
from confine.running import enter_or_end
from confine.scratch import remove_stale, scratch_prefix

#: Exit statuses of this program's own, as env(1) and timeout(1) have them; others are the command's.
_TIMED_OUT, _NOT_CONFINED, _INTERRUPTED = 124, 125, 130
#: Size of each area in bytes, and the number of files in it.
_AREA_BYTES, _AREA_FILES = 64 * 1024 * 1024, 20_000
_DESCRIPTION = """
Run a command that is not trusted: in namespaces of its own, below limits, without privileges and without a network;
or with less, as far as this machine permits. The level is printed on standard error. The command starts in an empty
home, sees the system's programs, and may change nothing but its home, /tmp and /dev/shm, which are deleted afterwards.
"""
_EPILOG = f"""
Levels, from the best: full, no-cgroup, reduced, none. The exit status is the command's; {_NOT_CONFINED} if it cannot
be confined as required, {_TIMED_OUT} if it took too long.
"""


def main() -> int:
    """Run the command of the command line, and return the exit status."""
    arguments = _parser().parse_args()
    isolation = probe_isolation(arguments.python)
    try:
        isolation.require(arguments.at_least)
    except ConfinementError as problem:
        print(f"confine: {problem}. {problem.remedy}", file=sys.stderr)
        return _NOT_CONFINED
    print(f"confine: level {isolation.level.value}. {isolation.remedy}".rstrip(), file=sys.stderr)
    remove_stale()
    with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as scratch:
        room = private_room(Path(scratch), arguments.python)
        tools = {str(folder): folder for folder in arguments.read}
        room = replace(room, tools=tools)
        return _run(isolation, room, Path(scratch), arguments.command, arguments.timeout)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m confine", description=_DESCRIPTION, epilog=_EPILOG)
    parser.add_argument(
        "--at-least",
        type=Level.of,
        default=Level.REDUCED,
        metavar="LEVEL",
        help="do not run the command below this level (default: reduced)",
    )
    parser.add_argument(
        "--read",
        type=_folder,
        action="append",
        default=[],
        metavar="FOLDER",
        help="let the command read this folder, at its own path; may be repeated",
    )
    parser.add_argument(
        "--timeout", type=float, metavar="S", help="end the command after this time, in seconds"
    )
    parser.add_argument(
        "--python",
        type=Path,
        default=OWN_INTERPRETER,
        metavar="FILE",
        help="interpreter that the command may use besides the system's (default: this one)",
    )
    parser.add_argument("command", nargs="+", metavar="COMMAND", help="the command and its words")
    return parser


def _folder(name: str) -> Path:
    folder = Path(name).resolve()
    if not folder.is_dir():
        raise argparse.ArgumentTypeError(f"{name} is no folder")
    if folder == Path("/"):
        raise argparse.ArgumentTypeError("the whole system cannot be shown")
    return folder


def _run(
    isolation: Isolation,
    room: Room,
    scratch: Path,
    command: Sequence[str],
    timeout_s: float | None,
) -> int:
    """Run a command in a sandbox of its own, with the input and the outputs of this process."""
    seen = room.seen(isolation)
    adopt_orphans()
    with ExitStack() as stack:
        slot = stack.enter_context(free_slot())
        group = sandbox_cgroup(isolation, slot)
        if group is not None:
            stack.callback(group.remove)
            group.make()
        argv, passed, info = stack.enter_context(
            confined(
                isolation,
                command,
                environment=_environment(room.interpreter, seen),
                room=room,
                slot=slot,
                cwd=seen[HOME],
                group=group,
            )
        )
        if info is not None:
            stack.callback(os.close, info)
        try:
            return run_attached(
                argv,
                environment={"PATH": search_path()},
                pass_fds=passed,
                before=partial(
                    enter_or_end, isolation.form, partial(_prepare, isolation, room, scratch)
                ),
                timeout_s=timeout_s,
            )
        except subprocess.TimeoutExpired:
            print(f"confine: the command was ended after {timeout_s:g} s", file=sys.stderr)
            return _TIMED_OUT
        except KeyboardInterrupt:
            return _INTERRUPTED
        except OSError as problem:
            print(f"confine: the command cannot be started: {problem}", file=sys.stderr)
            return _NOT_CONFINED
        finally:
            _end_orphans()


def _environment(interpreter: Path, seen: Mapping[str, str]) -> dict[str, str]:
    """Return the variables of the command."""
    return {
        "PATH": f"{interpreter.parent}:/usr/local/bin:/usr/bin:/bin",
        "HOME": seen[HOME],
        "TMPDIR": seen[TEMPORARY],
        "LANG": "C.UTF-8",
    }


def _prepare(isolation: Isolation, room: Room, scratch: Path) -> None:
    """Make the areas of a room, as file systems of limited size if this is the first process of a sandbox."""
    if isolation.namespaces:
        bring_loopback_up()
        room.make(scratch, _mount)
    else:
        room.make(scratch)
    room.open_to_all(*room.areas)


def _mount(folder: Path) -> None:
    mount_tmpfs(str(folder), _AREA_BYTES, _AREA_FILES)


def _end_orphans() -> None:
    """Kill the processes that the command left behind; in namespaces of its own it leaves none."""
    while True:
        orphans = descendants_of(os.getpid())[1:]
        for pid in orphans:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        try:
            os.waitpid(-1, 0)
        except ChildProcessError:
            return


if __name__ == "__main__":
    sys.exit(main())
