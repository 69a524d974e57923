"""Checks of this lab: when the node brakes, and that it does not where nothing is in the way."""

from dataclasses import dataclass

import numpy as np

from grader.own_checks import (
    Context,
    Finding,
    Part,
    Process,
    Topic,
    Window,
    cpu_delay_doubt,
    failed,
    graded,
    of_parts,
    passed,
    ramp,
    unexplained,
)

#: Least speed of a car that moves, in m/s.
MOVES = 0.05
#: Delay of a node by the machine, in s, that can cost the time from a threshold of 1 s to the last moment to brake.
LATE_S = 0.5


@dataclass
class Stops:
    topic: Topic
    odometry: Topic
    process: Process
    window: Window
    #: A car that has come so far has hit the wall.
    wall_m: float


def stops(context: Context, p: Stops) -> Finding:
    """The car stands at the end, and has not come as far as the wall."""
    expected = f"a car that stands before {p.wall_m:g} m"
    where = (context.location(p.odometry),)
    places = context.series(p.odometry, "pose.pose.position.x")
    speeds = context.series(p.odometry, "twist.twist.linear.x")
    if places is None or speeds is None:
        return failed(expected, "no odometry", "The car did not move.", where=where)
    place, speed = float(places.values[-1, 0]), float(speeds.values[-1, 0])
    measured = f"{speed:.1f} m/s at {place:.2f} m"
    if place < p.wall_m and speed <= MOVES:
        return passed(expected, measured, where=where)
    reason = "The car hit the wall." if place >= p.wall_m else "The car never stopped."
    # A node that the machine kept from a core may have been late without a fault of its own.
    delay_s = context.delay_s(p.process, p.window)
    best = 1.0 if delay_s > LATE_S else 0.0
    doubt = cpu_delay_doubt(delay_s, context.duration_s)
    finding = graded(0.0, expected, measured, reason, where=where, best=best, doubt=doubt)
    if len(brakes(context, p.topic)):
        return finding
    # The end of the program, if it ended, explains why no command came.
    return unexplained(finding)


@dataclass
class InTime:
    topic: Topic
    odometry: Topic
    wall_m: float
    earliest_s: float
    latest_s: float
    none_before_s: float


def brakes_in_time(context: Context, p: InTime) -> Finding:
    """The time to collision at the first command to brake lies between two limits."""
    expected = f"brakes {p.latest_s:g} to {p.earliest_s:g} s before the wall"
    braked_s = brakes(context, p.topic)
    where = (context.location(p.topic),)
    if not len(braked_s):
        return failed(expected, "no command to brake", "No message with drive.speed 0 came.", where=where)
    odometry = context.series(p.odometry, "pose.pose.position.x")
    speeds = context.series(p.odometry, "twist.twist.linear.x")
    if odometry is None or speeds is None:
        return failed(expected, "no odometry", "The car did not move.", where=where)
    at = max(0, int(np.searchsorted(odometry.sent_s, braked_s[0])) - 1)
    moving = speeds.values[speeds.values > MOVES]
    left_s = (p.wall_m - float(odometry.values[at, 0])) / float(moving[0])
    measured = f"brakes first {left_s:.2f} s before the wall"
    if left_s < p.latest_s:
        return failed(expected, measured, "It brakes too late for the car to stop.", where=where)
    early_s = max(0.0, left_s - p.earliest_s)
    share = ramp(early_s, 0.0, p.none_before_s - p.earliest_s)
    return graded(
        share,
        expected,
        measured,
        f"It brakes {left_s:.1f} s before the collision, {early_s:.1f} s too early.",
        hint="Compare the least of range / (speed * cos(angle)) with a threshold of about 1 s.",
        where=where,
    )


@dataclass
class Harmless:
    topic: Topic
    odometry: Topic


def spares_the_brake(context: Context, p: Harmless) -> Finding:
    """No command to brake comes while the car drives along the corridor, stands, or reverses."""
    braked_s = brakes(context, p.topic)
    speeds = context.series(p.odometry, "twist.twist.linear.x")
    expected = "no command to brake"
    if speeds is None:
        return failed(expected, "no odometry", "The car did not move.")
    at = np.maximum(np.searchsorted(speeds.sent_s, braked_s) - 1, 0)
    then = speeds.values[at, 0]
    parts = [
        _spared(int(np.sum(then > MOVES)), "along the corridor", 2.0),
        _spared(int(np.sum(abs(then) <= MOVES)), "while it stands", 1.0),
        _spared(int(np.sum(then < -MOVES)), "while it reverses", 1.0),
    ]
    return of_parts(expected, parts, where=(context.location(p.topic),))


def _spared(count: int, when: str, weight: float) -> Part:
    if not count:
        return Part(1.0, f"none {when}", weight=weight)
    reason = f"It brakes {when}, {count} times, although nothing is in the way."
    return Part(0.0, f"{count} {when}", reason, weight=weight)


def brakes(context: Context, topic: str):
    """Return the times at which a command with the speed 0 was sent, in s."""
    messages = context.messages(topic)
    speeds = messages.field("drive.speed")
    return np.array([t for t, speed in zip(messages.sent_s, speeds) if speed == 0])
