"""Submissions for repeated gradings: correct ones in different styles, and some near a limit."""

from __future__ import annotations

import shutil
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOLUTION = ROOT / "reference" / "solution"

_RATE = 'self.declare_parameter("publish_rate", 100.0)'
_PUBLISH = "        self.publisher.publish(Float64MultiArray(data=joint_positions(time_s)))\n"
_REPORT = '        self.get_logger().info(f"RMS tracking error: {rms:.4f} rad")\n'


@dataclass(frozen=True)
class NearLimit:
    """A submission near a limit.

    Attributes
    ----------
    file : str
        Changed file of the solution, handed in alone, so only its session runs.
    old, new : str
        Replaced text and its replacement.
    check : str
        Check with the near limit.
    """

    name: str
    about: str
    file: str
    old: str
    new: str
    check: str


def _rate(name: str, about: str, rate_hz: float) -> NearLimit:
    return NearLimit(
        name,
        about,
        "joint_publisher.py",
        _RATE,
        _RATE.replace("100.0", str(rate_hz)),
        "publisher.rate",
    )


def _jitter(name: str, about: str, jitter_s: float) -> NearLimit:
    # Each message has a random delay, and the next keeps to the timer's schedule. The rate thus stays the same, and the
    # delay bounds the lateness after a tick delayed by a busy machine.
    wait = (
        "        import random, time\n"
        "        due_s = self.timer.time_until_next_call() * 1e-9 - self.period_s\n"
        f"        time.sleep(max(0.0, due_s + random.uniform(0.0, {jitter_s})))\n"
    )
    return NearLimit(
        name, about, "joint_publisher.py", _PUBLISH, wait + _PUBLISH, "publisher.steady"
    )


NEAR_LIMITS = (
    _rate("rate_98_5_hz", "98.5 Hz; 98 Hz still earns full credit", 98.5),
    _rate("rate_97_5_hz", "97.5 Hz, just below full credit", 97.5),
    _rate("rate_90_hz", "90 Hz, which must never pass", 90.0),
    _jitter("jitter_2_ms", "random delays of up to 2 ms; 3 ms earn full credit", 0.002),
    _jitter(
        "jitter_15_ms", "random delays of up to 15 ms: one interval in 20 is some 10 ms off", 0.015
    ),
    NearLimit(
        "reports_10_of_11",
        "reports on 10 of 11 states; 9 of 10 earn full credit",
        "joint_subscriber.py",
        _REPORT,
        "        self.seen = getattr(self, 'seen', 0) + 1\n        if self.seen % 11:\n    "
        + _REPORT,
        "subscriber.rms",
    ),
)


#: Fixtures with correct submissions: a package, coroutines, one process for all nodes of the launch file, dataclasses.
_STYLES = (
    "correct_ament_package",
    "correct_asyncio",
    "correct_one_process",
    "correct_typed_dataclass",
)

#: Names of all submissions, the solution first.
NAMES = ("solution", *_STYLES, *(near.name for near in NEAR_LIMITS))


def write(folder: Path, names: Collection[str] = NAMES, *, solution: Path = SOLUTION) -> None:
    """Write submissions into a folder; submissions near a limit are files of the solution with one change.

    Raises
    ------
    ValueError
        If the solution does not hold a text to change.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    whole = {
        "solution": solution,
        **{name: ROOT / "fixtures" / name / "submission" for name in _STYLES},
    }
    for name in names:
        if name in whole:
            shutil.copytree(
                whole[name], folder / name, ignore=shutil.ignore_patterns("__pycache__")
            )
    for near in NEAR_LIMITS:
        if near.name not in names:
            continue
        text = (solution / near.file).read_text(encoding="utf-8")
        if text.count(near.old) != 1:
            raise ValueError(
                f"{near.name}: the solution's {near.file} does not hold {near.old!r} once"
            )
        (folder / near.name).mkdir()
        (folder / near.name / near.file).write_text(
            text.replace(near.old, near.new), encoding="utf-8"
        )
