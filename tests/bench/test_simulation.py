"""Durations of class runs under the scheduler's rules."""

from __future__ import annotations

import pytest

from bench.simulation import Piece, simulate

SESSIONS = [Piece("long", 10.0, 1.0), Piece("short", 5.0, 1.0)]


def test_one_submission_takes_as_long_as_its_longest_session() -> None:
    """A submission's start and judging come before and after its sessions."""
    assert simulate(1, SESSIONS, 4, 8, 2) == pytest.approx(0.1 + 10.0 + 0.5, abs=0.3)


def test_with_one_slot_one_thing_follows_another() -> None:
    """Nothing overlaps, however many cores there are."""
    assert simulate(3, SESSIONS, 1, 1, 8) == pytest.approx(3 * (0.1 + 15.0 + 0.5), abs=1.0)


def test_cores_that_are_all_in_use_bound_a_class() -> None:
    """More slots do not speed up programs that always compute; twice the cores halve the time."""
    busy = [Piece("busy", 4.0, 4.0)]
    one, more, twice = (simulate(20, busy, *given) for given in ((2, 2, 1), (8, 8, 1), (8, 8, 2)))
    assert one == pytest.approx(more, rel=0.05)
    assert one == pytest.approx(2 * twice, rel=0.1)
