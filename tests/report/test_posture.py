"""The player of a motion: its data, read as the page's script reads it, and the still without a script."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from grader.report.figures.posture import Motion, encode, projected
from grader.report.figures.svg import Figure
from tests.report.test_figures import Row, drawn, marks, picture, recorded, shown

TOPICS: dict[str, Any] = {"topics": {"arm": "/is", "commanded": "/wanted"}, "field": "data"}
#: From one posture to the next, in ns.
PERIOD = 40_000_000


def decoded(text: str, width: int) -> list[list[int]]:
    """Read whole numbers as the page's script does: six bits a letter, one of them a mark that more follow."""
    rows: list[list[int]] = []
    row: list[int] = []
    number = shift = 0
    for letter in text:
        six = ord(letter) - 63
        number |= (six & 31) << shift
        shift += 5
        if six & 32:
            continue
        above = rows[-1][len(row)] if rows else 0
        row.append(above + (~(number >> 1) if number & 1 else number >> 1))
        number = shift = 0
        if len(row) == width:
            rows.append(row)
            row = []
    assert not row
    return rows


@given(
    arrays.arrays(
        np.int64,
        st.tuples(st.integers(1, 5), st.integers(1, 4)),
        elements=st.integers(-(2**40), 2**40),
    )
)
def test_whole_numbers_come_back_as_they_were(
    rows: np.ndarray[tuple[int, int], np.dtype[np.int64]],
) -> None:
    """Any rows are written in letters that stand for nothing else in a page, and read again."""
    text = encode(rows)
    assert decoded(text, rows.shape[1]) == rows.tolist()
    assert set(text) <= set(map(chr, range(63, 127)))


def swinging(count: int, first: int = 0, lag: float = 0.0) -> list[Row]:
    """Return postures of a stick of two links of 1 m, which turns about its foot."""
    angles = [0.05 * (n - lag) for n in range(first, count)]
    tips = [(math.sin(angle), math.cos(angle)) for angle in angles]
    found = []
    for n, (x, z) in enumerate(tips):
        found.append(
            (
                n + 1,
                10**9 + (first + n) * PERIOD + (200_000 if first else 0),
                [0, 0, 0, x, 0, z, 2 * x, 0, 2 * z],
            )
        )
    return found


@pytest.fixture
def figure(tmp_path: Path) -> Figure:
    """Give a stick that is commanded from its eleventh posture on, and lags more and more."""
    wanted = swinging(50, first=10)
    wanted[30][2][6] += 0.5
    return shown("posture", recorded(tmp_path, {"/is": swinging(50), "/wanted": wanted}), **TOPICS)


def motion_of(figure: Figure) -> Motion:
    """Return the data of the page's player."""
    assert isinstance(figure.content, Motion)
    return figure.content


def test_the_page_gets_each_posture_at_its_time(figure: Figure) -> None:
    """Times are ms since the session's start, and points have a 4000th of the size; the ghost has the last frames."""
    motion = motion_of(figure)
    rows = decoded(motion.encoded, 1 + 3 * motion.points)
    assert [row[0] for row in rows] == [1000 + 40 * n for n in range(50)]
    assert rows[10][1:] == [round(1000 * value) for value in swinging(50)[10][2]]
    ghosts = decoded(motion.encoded_ghost, 3 * motion.points)
    assert len(ghosts) == 40
    assert ghosts[0] == rows[10][1:]


def test_the_jump_to_the_first_command_is_no_distance(tmp_path: Path) -> None:
    """A resting robot is far from its first command, through no fault of the commands."""
    wanted = swinging(50, first=10)
    wanted[0][2][6] += 1.5
    wanted[30][2][6] += 0.5
    motions = {"/is": swinging(50), "/wanted": wanted}
    figure = shown("posture", recorded(tmp_path, motions), **TOPICS)
    assert motion_of(figure).still == 40
    assert "at 2.60 s: 500 mm" in figure.caption


def test_the_still_is_where_the_tip_is_farthest_from_its_command(figure: Figure) -> None:
    """The picture without a script has links, joints and ghost of that moment, and the caption says how far it is."""
    assert figure.caption == (
        "From 1 s after the first command on, the tip is farthest from its commanded position at 2.60 s: 500 mm."
    )
    motion = motion_of(figure)
    assert motion.still == 40
    links, places = marks(figure, "link"), projected(motion.solid[40])
    ends = []
    for link in links:
        ends.append([float(link.get(key) or 0) for key in ("x1", "y1", "x2", "y2")])
    assert ends == pytest.approx(np.hstack((places[:-1], places[1:])), abs=0.1)
    (ghost,) = marks(figure, "ghost")
    assert len((ghost.get("points") or "").split()) == motion.points
    assert "nan" not in str(figure.svg("f", motion.width))
    assert figure.key == (("line-0", "arm"), ("line-1", "commanded"))


def test_what_nobody_commands_has_no_ghost(tmp_path: Path) -> None:
    """Without a command the robot is shown as it stood, and the caption says so."""
    figure = shown("posture", recorded(tmp_path, {"/is": swinging(9)}), **TOPICS)
    assert (
        figure.caption
        == "There is no ghost, because this recording holds no commanded points to draw."
    )
    assert motion_of(figure).encoded_ghost == ""
    assert [ghost.get("points") for ghost in marks(figure, "ghost")] == [""]


def test_a_long_motion_is_thinned(tmp_path: Path) -> None:
    """Minutes of postures become as many as a page can carry, first and last among them, each with its own ghost."""
    rows = swinging(5000)
    wanted = [(number, time_ns + 1000, row) for number, time_ns, row in rows]
    motion = motion_of(
        shown("posture", recorded(tmp_path, {"/is": rows, "/wanted": wanted}), **TOPICS)
    )
    assert len(motion.times_ms) == 360
    assert (motion.times_ms[0], motion.times_ms[-1]) == (1000, 1000 + 40 * 4999)
    assert (motion.solid == motion.ghost).all()


@pytest.mark.parametrize(
    "rows",
    [
        [(1, 10**9, [0.0] * 6)],
        [(n + 1, 10**9 + n * PERIOD, [0.0] * 7) for n in range(9)],
        [(n + 1, 10**9 + n * PERIOD, [0.0] * 3) for n in range(9)],
        [(n + 1, 10**9 + n * PERIOD, [0.0] * 300) for n in range(9)],
        [(n + 1, 10**9 + n * PERIOD, [1e308] * 6) for n in range(9)],
    ],
    ids=["one posture", "no points", "one point", "too many points", "far away"],
)
def test_what_is_no_motion_is_not_shown(tmp_path: Path, rows: list[Row]) -> None:
    """A page has no player for a motion that cannot be drawn."""
    assert drawn("posture", recorded(tmp_path, {"/is": rows}), **TOPICS) is None


def test_a_stick_that_stands_still_can_be_drawn(tmp_path: Path) -> None:
    """All points in one place are a picture of no size, and no error."""
    rows: list[Row] = [(n + 1, 10**9 + n * PERIOD, [0.5] * 6) for n in range(9)]
    figure = shown("posture", recorded(tmp_path, {"/is": rows, "/wanted": rows}), **TOPICS)
    assert "nan" not in str(figure.svg("f", motion_of(figure).width))
    assert picture(figure).get("role") == "img"
