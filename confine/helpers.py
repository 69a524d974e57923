"""Starts trusted helper processes apart from the working folder and the variables of the caller.

The working folder may hold untrusted code, and Python, the dynamic loader and libraries take code and settings from
there. Each helper therefore starts in `/`, with an environment made from nothing, and Python with `-I`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NoReturn

#: Folders of system programs, for a caller without a usable PATH.
_SYSTEM_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_SYSTEM_FOLDERS = _SYSTEM_PATH.split(":")
#: Variables of the caller that helpers get: the user, the language and the folders of temporary and kept files.
_PLAIN = ("USER", "LOGNAME", "LANG", "LC_ALL", "LC_CTYPE", "TZ", "CI")
_FOLDERS = ("HOME", "TMPDIR", "XDG_CACHE_HOME", "XDG_STATE_HOME", "XDG_RUNTIME_DIR")
#: Working folder of each helper.
FOLDER = "/"


def absolute_entries(variable: str, without: Iterable[Path] = ()) -> list[str]:
    """Return the folders of a list such as PATH, except relative ones, the working folder and some others.

    An entry below one of the folders `without` is left out too. For example `:/opt/ros/lib:bin` gives `/opt/ros/lib`.
    """
    excluded = [Path(os.path.realpath(folder)) for folder in without]
    here = _working_folder()
    entries = []
    for entry in filter(os.path.isabs, os.environ.get(variable, "").split(os.pathsep)):
        real = Path(os.path.realpath(entry))
        if entry in _SYSTEM_FOLDERS:
            entries.append(entry)
        elif real != here:
            if not any(map(real.is_relative_to, excluded)):
                entries.append(entry)
    return entries


def _working_folder() -> Path | None:
    """Return the working folder of the caller, None if it has been removed."""
    try:
        return Path(os.path.realpath(Path.cwd()))
    except OSError:
        return None


def search_path() -> str:
    """Return the PATH of system programs: the caller's, absolute entries only."""
    entries = absolute_entries("PATH")
    if not entries:
        return _SYSTEM_PATH
    return os.pathsep.join(entries)


def find_tool(name: str) -> str | None:
    """Return the path of a system program, or None."""
    return shutil.which(name, path=search_path())


def helper_environment(also: Iterable[str] = ()) -> dict[str, str]:
    """Return the environment of a helper: a few of the caller's variables, and those named in `also`."""
    kept = {"PATH": search_path()}
    for name in (*_PLAIN, *also):
        if name in os.environ:
            kept[name] = os.environ[name]
    for name in _FOLDERS:
        folder = os.environ.get(name, "")
        if Path(folder).is_absolute():
            kept[name] = folder
    return kept


def python(interpreter: str | Path, *words: str) -> list[str]:
    """Return a command line of Python without modules from the working folder or from variables."""
    return [str(interpreter), "-I", *words]


def start_helper(
    command: Sequence[str],
    *,
    environment: Mapping[str, str],
    pass_fds: Sequence[int] = (),
    start_new_session: bool = False,
    before: Callable[[], object] | None = None,
) -> subprocess.Popen[bytes]:
    """Start a helper beside this process, without input and output.

    `before` runs in the new process before the command. Raises `OSError` if it cannot be started.
    """
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=dict(environment),
        cwd=FOLDER,
        pass_fds=pass_fds,
        start_new_session=start_new_session,
        preexec_fn=before,
    )


def become(command: Sequence[str], *, environment: Mapping[str, str]) -> NoReturn:
    """Replace this process by a helper that keeps its input, its output and its terminal.

    Raises `OSError` if it cannot be started.
    """
    os.chdir(FOLDER)
    os.execve(command[0], list(command), dict(environment))


def run_helper(
    command: Sequence[str],
    *,
    environment: Mapping[str, str] | None = None,
    timeout_s: float | None = None,
    pass_fds: Sequence[int] = (),
    before: Callable[[], object] | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run a helper to its end and return its output and exit status; `before` is called in it before the command.

    Raises `OSError` if it cannot be started, and `subprocess.TimeoutExpired` if it was ended for its time.
    """
    if environment is None:
        environment = helper_environment()
    return subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=timeout_s,
        env=dict(environment),
        cwd=FOLDER,
        pass_fds=pass_fds,
        preexec_fn=before,
    )


def run_attached(
    command: Sequence[str],
    *,
    environment: Mapping[str, str],
    pass_fds: Sequence[int] = (),
    before: Callable[[], object] | None = None,
    timeout_s: float | None = None,
) -> int:
    """Run a command to its end with the input and the outputs of this process, and return its exit status.

    The status is 128 and the number of the signal if one has ended it. Raises `OSError` if it cannot be started, and
    `subprocess.TimeoutExpired` if it was ended for its time.
    """
    status = subprocess.run(
        command,
        check=False,
        timeout=timeout_s,
        env=dict(environment),
        cwd=FOLDER,
        pass_fds=pass_fds,
        preexec_fn=before,
    ).returncode
    if status < 0:
        return 128 - status
    return status


def start_piped(
    command: Sequence[str],
    *,
    environment: Mapping[str, str],
    pass_fds: Sequence[int],
    with_input: bool,
) -> subprocess.Popen[bytes]:
    """Start a command in a session of its own with pipes to it, without buffers; see `start_helper`."""
    stdin = subprocess.DEVNULL
    if with_input:
        stdin = subprocess.PIPE
    return subprocess.Popen(
        command,
        bufsize=0,
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=dict(environment),
        cwd=FOLDER,
        pass_fds=pass_fds,
        start_new_session=True,
    )
