"""Deadlines that leave out the time during which nobody looked."""

from __future__ import annotations

from grader.live.ros_node.deadline import Deadline


def looks(timeout_s: float, *times_s: float) -> list[bool]:
    """Start at the first time and look at each other one; returns if the time was over there."""
    clock = iter(times_s)
    deadline = Deadline(timeout_s, lambda: next(clock))
    return [deadline.passed() for _ in times_s[1:]]


def test_a_deadline_passes_when_its_time_is_over() -> None:
    """A deadline passes on time for a caller that looks often enough."""
    assert looks(0.3, 0.0, 0.1, 0.2, 0.31) == [False, False, True]


def test_the_time_in_which_nobody_looked_does_not_count() -> None:
    """A caller that stalled for longer than the whole time may look again.

    The awaited thing may have come meanwhile.
    """
    assert looks(3.0, 0.0, 0.1, 5.1, 5.2, *(5.2 + 0.2 * n for n in range(1, 15))) == [
        False
    ] * 16 + [True]


def test_standing_still_is_left_out_up_to_a_limit() -> None:
    """Something that is slow for ever does not wait for ever."""
    assert looks(3.0, 0.0, 9.0, 12.5) == [False, True]


def test_the_time_left_is_told() -> None:
    """A caller sleeps no longer than the time left, which stalls leave as it is."""
    clock = iter([0.0, 0.1, 5.1, 5.2])
    deadline = Deadline(0.3, lambda: next(clock))
    left_s = []
    for _ in range(3):
        deadline.passed()
        left_s.append(round(deadline.left_s, 3))
    assert left_s == [0.2, 0.2, 0.1]
