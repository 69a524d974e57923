"""What all reference nodes share: their configuration, their node, their pace and their end.

A reference node is started as `python -I .../arm.py '{"seed": 1, "names": {...}, "with": {...}}'`.
It prints `ready` once all its endpoints exist, runs until SIGINT or SIGTERM, and exits with status 0.
"""

from __future__ import annotations

import json
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from rclpy.node import Node

# No sleep is longer than this, so that a stop is noticed soon: a signal does not cut `time.sleep` short.
LONGEST_SLEEP_S = 0.02
BAD_CONFIGURATION_STATUS = 2

T = TypeVar("T")


class ConfigurationError(ValueError):
    """The configuration on the command line cannot be used."""


@dataclass(frozen=True)
class Configuration:
    """A reference node's only input.

    Attributes
    ----------
    seed : int
        All that is drawn by lot is drawn from it.
    names : dict
        Topic or service name in the rubric -> name that the student used.
    settings : dict
        The rubric's `with`.
    subscriptions : dict
        Topic on the graph -> number of the student's subscriptions to it. Those of a process that died may
        be among them: DDS counts them until their lease has run out.
    types : dict
        Topic on the graph -> type to which the student subscribes.
    """

    seed: int = 0
    names: dict[str, str] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    subscriptions: dict[str, int] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)

    def name(self, rubric_name: str) -> str:
        """Give the name to use on the graph for a topic or service of the rubric."""
        return self.names.get(rubric_name, rubric_name)


def parse_configuration(text: str) -> Configuration:
    """Read the JSON object of the command line.

    Raises
    ------
    ConfigurationError
        If it is not such an object.
    """
    try:
        plain = json.loads(text)
    except ValueError as problem:
        raise ConfigurationError(f"the configuration is not JSON: {problem}") from problem
    if not isinstance(plain, dict) or not set(plain) <= {"seed", "names", "with", "subscriptions", "types"}:
        raise ConfigurationError('the configuration must be an object with "seed", "names", "with" and "subscriptions"')
    seed = plain.get("seed", 0)
    names, settings, subscriptions, types = (
        plain.get(key) or {} for key in ("names", "with", "subscriptions", "types")
    )
    if not isinstance(seed, int) or not all(isinstance(x, dict) for x in (names, settings, subscriptions, types)):
        raise ConfigurationError('"seed" must be an integer, "names", "with" and "subscriptions" objects')
    return Configuration(seed, names, settings, subscriptions, types)


def build_settings(kind: type[T], plain: dict[str, Any]) -> T:
    """Build a settings dataclass from the rubric's `with`.

    Raises
    ------
    ConfigurationError
        If a key is unknown, or the dataclass refuses a value.
    """
    known = sorted(f.name for f in fields(kind))  # type: ignore[arg-type]
    for key in plain:
        if key not in known:
            raise ConfigurationError(f"unknown setting {key!r}; the settings are {', '.join(known)}")
    try:
        return kind(**plain)
    except (TypeError, ValueError) as problem:
        raise ConfigurationError(str(problem)) from problem


class StopRequest:
    """True as soon as SIGINT or SIGTERM has come, also where the parent had them ignored."""

    def __init__(self) -> None:
        self._requested = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._requested = True

    def __bool__(self) -> bool:
        return self._requested


def sleep_until(deadline_ns: int, stop: StopRequest) -> None:
    """Sleep until `time.monotonic_ns()` reaches the deadline, or a stop is requested."""
    while not stop and (left_s := (deadline_ns - time.monotonic_ns()) / 1e9) > 0:
        time.sleep(min(left_s, LONGEST_SLEEP_S))


@contextmanager
def reference_node(name: str) -> Iterator[Node]:
    """Give a node that nobody can steer from outside: no parameter services, no ROS arguments, no rosout."""
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(name, start_parameter_services=False, enable_rosout=False)
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def run(kind: type[T], play: Callable[[Configuration, T, StopRequest], None]) -> int:
    """Run a reference node's `play` with the configuration of the command line; give the exit status."""
    stop = StopRequest()
    try:
        if len(sys.argv) != 2:
            raise ConfigurationError("one argument is expected: the configuration as a JSON object")
        configuration = parse_configuration(sys.argv[1])
        settings = build_settings(kind, configuration.settings)
    except ConfigurationError as problem:
        print(f"{sys.argv[0]}: {problem}", file=sys.stderr)
        return BAD_CONFIGURATION_STATUS
    play(configuration, settings, stop)
    return 0
