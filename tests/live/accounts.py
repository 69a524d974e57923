"""Accounts that exist only for a test, and commands run by them, also with a real sudo."""

from __future__ import annotations

import json
import os
import pwd
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from tests.live.surroundings import Remains, Surroundings

ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def account() -> Iterator[tuple[int, int]]:
    """Give the user and group id of a temporary account, or the caller's own ids without root."""
    if os.geteuid() != 0:
        yield os.getuid(), os.getgid()
        return
    name = f"grade-tests-{os.getpid()}"
    command = [
        "useradd",
        "--no-create-home",
        "--home-dir",
        "/nonexistent",
        "--shell",
        "/usr/sbin/nologin",
        name,
    ]
    subprocess.run(command, check=True, capture_output=True)
    try:
        entry = pwd.getpwnam(name)
        yield entry.pw_uid, entry.pw_gid
    finally:
        subprocess.run(["userdel", name], check=True, capture_output=True)


@contextmanager
def account_with_sudo() -> Iterator[tuple[int, int]]:
    """Give an account that may use sudo without a password, like accounts of CI systems."""
    with account() as (user, group):
        rules = Path(f"/etc/sudoers.d/grade-tests-{os.getpid()}")
        rules.write_text(f"#{user} ALL=(ALL) NOPASSWD: ALL\n", encoding="utf-8")
        rules.chmod(0o440)
        try:
            yield user, group
        finally:
            rules.unlink()


def run_with_sudo(
    folder: Path,
    command: Sequence[str | Path],
    variables: Mapping[str, str | Path],
    limit_s: float = 180.0,
) -> Remains:
    """Run a command as an account with sudo, to which a folder and all in it are given; the folder is the working one."""
    with account_with_sudo() as (user, group):
        subprocess.run(["chown", "-R", f"{user}:{group}", str(folder)], check=True)
        interpreter = Path(sys.executable)
        readable = (folder, ROOT, Path(sys.prefix), interpreter.resolve().parents[1])
        told = folder.parent / f"{folder.name}.json"
        surroundings = Surroundings(
            str(told), str(folder), user, group, list(map(str, readable)), limit_s=limit_s
        )
        program = [sys.executable, "-I", str(Path(__file__).with_name("surroundings.py"))]
        entering = ["bash", "-c", 'cd -- "$0" && exec "$@"', str(folder)]
        subprocess.run(
            [*program, json.dumps(asdict(surroundings)), *entering, *map(str, command)],
            env={"PATH": os.environ["PATH"], "LANG": "C.UTF-8"}
            | {name: str(value) for name, value in variables.items()},
            cwd="/",
            check=True,
            timeout=limit_s + 60,
        )
    return Remains(**json.loads(told.read_text(encoding="utf-8")))
