"""A real ROS graph for tests of reference nodes: starts a node as the grader does, and listens beside it."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import IO, Any

from grader.recording.session import GRADER_NAMESPACE

REFERENCE = Path(__file__).resolve().parents[2] / "reference"


@dataclass
class Listener:
    """A node of the test and its received messages by topic: (source timestamp in ns, message)."""

    node: Any
    executor: Any
    received: dict[str, list[tuple[int, Any]]] = field(default_factory=dict)

    def listen(self, topic: str, kind: type, depth: int = 2000) -> None:
        """Keep all messages of a topic."""
        kept = self.received.setdefault(topic, [])

        def keep(message: Any, info: dict[str, int]) -> None:
            kept.append((info["source_timestamp"], message))

        self.node.create_subscription(kind, topic, keep, depth)

    def spin_until(self, reached: Callable[[], bool], timeout_s: float) -> bool:
        """Receive until something is reached, or the time is up; tell which."""
        deadline_s = time.monotonic() + timeout_s
        while not reached():
            if time.monotonic() > deadline_s:
                return False
            self.executor.spin_once(timeout_sec=0.02)
        return True

    def spin_for(self, duration_s: float) -> None:
        """Receive for a time."""
        self.spin_until(lambda: False, duration_s)


@contextmanager
def listener(domain_id: int) -> Iterator[Listener]:
    """Yield a listener with its own context, in the recorder's namespace.

    Reference nodes wait for the recorder.
    """
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor

    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    node = rclpy.create_node("listener", namespace=GRADER_NAMESPACE, context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        yield Listener(node, executor)
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


@contextmanager
def started(
    script: str, configuration: dict[str, Any], domain_id: int
) -> Iterator[subprocess.Popen[str]]:
    """Start a reference node as the grader does, yield it once it is ready, and stop it in the end.

    Before it is ready, the node prints its participant's gid.
    """
    argv = [sys.executable, "-I", str(REFERENCE / script), json.dumps(configuration)]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain_id)}
    process = subprocess.Popen(
        argv, env=environment, cwd="/", text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    try:
        assert re.fullmatch("participant [0-9a-f]{24}\n", lines(process).readline())
        assert lines(process).readline() == "ready\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def lines(process: subprocess.Popen[str]) -> IO[str]:
    """Give the standard output of a started node."""
    assert process.stdout is not None
    return process.stdout


def stop(process: subprocess.Popen[str], number: int = signal.SIGINT) -> tuple[int, str, str]:
    """Stop a node and return exit status, the rest of standard output, and standard error.

    Lines about publications are left out; see `stop_and_hear`.
    """
    status, rest, error = _stopped(process, number)
    kept = [line for line in rest.splitlines(keepends=True) if not line.startswith("published ")]
    return status, "".join(kept), error


def stop_and_hear(process: subprocess.Popen[str]) -> dict[str, str]:
    """Stop a node and return its report of publications: digests by topic and type."""
    told: dict[str, str] = {}
    for line in _stopped(process, signal.SIGINT)[1].splitlines():
        word, topic, topic_type, digests, last = line.split(" ")
        assert (word, last) == ("published", "recorded")
        assert len(line) < 8192
        told[f"{topic} {topic_type}"] = told.get(f"{topic} {topic_type}", "") + digests
    return told


def _stopped(process: subprocess.Popen[str], number: int) -> tuple[int, str, str]:
    process.send_signal(number)
    rest, error = process.communicate(timeout=30)
    return process.returncode, rest, error


def use_private_graph(set_variable: Callable[[str, str], None], folder: Path) -> int:
    """Set the environment of a graph that stays on this machine; give a domain that this process may use."""
    set_variable("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    set_variable("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    set_variable("ROS_LOG_DIR", str(folder))
    return own_domain()[0]


@cache
def own_domain() -> tuple[int, socket.socket]:
    """Return a ROS domain unused in this network, and the socket that reserves it for this process.

    Cells reserve their numbers by the same socket, and use them as domains in a shared network.
    """
    for number in range(100, 0, -1):
        held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            held.bind(f"\0grade-cell-{number}")
        except OSError:
            held.close()
        else:
            return number, held
    raise RuntimeError("all domains of this network are taken")
