"""Simulates the scheduler, to predict the time of a class from one grading, for classes too large to try.

As many submissions are under way as there may be slots. Each submission starts, has its sessions recorded, the longest
first, and is judged. Each of these pieces holds a slot. While a part of the cores' time is idle, spare slots are given
one after another. If the pieces want more than all cores, they all slow down.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.load import cores
from grader.classroom.scheduler import MOST_SLOTS, ROOM_S, ROOM_SHARE

#: Work of a submission's own process before and after its sessions: name, time and CPU time in s.
_BEFORE, _AFTER = ("start", 0.1, 0.1), ("judging", 0.5, 0.5)
_STEP_S = 0.05
#: Factor for CPU time of the grader's processes outside of a recording.
_UNRECORDED = 1.15


@dataclass
class Piece:
    """A piece of work in a slot: its name, its remaining time when alone, and its CPU time, both in s."""

    what: str
    left_s: float
    cpu_s: float

    def __post_init__(self) -> None:
        self.share = min(1.0, self.cpu_s / self.left_s)


def pieces_of(recordings: Path) -> list[Piece]:
    """Return the sessions of a recorded submission, the longest first."""
    found = []
    for file in recordings.glob("*/session.json"):
        session = json.loads(file.read_text(encoding="utf-8"))
        used_ns = sum(p["usage"][-1]["cpu_ns"] for p in session["processes"] if p["usage"])
        took_s = (session["ended_ns"] - session["started_ns"]) / 1e9
        found.append(Piece(file.parent.name, took_s, _UNRECORDED * used_ns / 1e9))
    return sorted(found, key=lambda piece: -piece.left_s)


def simulate(
    count: int, sessions: Sequence[Piece], slots: int, most: int, core_count: int
) -> float:
    """Return the time of a class of equal submissions, in s.

    `slots` are given at once, and up to `most` while cores are idle.
    """
    waiting = [_submission(sessions) for _ in range(count)]
    under_way: list[Iterator[list[Piece]]] = []
    ready: list[Piece] = []
    open_pieces: dict[int, list[Piece]] = {}
    running: list[Piece] = []
    now_s = idle = admitted_s = 0.0
    while waiting or open_pieces:
        for _ in waiting[: most - len(under_way)]:
            under_way.append(waiting.pop())
            _next(under_way[-1], open_pieces, ready)
        has_room = now_s - admitted_s > ROOM_S and idle > ROOM_SHARE
        if _admit(ready, running, slots, most if has_room else slots):
            admitted_s = now_s
        wanted = sum(piece.share for piece in running)
        pace = min(1.0, core_count / wanted) if wanted else 1.0
        # The average of about the last second.
        unused = max(0.0, 1 - wanted / core_count)
        idle += (unused - idle) * _STEP_S
        now_s += _STEP_S
        for piece in running:
            piece.left_s -= _STEP_S * pace
        running = [piece for piece in running if piece.left_s > 0]
        _go_on(under_way, open_pieces, ready)
    return now_s


def _admit(ready: list[Piece], running: list[Piece], slots: int, most: int) -> bool:
    """Move pieces to the free slots, or one piece to a spare slot; returns True if a piece was moved."""
    free = slots - len(running)
    if free <= 0 and len(running) < most:
        free = 1
    begun = ready[: max(0, free)]
    del ready[: len(begun)]
    running += begun
    return bool(begun)


def _go_on(
    under_way: list[Iterator[list[Piece]]],
    open_pieces: dict[int, list[Piece]],
    ready: list[Piece],
) -> None:
    """Begin the next pieces of submissions with finished pieces, and drop finished submissions."""
    for submission in tuple(under_way):
        if any(piece.left_s > 0 for piece in open_pieces[id(submission)]):
            continue
        del open_pieces[id(submission)]
        if not _next(submission, open_pieces, ready):
            under_way.remove(submission)


def _submission(sessions: Sequence[Piece]) -> Iterator[list[Piece]]:
    yield [Piece(*_BEFORE)]
    yield [Piece(piece.what, piece.left_s, piece.cpu_s) for piece in sessions]
    yield [Piece(*_AFTER)]


def _next(
    submission: Iterator[list[Piece]], open_pieces: dict[int, list[Piece]], ready: list[Piece]
) -> bool:
    pieces = next(submission, None)
    if pieces is not None:
        open_pieces[id(submission)] = pieces
        ready += pieces
    return pieces is not None


def main() -> None:
    """Print the times of classes of three sizes."""
    parser = argparse.ArgumentParser(prog="python -m bench.simulation", description=__doc__)
    parser.add_argument("recordings", type=Path, help="recordings/ of a submission graded alone")
    parser.add_argument("--cores", type=int, nargs="+", default=[cores()])
    options = parser.parse_args()
    sessions = pieces_of(options.recordings)
    for number in options.cores:
        for count in (8, 40, 200):
            slots = min(2 * number, MOST_SLOTS)
            most = min(4 * number, MOST_SLOTS)
            took_s = simulate(count, sessions, slots, most, number)
            print(
                f"{number} cores, {count} submissions: {took_s / 60:.1f} min, {60 * count / took_s:.1f} a minute"
            )


if __name__ == "__main__":
    main()
