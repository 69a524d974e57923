"""When the last commit of a git repository was made.

`git` itself is not asked: a repository's configuration, which is the student's, can make it run programs.
"""

from __future__ import annotations

from contextlib import suppress
from datetime import datetime, timedelta, timezone
from pathlib import Path

from grader.bounded import Bound, in_process
from grader.errors import BoundError

#: A commit is read in some 10 ms; damaged objects and named pipes in the place of files would never end.
_BOUND = Bound(what="reading the last commit", cpu_s=2.0, wall_s=3.0, memory_bytes=1024**3)


def last_commit_time(folder: Path) -> datetime | None:
    """Return the time of the commit that is checked out, as its committer's clock said; None if there is none.

    Repositories that lie elsewhere than at the root of the working tree (worktrees, links) are not looked for.
    """
    with suppress(OSError, BoundError):
        if (folder / ".git").is_dir() and not (folder / ".git").is_symlink():
            from dulwich.objects import Commit
            from dulwich.repo import Repo

            def committed() -> datetime | None:
                # Whatever a damaged repository makes of the reader, it has no time.
                with suppress(Exception), Repo(str(folder)) as repository:
                    commit = repository[repository.head()]
                    if isinstance(commit, Commit):
                        zone = timezone(timedelta(seconds=commit.commit_timezone))
                        return datetime.fromtimestamp(commit.commit_time, zone)
                return None

            return in_process(committed, _BOUND)
    return None
