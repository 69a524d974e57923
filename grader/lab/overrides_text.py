"""Adding and removing of entries in the text of `overrides.yaml`; the other text stays as people wrote it.

An entry is added at the end, and removed by its lines. Comments, order and spelling of other entries survive.
"""

from __future__ import annotations

import os
import textwrap
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import yaml

from grader.errors import RubricError
from grader.files import replace_file
from grader.lab.overrides import is_blank
from grader.lab.yaml_with_lines import parse_yaml
from grader.result_folder import OVERRIDES_FILE

_KEY = "overrides"
_HEAD = "# Decisions of people; `grade regrade --help` shows what entries look like.\n"
_INDENT = 2
_SEQUENCE = "tag:yaml.org,2002:seq"
#: More than the length of any line of an entry; each value is on the line of its key.
_ONE_LINE = 2**20


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder's file of overrides; waits while another process holds it."""
    # Windows has no such module.
    import fcntl

    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def rewrite(path: Path, change: Callable[[str], str]) -> str:
    """Change the text of a file of overrides, or of a new one, within `locked`; returns the new text."""
    text = ""
    if path.exists():
        text = path.read_text(encoding="utf-8")
    text = change(text)
    replace_file(path, text)
    return text


class _Dumper(yaml.SafeDumper):
    """Writes an entry as people do: a line for each key, and all names in one line."""


_Dumper.add_representer(
    list, lambda dumper, names: dumper.represent_sequence(_SEQUENCE, names, flow_style=True)
)


def with_entry(text: str, entry: Mapping[str, Any]) -> str:
    """Return the text with an entry at its end; raises RubricError if its list is in one line."""
    listed = _entries(text)
    new = yaml.dump(
        dict(entry), Dumper=_Dumper, allow_unicode=True, sort_keys=False, width=_ONE_LINE
    )
    column = _INDENT
    if listed is None:
        kept = f"{text or _HEAD}{_ended(text)}{_KEY}:\n"
    elif listed.value:
        kept = text
        column = listed.start_mark.column
    else:
        # An empty list can be written as [].
        before = text[: listed.start_mark.index].rstrip(" ")
        kept = before + text[listed.end_mark.index :]
    wanted = [*_plain(text), dict(entry)]
    return _checked(f"{kept}{_ended(kept)}{_listed(new, column)}", wanted)


def without_entry(text: str, number: int) -> str:
    """Return the text without one of several entries, counted from 0; raises as `with_entry`."""
    listed = _entries(text)
    assert listed is not None
    node = listed.value[number]
    lines = text.splitlines(keepends=True)
    del lines[node.start_mark.line : _last_line(node) + 1]
    wanted = _plain(text)
    del wanted[number]
    return _checked("".join(lines), wanted)


def _entries(text: str) -> Any:
    """Return the node of the list, None if there is no list yet."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    if isinstance(root, yaml.MappingNode):
        for key, value in root.value:
            if key.value == _KEY:
                return value
    return None


def _plain(text: str) -> list[Any]:
    """Return the entries of a text as plain data."""
    if is_blank(text):
        return []
    plain, _ = parse_yaml(Path(OVERRIDES_FILE), text, "the file of overrides")
    return list(plain.get(_KEY) or [])


def _checked(text: str, wanted: list[Any]) -> str:
    """Return a new text if it has exactly the wanted entries; raises RubricError otherwise."""
    with suppress(RubricError):
        if _plain(text) == wanted:
            return text
    problem = f"{OVERRIDES_FILE} is written in a way that no entry can be added to or taken from by a program"
    raise RubricError(
        problem, [], remedy="Write each entry of its list below the others, with a dash before it."
    )


def _last_line(node: yaml.Node) -> int:
    """Return the last line of a node, from 0."""
    if isinstance(node, yaml.MappingNode) and not node.flow_style:
        lines = [max(map(_last_line, pair)) for pair in node.value]
        return max(lines)
    if isinstance(node, yaml.SequenceNode) and not node.flow_style:
        return max(map(_last_line, node.value))
    end = node.end_mark
    return int(end.line - (end.column == 0))


def _ended(text: str) -> str:
    if not text or text.endswith("\n"):
        return ""
    return "\n"


def _listed(entry: str, columns: int) -> str:
    """Return the text of an entry with a dash before it, from a column on."""
    indented = textwrap.indent(entry, " " * (columns + 2))
    return f"{' ' * columns}- {indented.lstrip()}"
