"""Command lines of bubblewrap, which confines one program within a sandbox of its own namespaces.

References
----------
bwrap(1), setpriv(1).
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from confine.namespaces import Form
from confine.room import Room

#: Files of `/etc` that programs need to run.
SETTINGS = ("ld.so.cache", "localtime", "alternatives", "timezone")
#: Folders of programs and libraries, which are links into `/usr` on most systems.
SYSTEM_FOLDERS = ("bin", "sbin", "lib", "lib32", "lib64", "libx32")
#: Folders of `setpriv`, `prlimit` and `env` in a sandbox.
_PATH_OF_TOOLS = "/usr/bin:/bin:/usr/sbin:/sbin"
_NAMESPACES = ("--unshare-pid", "--unshare-ipc", "--unshare-uts", "--unshare-cgroup-try")
#: Capabilities with which `setpriv` changes the user.
_TO_CHANGE_USER = ("SETUID", "SETGID", "SETPCAP")
#: Folders that exist in the sandbox as soon as `/usr` is bound.
_BOUND = ("/usr", "/usr/bin", "/usr/lib", "/usr/local")


def namespace_options(form: Form, old: bool, info_fd: int, seccomp_fd: int) -> list[str]:
    """Return the options for namespaces, privileges and system calls.

    Bubblewrap writes the process id of its child to `info_fd` and reads the filter from `seccomp_fd`. An `old` one
    cannot forbid further user namespaces; the filter does.
    """
    options = ["bwrap", *_NAMESPACES, "--die-with-parent", "--new-session"]
    options += ["--info-fd", str(info_fd), "--hostname", "lab", "--seccomp", str(seccomp_fd)]
    if form is Form.USER:
        options += ["--unshare-user", "--uid", "1000", "--gid", "1000"]
        if not old:
            options.append("--disable-userns")
        return options
    options += ["--cap-drop", "ALL"]
    for name in _TO_CHANGE_USER:
        options += ["--cap-add", f"CAP_{name}"]
    return options


def start_options(cwd: str, uid: int | None) -> list[str]:
    """Return the last options, and the command that takes a user id of its own, if there is one.

    Variables such as LD_PRELOAD or PATH must not reach the programs that still have privileges: the environment of the
    confined program begins after these.
    """
    options = ["--clearenv", "--setenv", "PATH", _PATH_OF_TOOLS, "--chdir", cwd, "--"]
    if uid is not None:
        options += ["setpriv", "--reuid", str(uid), "--regid", str(uid), "--clear-groups"]
        options += ["--inh-caps=-all", "--bounding-set=-all", "--no-new-privs"]
    return options


def file_system_options(room: Room) -> list[str]:
    """Return the options that lay out the file system."""
    layout = _Layout()
    layout.add_system()
    for target, source in room.areas.items():
        layout.bind("--bind", str(source), target)
        layout.made.add(target)
    for target, source in room.tools.items():
        layout.bind("--ro-bind", str(source), target)
    # After these, because a virtual environment may be below /tmp.
    for root in room.roots:
        if not root.is_relative_to("/usr") and str(root) != "/":
            layout.bind("--ro-bind", str(root), str(root))
    for link, link_target in room.links.items():
        if not link.is_relative_to("/usr"):
            layout.bind("--symlink", link_target, str(link))
    layout.cover(room.covered, room.roots)
    return [*layout.options, "--remount-ro", "/"]


class _Layout:
    """Options that bubblewrap follows one after another, and the folders that exist by then."""

    def __init__(self) -> None:
        self.options: list[str] = []
        self.made = {"/"}

    def bind(self, kind: str, source: str, target: str) -> None:
        """Show a file or folder at a path, with folders above it that every user may enter."""
        for parent in reversed(PurePosixPath(target).parents):
            if str(parent) not in self.made:
                self.made.add(str(parent))
                self.options += ["--perms", "0755", "--dir", str(parent)]
        self.options += [kind, source, target]

    def add_system(self) -> None:
        """Show the system's programs and settings, read-only, and make /proc and /dev."""
        self.bind("--ro-bind", "/usr", "/usr")
        self.made.update(_BOUND)
        for name in SYSTEM_FOLDERS:
            path = Path("/") / name
            if path.is_symlink():
                self.options += ["--symlink", str(path.readlink()), str(path)]
            elif path.is_dir():
                self.bind("--ro-bind", str(path), str(path))
        for name in SETTINGS:
            path = Path("/etc") / name
            if path.exists():
                self.bind("--ro-bind", str(path), str(path))
        self.options += ["--proc", "/proc", "--dev", "/dev"]

    def cover(self, folders: Iterable[Path], roots: Iterable[Path]) -> None:
        """Hide folders that are below one of the roots."""
        covering = set(roots)
        for folder in folders:
            if not covering.isdisjoint((folder, *folder.parents)):
                self.options += ["--perms", "0555", "--tmpfs", str(folder)]
                self.options += ["--remount-ro", str(folder)]
