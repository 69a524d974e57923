"""Other processes that want the machine's cores, and how busy it is."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

#: It ends with the process that started it.
_SPIN = "import os\nparent = os.getppid()\nwhile os.getppid() == parent:\n    sum(range(100_000))\n"


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


@contextmanager
def spinners(count: int) -> Iterator[None]:
    """Keep `count` processes busy that never wait."""
    with ExitStack() as stack:
        for _ in range(count):
            # Each in a session of its own: Linux may weigh sessions, and those of one would count as one.
            command = [sys.executable, "-I", "-S", "-c", _SPIN]
            process = stack.enter_context(subprocess.Popen(command, start_new_session=True))
            stack.callback(process.kill)
        yield


def load_average() -> float:
    """Return how many processes wanted a core over the last minute."""
    return os.getloadavg()[0]
