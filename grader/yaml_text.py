"""YAML that somebody else may have written, read in bounded time: ten lines of aliases can stand for a billion values."""

from __future__ import annotations

from typing import Any

import yaml

#: Values in a file once its aliases are written out. The largest rubric that we know has 3,000.
MOST_VALUES = 200_000

#: Deeper than this, no file that a person writes nests lists and mappings. Much deeper, the loader in C
#: overflows the stack of the process.
_DEEPEST = 200

#: The safe loader, in C where PyYAML was built with it.
SAFE: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class TooManyValues(yaml.YAMLError):
    """A text stands for more values than are read, for endlessly many, or for some that are nested too deeply."""

    def __init__(self, problem: str) -> None:
        super().__init__(problem)
        self.problem = problem


def load(text: str | bytes) -> Any:
    """Return the plain data that a text in YAML stands for.

    Raises
    ------
    yaml.YAMLError
        The text is not YAML, or stands for too many values.
    """
    require_flat(text)
    loader = SAFE(text)
    try:
        root = loader.get_single_node()
        if root is None:
            return None
        require_few(root)
        return loader.construct_document(root)
    finally:
        loader.dispose()


def require_flat(text: str | bytes) -> None:
    """Raise yaml.YAMLError if lists and mappings are nested too deeply."""
    depth = 0
    for event in yaml.parse(text, SAFE):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > _DEEPEST:
            raise TooManyValues("something in it is nested too deeply")


def require_few(root: yaml.Node, most: int = MOST_VALUES) -> None:
    """Raise TooManyValues if a node, aliases written out, has more values than are read, or contains itself."""
    sizes: dict[int, int] = {}
    begun: set[int] = set()
    waiting = [root]
    while waiting:
        node = waiting[-1]
        parts = [part for part in _parts(node) if id(part) not in sizes]
        if id(node) in sizes:
            waiting.pop()
        elif not parts:
            sizes[id(node)] = min(most + 1, 1 + sum(sizes[id(part)] for part in _parts(node)))
            waiting.pop()
        elif id(node) in begun:
            raise TooManyValues("something in it contains itself")
        else:
            begun.add(id(node))
            waiting += parts
    if sizes[id(root)] > most:
        raise TooManyValues(f"with its aliases written out it has more than {most} values")


def _parts(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    if isinstance(node, yaml.SequenceNode):
        return list(node.value)
    return []
