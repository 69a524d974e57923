"""Time of the last commit of a git repository.

`git` itself is not called, because a student's repository can configure it to run programs.
"""

from __future__ import annotations

from contextlib import suppress
from datetime import datetime, timedelta, timezone
from pathlib import Path

from grader.bounded import Bound, in_process
from grader.errors import BoundError

#: Bounds for reading a commit, which takes 10 ms; damaged objects, and named pipes instead of files, would never end.
_BOUND = Bound(what="reading the last commit", cpu_s=2.0, wall_s=3.0, memory_bytes=1024**3)


def last_commit_time(folder: Path) -> datetime | None:
    """Return the time of the current commit, by its committer's clock; None if there is none.

    Only repositories at the root of the working tree are read (no worktrees, no links).
    """
    with suppress(OSError, BoundError):
        if (folder / ".git").is_dir() and not (folder / ".git").is_symlink():
            from dulwich.objects import Commit
            from dulwich.repo import Repo

            def committed() -> datetime | None:
                # A damaged repository has no time.
                with suppress(Exception), Repo(str(folder)) as repository:
                    commit = repository[repository.head()]
                    if isinstance(commit, Commit):
                        zone = timezone(timedelta(seconds=commit.commit_timezone))
                        return datetime.fromtimestamp(commit.commit_time, zone)
                return None

            return in_process(committed, _BOUND)
    return None
