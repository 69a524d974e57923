"""Records sessions with undecided checks again, and keeps the better of two attempts."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING

from grader.recording.session import SESSION_FILE, read_session, write_session
from grader.result import Result

if TYPE_CHECKING:
    from grader.judging.judgement import Judgement

#: Most retries of a session with undecided checks, each alone.
RETRIES = 2
#: Folder of the recordings of a retry, beside the recordings of the attempt before.
_RETRY = ".retry"


def retry_undecided(
    recordings: Path,
    chosen: Sequence[str],
    record: Callable[[Sequence[str], Path, int, frozenset[str]], None],
    judged: Callable[[], Judgement],
) -> Judgement:
    """Judge recordings, and record chosen sessions again, as long as a retry may decide more.

    Parameters
    ----------
    record
        Records sessions into a folder, with the number of the attempt. Its last argument names the sessions with
        interference with the grader.
    judged
        Judges the recordings as they are.
    """
    judgement = judged()
    disturbed: frozenset[str] = frozenset()
    retry = recordings.parent / _RETRY
    recorded = 0
    try:
        for number in range(1, RETRIES + 1):
            disturbed |= _disturbed(judgement.by_rubric)
            undecided = undecided_sessions(judgement.by_rubric, chosen)
            if not undecided:
                break
            # Reading all sessions takes 30 ms, and is of use only here.
            if recorded == 0:
                recorded = _times_recorded(recordings, chosen)
            record(undecided, retry, recorded + number, disturbed)
            judgement = keep_better(recordings, retry, undecided, judgement, judged)
    finally:
        shutil.rmtree(retry, ignore_errors=True)
    return judgement


def _times_recorded(recordings: Path, chosen: Sequence[str]) -> int:
    """Return the greatest number of recordings of a chosen session; 1 without any."""
    most = 1
    for name in chosen:
        folder = recordings / name
        if (folder / SESSION_FILE).is_file():
            most = max(most, read_session(folder).times_recorded)
    return most


def _disturbed(result: Result) -> frozenset[str]:
    """Return the sessions with a recording that the student's programs disturbed."""
    return frozenset(each.session for each in result.violations if each.kind.disturbs)


def undecided_sessions(result: Result, chosen: Sequence[str]) -> list[str]:
    """Return the recorded sessions with a check that another recording may decide."""
    undecided = set()
    for check in result.every_check:
        if check.retry and not check.outcome.decided:
            undecided.add(check.session)
    return [session for session in chosen if session in undecided]


def keep_better(
    recordings: Path,
    retry: Path,
    sessions: Sequence[str],
    before: Judgement,
    judged: Callable[[], Judgement],
) -> Judgement:
    """Put the sessions of a retry in place of the recorded ones, unless more points are undecided then.

    On a busier machine, a decided check must not become undecided.
    """
    _exchange(recordings, retry, sessions)
    try:
        judgement = judged()
    except BaseException:
        _exchange(recordings, retry, sessions)
        raise
    worse = _worse_in(sessions, judgement.by_rubric, before.by_rubric)
    _exchange(recordings, retry, worse)
    for name in worse:
        _note_attempt(recordings / name)
    for name in sessions:
        shutil.rmtree(retry / name)
    return judged() if worse else judgement


def _worse_in(sessions: Collection[str], result: Result, before: Result) -> list[str]:
    """Return the sessions with more undecided points than before."""
    worse = []
    for name in sessions:
        if _undecided_points(result, name) > _undecided_points(before, name):
            worse.append(name)
    return worse


def _note_attempt(folder: Path) -> None:
    """Note in a kept recording that its session was recorded once more."""
    with suppress(OSError, ValueError):
        record = read_session(folder)
        record.attempts = record.times_recorded + 1
        write_session(folder, record)


def _exchange(recordings: Path, retry: Path, sessions: Sequence[str]) -> None:
    """Exchange the recordings of sessions in two folders."""
    for name in sessions:
        backup = retry / f".{name}"
        (recordings / name).rename(backup)
        (retry / name).rename(recordings / name)
        backup.rename(retry / name)


def _undecided_points(result: Result, session: str) -> Decimal:
    """Return the undecided points of the checks of a session."""
    points = Decimal(0)
    for check in result.every_check:
        if check.session == session:
            points += check.undecided
    return points
