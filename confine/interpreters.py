"""Folders and links of the file system that a Python interpreter needs in order to run."""

from __future__ import annotations

import functools
import os
import sys
import sysconfig
from pathlib import Path

#: Python that runs this: not resolved, because a virtual environment is known by its link.
OWN_INTERPRETER = Path(sys.executable)


@functools.cache
def interpreter_roots(interpreter: Path) -> tuple[Path, ...]:
    """Return the folders of an interpreter: its virtual environment and the installation behind it."""
    real = interpreter.resolve().parent.parent
    stdlib = real
    if interpreter == OWN_INTERPRETER:
        stdlib = Path(sysconfig.get_path("stdlib")).parent.parent
    # A link may be anywhere, such as in ~/bin; the other files there must stay hidden.
    linked = [path.parent.parent for path in (interpreter, *_links_of(interpreter))]
    installed = [folder for folder in linked if _is_installation(folder)]
    return tuple(dict.fromkeys([*installed, real, stdlib]))


def interpreter_links(interpreter: Path) -> dict[Path, str]:
    """Return the links to the real program outside of the interpreter's folders, each with its target."""
    roots = interpreter_roots(interpreter)
    links = {}
    for link in _links_of(interpreter):
        if not any(link.is_relative_to(root) for root in roots):
            links[link] = str(link.readlink())
    return links


def _is_installation(folder: Path) -> bool:
    """Return whether a folder is a virtual environment or an installation of Python."""
    if (folder / "pyvenv.cfg").is_file():
        return True
    return any(folder.glob("lib*/python3*"))


def _links_of(interpreter: Path) -> list[Path]:
    """Return the links from an interpreter to the real program, the interpreter first if it is one."""
    links: list[Path] = []
    path = interpreter
    while path.is_symlink() and path not in links:
        links.append(path)
        path = Path(os.path.normpath(path.parent / path.readlink()))
    return links
