"""Records sessions again whose checks are undecided, and keeps the better of two attempts."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
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
#: Beside the recordings, where a retry is recorded.
_RETRY = ".retry"


def retry_undecided(
    recordings: Path,
    chosen: Sequence[str],
    record: Callable[[Sequence[str], Path, int, frozenset[str]], None],
    judged: Callable[[], Judgement],
) -> Judgement:
    """Judge recordings, and record sessions again, of those chosen, as long as that may decide more.

    `record` is given the sessions, the folder, the attempt's number, and in which the grader was interfered with.
    """
    judgement = judged()
    disturbed: frozenset[str] = frozenset()
    retry = recordings.parent / _RETRY
    kept = [
        read_session(recordings / name)
        for name in chosen
        if (recordings / name / SESSION_FILE).is_file()
    ]
    recorded = max((session.times_recorded for session in kept), default=1)
    try:
        for attempt in range(recorded + 1, recorded + RETRIES + 1):
            disturbed |= {v.session for v in judgement.by_rubric.violations if v.kind.disturbs}
            if not (undecided := undecided_sessions(judgement.by_rubric, chosen)):
                break
            record(undecided, retry, attempt, disturbed)
            judgement = keep_better(recordings, retry, undecided, judgement, judged)
    finally:
        shutil.rmtree(retry, ignore_errors=True)
    return judgement


def undecided_sessions(result: Result, chosen: Sequence[str]) -> list[str]:
    """Return the recorded sessions with a check whose outcome the recording leaves open."""
    undecided = {
        check.session for check in result.every_check if not check.outcome.decided and check.retry
    }
    return [session for session in chosen if session in undecided]


def keep_better(
    recordings: Path,
    retry: Path,
    sessions: Sequence[str],
    before: Judgement,
    judged: Callable[[], Judgement],
) -> Judgement:
    """Put what was recorded again in its place, unless it leaves more undecided than what lies there.

    On a machine that is busier the second time, what was decided before must not become undecided.
    """
    _exchange(recordings, retry, sessions)
    try:
        judgement = judged()
    except BaseException:
        _exchange(recordings, retry, sessions)
        raise
    after, earlier = judgement.by_rubric, before.by_rubric
    worse = [
        name
        for name in sessions
        if _undecided_points(after, name) > _undecided_points(earlier, name)
    ]
    _exchange(recordings, retry, worse)
    for name in (
        worse
    ):  # In the recording that is kept, it is noted that its session was recorded once more.
        with suppress(OSError, ValueError):
            record = read_session(recordings / name)
            record.attempts = record.times_recorded + 1
            write_session(recordings / name, record)
    for name in sessions:
        shutil.rmtree(retry / name)
    return judged() if worse else judgement


def _exchange(recordings: Path, retry: Path, sessions: Sequence[str]) -> None:
    for name in sessions:
        backup = retry / f".{name}"
        (recordings / name).rename(backup)
        (retry / name).rename(recordings / name)
        backup.rename(retry / name)


def _undecided_points(result: Result, session: str) -> Decimal:
    return sum(
        (check.undecided for check in result.every_check if check.session == session), Decimal(0)
    )
