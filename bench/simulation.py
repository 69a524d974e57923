"""How long a class takes by the scheduler's rules, from what one grading took: for classes too large to try.

So many submissions are under way at a time as there may be slots. Each starts, has its sessions recorded, the longest
first, and is judged; each of these holds a slot, and one more is given, one after another, while a part of the cores'
time is idle. What wants more than the cores have all goes on more slowly, except for the time in which it waits for
nothing but a clock.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.load import cores
from grader.classroom.scheduler import MOST_SLOTS, ROOM_S, ROOM_SHARE

#: What a submission's own process takes of a core before its sessions and after them, in s.
_BEFORE, _AFTER = ("start", 0.1, 0.1), ("judging", 0.5, 0.5)
_STEP_S = 0.05
#: What the grader's own processes take beside those that are in a recording.
_UNRECORDED = 1.15


@dataclass
class Piece:
    """A piece of work that holds a slot: how long it takes alone, and what it computes meanwhile."""

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
        used = sum(p["usage"][-1]["cpu_ns"] for p in session["processes"] if p["usage"])
        found.append(
            Piece(
                file.parent.name,
                (session["ended_ns"] - session["started_ns"]) / 1e9,
                _UNRECORDED * used / 1e9,
            )
        )
    return sorted(found, key=lambda piece: -piece.left_s)


def simulate(
    count: int, sessions: Sequence[Piece], slots: int, most: int, core_count: int
) -> float:
    """Return how long a class of so many equal submissions takes, in s."""
    waiting = [_submission(sessions) for _ in range(count)]
    under_way: list[Iterator[list[Piece]]] = []
    ready: list[Piece] = []
    open_pieces: dict[int, list[Piece]] = {}
    running: list[Piece] = []
    now_s = idle = admitted_s = 0.0
    while waiting or open_pieces:
        while waiting and len(under_way) < most:
            under_way.append(waiting.pop())
            _next(under_way[-1], open_pieces, ready)
        while ready and (
            len(running) < slots
            or (len(running) < most and now_s - admitted_s > ROOM_S and idle > ROOM_SHARE)
        ):
            admitted_s = now_s
            running.append(ready.pop(0))
        wanted = sum(piece.share for piece in running)
        pace = min(1.0, core_count / wanted) if wanted else 1.0
        # Over the last second or so.
        idle += (max(0.0, 1 - wanted / core_count) - idle) * _STEP_S
        now_s += _STEP_S
        for piece in running:
            piece.left_s -= _STEP_S * pace
        running = [piece for piece in running if piece.left_s > 0]
        for submission in tuple(under_way):
            if all(piece.left_s <= 0 for piece in open_pieces[id(submission)]):
                del open_pieces[id(submission)]
                if not _next(submission, open_pieces, ready):
                    under_way.remove(submission)
    return now_s


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
    """Print how long classes take on this machine."""
    parser = argparse.ArgumentParser(prog="python -m bench.simulation", description=__doc__)
    parser.add_argument(
        "recordings", type=Path, help="recordings/ of a submission that was graded alone"
    )
    parser.add_argument("--cores", type=int, nargs="+", default=[cores()])
    options = parser.parse_args()
    sessions = pieces_of(options.recordings)
    for number in options.cores:
        for count in (8, 40, 200):
            slots, most = (min(n * number, MOST_SLOTS) for n in (2, 4))
            took_s = simulate(count, sessions, slots, most, number)
            print(
                f"{number} cores, {count} submissions: {took_s / 60:.1f} min, {60 * count / took_s:.1f} a minute"
            )


if __name__ == "__main__":
    main()
