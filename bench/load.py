"""Loads beside a measurement, and the load average."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from pathlib import Path

#: Start of a program that ends with its parent process.
_WHILE_WANTED = "import os\nparent = os.getppid()\nwhile os.getppid() == parent:\n    "
_SPIN = _WHILE_WANTED + "sum(range(100_000))\n"
_START = (
    "import subprocess, sys\n"
    + _WHILE_WANTED
    + "subprocess.run([sys.executable, '-c', 'import json, email'])\n"
)
_INSTALL = (
    "import shutil, subprocess, sys, tempfile\n"
    + _WHILE_WANTED
    + "into = tempfile.mkdtemp(dir=sys.argv[1])\n"
    + "    subprocess.run([sys.executable, '-m', 'venv', into], stdout=subprocess.DEVNULL)\n"
    + "    shutil.rmtree(into)\n"
)
#: Share of the time that a host takes, and range of each stop, in s.
_STOLEN, _STOP_S = 0.25, (0.005, 0.030)


def cores() -> int:
    """Return the number of cores for this process."""
    return len(os.sched_getaffinity(0))


@contextmanager
def _running(*programs: str) -> Iterator[None]:
    with ExitStack() as stack:
        scratch = stack.enter_context(
            tempfile.TemporaryDirectory(prefix="bench-load-", ignore_cleanup_errors=True)
        )
        for program in programs:
            # Each program has a session of its own, because Linux may weigh sessions and not processes.
            command = [sys.executable, "-I", "-S", "-c", program, scratch]
            process = stack.enter_context(subprocess.Popen(command, start_new_session=True))
            stack.callback(process.wait)
            stack.callback(os.killpg, process.pid, signal.SIGKILL)
        yield


def busy() -> AbstractContextManager[None]:
    """Keep the machine busy: four processes that never wait, two that start interpreters, one that installs."""
    return _running(*[_SPIN] * 4, *[_START] * 2, _INSTALL)


@contextmanager
def stolen() -> Iterator[None]:
    """Stop the processes started by this process's children, a quarter of the time, as a host stops a virtual machine."""
    ended = threading.Event()
    thread = threading.Thread(target=_steal, args=(ended,))
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _steal(ended: threading.Event) -> None:
    chance = random.Random(0)
    with suppress(OSError):
        os.sched_setscheduler(threading.get_native_id(), os.SCHED_FIFO, os.sched_param(50))
    mean_s = sum(_STOP_S) / 2
    pids: list[int] = []
    while not ended.wait(chance.expovariate(1 / (mean_s * (1 / _STOLEN - 1)))):
        until_s = time.monotonic() + chance.uniform(*_STOP_S)
        _signal(pids, signal.SIGSTOP)
        # Search while the processes are stopped: otherwise the search takes a core from them, for up to 29 ms.
        pids = _grandchildren()
        _signal(pids, signal.SIGSTOP)
        time.sleep(max(0.0, until_s - time.monotonic()))
        _signal(pids, signal.SIGCONT)


def _signal(pids: list[int], number: signal.Signals) -> None:
    for pid in pids:
        with suppress(OSError):
            os.kill(pid, number)


def _grandchildren() -> list[int]:
    """Return all descendants of this process except its children, which it would see as stopped."""
    children: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parent = int(stat.read_bytes().rsplit(b")", 1)[1].split()[1])
            children.setdefault(parent, []).append(int(stat.parent.name))
    found: list[int] = []
    waiting: list[int] = []
    for child in children.get(os.getpid(), ()):
        waiting += children.get(child, ())
    while waiting:
        pid = waiting.pop()
        found.append(pid)
        waiting += children.get(pid, ())
    return found


@contextmanager
def idle() -> Iterator[None]:
    """Leave the machine as it is."""
    yield


#: Loads by name.
LOADS: dict[str, Callable[[], AbstractContextManager[None]]] = {
    "idle": idle,
    "busy": busy,
    "stolen": stolen,
}


def load_average() -> float:
    """Return the load average of the last minute."""
    return os.getloadavg()[0]
