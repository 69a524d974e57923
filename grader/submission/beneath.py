"""Opening of files by untrusted paths, through descriptors: never outside of a given folder.

Paths in a launch plan, an archive, a repository or a workspace come from a student, and their targets can change between
two accesses. Therefore no such path is checked first and used afterwards: each folder on it is opened beneath the
previous one, without following links, and all work is done on the open descriptor (openat(2)).
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
#: Folders within each other that are copied: more than any workspace has. Each takes a descriptor.
_DEEPEST = 100
#: Errors of the kernel for a name that is gone, or that became a link, a folder, a pipe or a file.
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
    """Open an untrusted path beneath a folder, given as a descriptor or as a trusted path.

    Raises OSError if it cannot be opened, or if the path is absolute, has a step upwards, or has a link on its way.
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
    is_outside = found.is_absolute() or ".." in found.parts
    if is_outside or "\0" in str(path):
        raise OSError(errno.EXDEV, "this path leads outside of its folder", str(path))
    return list(found.parts)


def _opened(top: int | Path) -> AbstractContextManager[int]:
    if isinstance(top, int):
        return nullcontext(top)
    return _closing(os.open(top, os.O_RDONLY | _FOLDER))


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
    """Return whether there is a regular file at an untrusted path beneath a folder."""
    try:
        os.close(open_regular_beneath(top, path))
    except OSError:
        return False
    return True


def restore_way(top: Path, folder: PurePosixPath, rights: int) -> None:
    """Make a folder beneath another one, and give all folders on its way at least some rights.

    Raises OSError if this is impossible, for example because a file is in the way.
    """
    with ExitStack() as opened:
        here = os.open(top, os.O_PATH | _FOLDER)
        opened.callback(os.close, here)
        for part in (*_parts(folder), None):
            # The open folder, even if its name has a new target.
            own = f"/proc/self/fd/{here}"
            mode = stat.S_IMODE(os.stat(own).st_mode)  # noqa: PTH116
            if mode & rights != rights:
                os.chmod(own, mode | rights)  # noqa: PTH101
            if part is None:
                return
            with suppress(FileExistsError):
                os.mkdir(part, rights, dir_fd=here)
            here = open_beneath(here, part, os.O_PATH | _FOLDER)
            opened.callback(os.close, here)


def copy_tree(source: int | Path, target: Path, owner: int | None = None) -> None:
    """Copy a folder's files, folders and links into another folder, while the source may change.

    Links are copied as links; special files, and folders too deep, are left out. The copies belong to `owner`.
    """
    with _opened(source) as here, _opened(target) as there:
        _copy_below(here, there, owner, _DEEPEST)


def _copy_below(source: int, target: int, owner: int | None, depth: int) -> None:
    _hand_over(target, 0o755, owner)
    with os.scandir(source) as entries:
        listed = list(entries)
    for entry in listed:
        name = entry.name
        with _unless_it_changed():
            if entry.is_symlink():
                os.symlink(os.readlink(name, dir_fd=source), name, dir_fd=target)
            elif not entry.is_dir(follow_symlinks=False):
                _copy_file(source, name, target, owner)
            elif depth:
                os.mkdir(name, 0o700, dir_fd=target)
                with _folder(source, name) as here, _folder(target, name) as there:
                    _copy_below(here, there, owner, depth - 1)


def _folder(above: int, name: str) -> AbstractContextManager[int]:
    return _closing(open_beneath(above, name, os.O_RDONLY | _FOLDER))


@contextmanager
def _unless_it_changed() -> Iterator[None]:
    """Ignore an entry that is gone, or became something else."""
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
            mode = stat.S_IMODE(os.fstat(read.fileno()).st_mode)
            _hand_over(there, mode & 0o777 | 0o644, owner)


def _hand_over(file: int, mode: int, owner: int | None) -> None:
    os.fchmod(file, mode)
    if owner is not None:
        os.fchown(file, owner, owner)
