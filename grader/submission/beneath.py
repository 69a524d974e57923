"""Opens what somebody else has named, by descriptors: never anything outside of the folder in which it was named.

Paths that come out of a launch plan, an archive, a repository or a workspace are a student's, and what they lead to
may change between two looks at it. So no such path is looked at first and used afterwards: it is opened a folder at a
time, each beneath the one before and none over a link, and what is done is done to what was opened (openat(2)).
"""

from __future__ import annotations

import errno
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path, PurePath, PurePosixPath

_CLOSED_ON_EXEC = getattr(os, "O_CLOEXEC", 0)
_FOLDER = getattr(os, "O_DIRECTORY", 0) | _CLOSED_ON_EXEC
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_FOLDER_BY_NAME = getattr(os, "O_PATH", os.O_RDONLY) | _FOLDER | _NO_LINK
#: Without waiting for a pipe's other end, and without becoming a terminal's owner.
_WITHOUT_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)
#: Folders within each other that are copied: nobody's workspace has more, and each takes a descriptor.
_DEEPEST = 100
#: What the kernel says of a name that is gone, or that is a link, a folder, a pipe or none of it by now.
_CHANGED = (
    errno.ENOENT,
    errno.ENOTDIR,
    errno.ELOOP,
    errno.ENXIO,
    errno.EINVAL,
    errno.EISDIR,
    errno.EEXIST,
)


def open_beneath(
    top: int | Path, path: str | PurePath, flags: int = os.O_RDONLY, mode: int = 0
) -> int:
    """Open what somebody else has named beneath a folder, which is open or a path of the grader's own.

    It raises `OSError` if that cannot be opened, and where the path is absolute, has a step upwards or leads over a
    link.
    """
    *way, last = _parts(path) or ["."]
    with ExitStack() as opened:
        folder = opened.enter_context(_opened(top))
        for part in way:
            folder = os.open(part, _FOLDER_BY_NAME, dir_fd=folder)
            opened.pop_all().close()
            opened.callback(os.close, folder)
        found = os.open(last, flags | _NO_LINK | _CLOSED_ON_EXEC, mode, dir_fd=folder)
    if stat.S_ISLNK(os.fstat(found).st_mode):  # O_PATH opens the link itself.
        os.close(found)
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), last)
    return found


def _parts(path: str | PurePath) -> list[str]:
    found = PurePosixPath(path)
    if found.is_absolute() or ".." in found.parts or "\0" in str(path):
        raise OSError(errno.EXDEV, "this path leads outside of its folder", str(path))
    return list(found.parts)


def _opened(top: int | Path) -> AbstractContextManager[int]:
    return (
        nullcontext(top) if isinstance(top, int) else _closing(os.open(top, os.O_RDONLY | _FOLDER))
    )


@contextmanager
def _closing(file: int) -> Iterator[int]:
    try:
        yield file
    finally:
        os.close(file)


def open_regular_beneath(top: int | Path, path: str | PurePath) -> int:
    """Open a regular file beneath a folder for reading, without waiting for anything, or raise `OSError`."""
    file = open_beneath(top, path, os.O_RDONLY | _WITHOUT_WAITING)
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise OSError(errno.EINVAL, "not a regular file", str(path))
    return file


def is_regular_beneath(top: Path, path: str | PurePath) -> bool:
    """Whether there is a regular file beneath a folder."""
    try:
        os.close(open_regular_beneath(top, path))
    except OSError:
        return False
    return True


def restore_way(top: Path, folder: PurePosixPath, rights: int) -> None:
    """See to it that a folder is there, and that all folders on the way to it have some rights at least.

    It raises `OSError` if that cannot be done beneath `top`: what stands in the way is no folder.
    """
    with ExitStack() as opened:
        here = os.open(top, os.O_PATH | _FOLDER)
        opened.callback(os.close, here)
        for part in (*_parts(folder), None):
            own = f"/proc/self/fd/{here}"  # what is open, wherever its name leads by now
            mode = stat.S_IMODE(os.stat(own).st_mode)  # noqa: PTH116
            if mode & rights != rights:
                os.chmod(own, mode | rights)  # noqa: PTH101
            if part is None:
                return
            with suppress(FileExistsError):
                os.mkdir(part, rights, dir_fd=here)
            here = open_beneath(here, part, os.O_PATH | _FOLDER)
            opened.callback(os.close, here)


def copy_tree(source: Path, target: Path, owner: int | None = None) -> None:
    """Copy a folder's files, folders and links into a folder, while somebody else may be changing the source.

    Links are copied as links; what is neither, and folders too deep, are left out. The copies belong to `owner`.
    """
    with _opened(source) as here, _opened(target) as there:
        _copy_below(here, there, owner, _DEEPEST)


def _copy_below(source: int, target: int, owner: int | None, depth: int) -> None:
    _hand_over(target, 0o755, owner)
    with os.scandir(source) as entries:
        names = [
            (entry.name, entry.is_symlink(), entry.is_dir(follow_symlinks=False))
            for entry in entries
        ]
    for name, is_link, is_folder in names:
        with _unless_it_changed():
            if is_link:
                os.symlink(os.readlink(name, dir_fd=source), name, dir_fd=target)
            elif not is_folder:
                _copy_file(source, name, target, owner)
            elif depth:
                os.mkdir(name, 0o700, dir_fd=target)
                with _folder(source, name) as here, _folder(target, name) as there:
                    _copy_below(here, there, owner, depth - 1)


def _folder(above: int, name: str) -> AbstractContextManager[int]:
    return _closing(open_beneath(above, name, os.O_RDONLY | _FOLDER))


@contextmanager
def _unless_it_changed() -> Iterator[None]:
    """Pass over what is gone by now, or something else than it was."""
    try:
        yield
    except OSError as error:
        if error.errno not in _CHANGED:
            raise


def _copy_file(source: int, name: str, target: int, owner: int | None) -> None:
    with os.fdopen(open_regular_beneath(source, name), "rb") as read:
        there = open_beneath(target, name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(there, "wb") as written:
            shutil.copyfileobj(read, written, 1024 * 1024)
            _hand_over(there, stat.S_IMODE(os.fstat(read.fileno()).st_mode) & 0o777 | 0o644, owner)


def _hand_over(file: int, mode: int, owner: int | None) -> None:
    os.fchmod(file, mode)
    if owner is not None:
        os.fchown(file, owner, owner)
