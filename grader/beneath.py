"""Opens what somebody else has named, by descriptors: never anything outside of the folder in which it was named.

Paths that come out of a launch plan, an archive, a repository or a workspace are a student's, and what they lead to
may change between two looks at it. So no such path is looked at first and used afterwards: the kernel resolves it
beneath a folder that is open already, follows no link on the way, and what is done is done to what it has opened.

References
----------
openat2(2), path_resolution(7).
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path, PurePath, PurePosixPath

#: The call's number on every architecture, and RESOLVE_NO_MAGICLINKS | RESOLVE_NO_SYMLINKS | RESOLVE_BENEATH.
_OPENAT2, _RESOLVE = 437, 0x02 | 0x04 | 0x08
#: Where the kernel does not have the call (before Linux 5.6), and where a container's filter does not know it.
_NOT_THERE = (errno.ENOSYS, errno.EPERM)
#: Looked up now: after a fork, the loader's lock may be held by a thread that is no more.
_syscall: Callable[..., int] | None = ctypes.CDLL(None, use_errno=True).syscall if sys.platform == "linux" else None
_FOLDER = getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_CLOEXEC", 0)
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
#: Without waiting for a pipe's other end, and without becoming a terminal's owner.
_WITHOUT_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_CLOEXEC", 0)
#: Folders within each other that are copied: nobody's workspace has more, and each takes a descriptor.
_DEEPEST = 100
#: What the kernel says of a name that is gone, or that is a link, a folder, a pipe or none of it by now.
_CHANGED = (errno.ENOENT, errno.ENOTDIR, errno.ELOOP, errno.ENXIO, errno.EINVAL, errno.EISDIR, errno.EEXIST)


class _How(ctypes.Structure):
    """The kernel's `struct open_how`."""

    _fields_ = (("flags", ctypes.c_uint64), ("mode", ctypes.c_uint64), ("resolve", ctypes.c_uint64))


def open_beneath(top: int | Path, path: str | PurePath, flags: int = os.O_RDONLY, mode: int = 0) -> int:
    """Open a file or folder beneath a folder; returns its descriptor.

    Parameters
    ----------
    top : int or Path
        The folder: open, or a path of the grader's own.
    path : str or PurePath
        Written by somebody else.

    Raises
    ------
    OSError
        If it cannot be opened, and where it is absolute, has a step upwards or leads over a link.
    """
    with _opened(top) as folder:
        parts = _parts(path)
        try:
            return _openat2(folder, "/".join(parts) or ".", flags, mode)
        except OSError as error:
            if error.errno not in _NOT_THERE:
                raise
        return _walk(folder, parts or ["."], flags, mode)


def _parts(path: str | PurePath) -> list[str]:
    parts = list(PurePosixPath(path).parts)
    if parts[:1] == ["/"] or ".." in parts or "\0" in str(path):
        raise OSError(errno.EXDEV, "this path leads outside of its folder", str(path))
    return parts


@contextmanager
def _opened(top: int | Path) -> Iterator[int]:
    if isinstance(top, int):
        yield top
        return
    folder = os.open(top, os.O_RDONLY | _FOLDER)
    try:
        yield folder
    finally:
        os.close(folder)


def _openat2(folder: int, path: str, flags: int, mode: int) -> int:
    how = _How(flags | getattr(os, "O_CLOEXEC", 0), mode, _RESOLVE)
    if _syscall is None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))
    size = ctypes.c_size_t(ctypes.sizeof(how))
    found = _syscall(ctypes.c_long(_OPENAT2), ctypes.c_int(folder), os.fsencode(path), ctypes.byref(how), size)
    if found < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number), path)
    return found


def _walk(folder: int, parts: list[str], flags: int, mode: int) -> int:
    """Do as `openat2`, a folder at a time."""
    with ExitStack() as opened:
        for part in parts[:-1]:
            folder = os.open(part, os.O_RDONLY | _FOLDER | _NO_LINK, dir_fd=folder)
            opened.callback(os.close, folder)
        found = os.open(parts[-1], flags | _NO_LINK, mode, dir_fd=folder)
    if stat.S_ISLNK(os.fstat(found).st_mode):  # O_PATH opens the link itself.
        os.close(found)
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), parts[-1])
    return found


def open_regular_beneath(top: int | Path, path: str | PurePath) -> int:
    """Open a file beneath a folder for reading, if it is a regular one, without waiting for anything.

    Raises
    ------
    OSError
        If it is none, may not be read, or lies elsewhere.
    """
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

    Raises
    ------
    OSError
        If it cannot be done beneath `top`: what stands in the way is no folder.
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

    Links are copied as links. What is neither, and folders beyond a depth that nobody has, are left out.

    Parameters
    ----------
    owner : int or None
        User and group that the copies shall belong to.
    """
    with _opened(source) as here, _opened(target) as there:
        _copy_below(here, there, owner, _DEEPEST)


def _copy_below(source: int, target: int, owner: int | None, depth: int) -> None:
    _hand_over(target, 0o755, owner)
    with os.scandir(source) as entries:
        names = [(entry.name, entry.is_symlink(), entry.is_dir(follow_symlinks=False)) for entry in entries]
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


@contextmanager
def _folder(above: int, name: str) -> Iterator[int]:
    found = open_beneath(above, name, os.O_RDONLY | _FOLDER)
    try:
        yield found
    finally:
        os.close(found)


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
