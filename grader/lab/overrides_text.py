"""Adds entries to the text of `overrides.yaml`, and takes them out again; all else in it stays as people wrote it.

An entry is added at the end, and taken out by its lines, so comments, order and spelling of the others survive.
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
from grader.lab.overrides import OVERRIDES_FILE
from grader.lab.yaml_with_lines import parse_yaml

_KEY = "overrides"
_HEAD = "# Decisions of people; `grade regrade --help` shows what entries look like.\n"
_INDENT = 2
_SEQUENCE = "tag:yaml.org,2002:seq"
#: Beyond the length of any line of an entry: each value stands on the line of its key.
_ONE_LINE = 2**20


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Let nobody else who asks for the same change the file in a folder meanwhile; waits until nobody else does."""
    import fcntl  # There is none on Windows.

    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def rewrite(path: Path, change: Callable[[str], str]) -> str:
    """Change the text of a file of overrides, which may not be there yet, within `locked`; returns the new text."""
    text = change(path.read_text(encoding="utf-8") if path.exists() else "")
    replace_file(path, text)
    return text


class _Dumper(yaml.SafeDumper):
    """Writes an entry as people do: a key a line, and names in one."""


_Dumper.add_representer(
    list, lambda dumper, names: dumper.represent_sequence(_SEQUENCE, names, flow_style=True)
)


def with_entry(text: str, entry: Mapping[str, Any]) -> str:
    """Return the text with an entry at its end; raises RubricError if its list is in one line."""
    listed = _entries(text)
    new = yaml.dump(
        dict(entry), Dumper=_Dumper, allow_unicode=True, sort_keys=False, width=_ONE_LINE
    )
    if listed is None:
        return _checked(
            text, f"{text or _HEAD}{_ended(text)}{_KEY}:\n{_listed(new, _INDENT)}", [], entry
        )
    if not listed.value:  # An empty list may be written as [].
        kept = text[: listed.start_mark.index].rstrip(" ") + text[listed.end_mark.index :]
        return _checked(text, f"{kept}{_ended(kept)}{_listed(new, _INDENT)}", [], entry)
    return _checked(
        text, f"{text}{_ended(text)}{_listed(new, listed.start_mark.column)}", _plain(text), entry
    )


def without_entry(text: str, number: int) -> str:
    """Return the text without one of its entries, counted from 0, of which there are more; raises as `with_entry`."""
    listed, before = _entries(text), _plain(text)
    assert listed is not None
    node, lines = listed.value[number], text.splitlines(keepends=True)
    kept = [*lines[: node.start_mark.line], *lines[_last_line(node) + 1 :]]
    return _checked(text, "".join(kept), [*before[:number], *before[number + 1 :]])


def _entries(text: str) -> Any:
    """Return the node of the list, None if there is no list yet."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    pairs = root.value if isinstance(root, yaml.MappingNode) else []
    return next((value for key, value in pairs if key.value == _KEY), None)


def _plain(text: str) -> list[Any]:
    if not any(line.partition("#")[0].strip() for line in text.splitlines()):
        return []
    plain, _ = parse_yaml(Path(OVERRIDES_FILE), text, "the file of overrides")
    return list(plain.get(_KEY) or [])


def _checked(before: str, after: str, wanted: list[Any], *more: Mapping[str, Any]) -> str:
    """Return the new text if it says what it must, and no more than that."""
    with suppress(RubricError):
        if _plain(after) == [*wanted, *map(dict, more)]:
            return after
    problem = f"{OVERRIDES_FILE} is written in a way that no entry can be added to or taken from by a program"
    raise RubricError(
        problem, [], remedy="Write each entry of its list below the others, with a dash before it."
    )


def _last_line(node: yaml.Node) -> int:
    """Return the last line, from 0, on which something of a node stands."""
    if not isinstance(node, yaml.CollectionNode) or node.flow_style:
        end = node.end_mark
        return int(end.line - (end.column == 0))
    children = [
        part for pair in node.value for part in (pair if isinstance(pair, tuple) else (pair,))
    ]
    return max(map(_last_line, children))


def _ended(text: str) -> str:
    return "" if not text or text.endswith("\n") else "\n"


def _listed(entry: str, columns: int) -> str:
    """Return the text of an entry with a dash before it, from a column on."""
    return f"{' ' * columns}- {textwrap.indent(entry, ' ' * (columns + 2)).lstrip()}"
