"""Reading XML and YAML into one kind of tree that knows its lines."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .._base import InvalidLaunchFileError, SourceLine


class InvalidMarkupError(InvalidLaunchFileError):
    """A launch file is not well-formed."""

    def __init__(self, message: str, line: SourceLine) -> None:
        Exception.__init__(self, message)
        self.likely_errors = ()
        self.launch_source, self.launch_kind = line, "bad_markup"
        self.launch_remedy = "Correct it where it says."


@dataclass
class Element:
    """One element: a tag of XML, or a key of YAML with what it holds, whose values have types already.

    Attributes
    ----------
    children : list of Element or None
        None: a mapping of YAML without the key `children`.
    lists : mapping
        Other lists of mappings in YAML, each by its key. In XML these stand among the children.
    typed : bool
        It is one of YAML.
    """

    tag: str
    line: int
    attributes: dict[str, Any] = field(default_factory=dict)
    children: list[Element] | None = field(default_factory=list)
    lists: dict[str, list[Element]] = field(default_factory=dict)
    typed: bool = False


def read_xml(text: str, path: str) -> Element:
    """Read an XML launch file.

    Raises
    ------
    InvalidMarkupError
        It is not well-formed.
    """
    from xml.parsers import expat

    parser = expat.ParserCreate(namespace_separator="}")  # a tag with a namespace is none that is known
    roots: list[Element] = []
    open_elements: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, parser.CurrentLineNumber, dict(attributes))
        beside = open_elements[-1].children if open_elements else roots
        assert beside is not None
        beside.append(element)
        open_elements.append(element)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: open_elements.pop()
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise InvalidMarkupError(f"this is not well-formed XML: {error}", (path, error.lineno)) from error
    return roots[0]


def read_yaml(text: str, path: str) -> Element:
    """Read a YAML launch file.

    Raises
    ------
    InvalidMarkupError
        It is not well-formed, or not a mapping with the key `launch`.
    """
    import yaml

    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = mark.line + 1 if mark else 1
        raise InvalidMarkupError(
            f"this is not well-formed YAML: {getattr(error, 'problem', None) or error}", (path, line)
        ) from error
    if not isinstance(node, yaml.MappingNode) or not node.value:
        raise InvalidMarkupError("the file must be a mapping with the key 'launch'", (path, 1))
    name, (key, value) = next(iter(_keys(node).items()))
    return _yaml_element(name, value, key.start_mark.line + 1, path)


def _keys(mapping: Any) -> dict[str, tuple[Any, Any]]:
    """Nodes of keys and values by name: what `<<` merges is there too, and the last of two equal keys counts."""
    import yaml

    yaml.SafeLoader("").flatten_mapping(mapping)
    found: dict[str, tuple[Any, Any]] = {}
    for key, value in mapping.value:
        found[str(key.value)] = (key, value)
    return found


def _yaml_element(tag: str, node: Any, line: int, path: str) -> Element:
    import yaml

    element = Element(tag, line, typed=True)
    if isinstance(node, yaml.SequenceNode):
        element.children = [_only_key(item, path) for item in node.value]
    elif isinstance(node, yaml.MappingNode):
        element.children = None
        for name, (key, value) in _keys(node).items():
            _add_key(element, name, value, key.start_mark.line + 1, path)
    else:
        raise InvalidMarkupError(f"'{tag}' must hold a mapping or a list", (path, line))
    return element


def _only_key(item: Any, path: str) -> Element:
    import yaml

    line = item.start_mark.line + 1
    keys = _keys(item) if isinstance(item, yaml.MappingNode) else {}
    if len(keys) != 1:
        raise InvalidMarkupError("every item of this list must be a mapping with one key: the action", (path, line))
    ((name, (_, value)),) = keys.items()
    return _yaml_element(name, value, line, path)


def _add_key(element: Element, name: str, node: Any, line: int, path: str) -> None:
    import yaml

    listed = node.value if isinstance(node, yaml.SequenceNode) else []
    if name == "children":
        if not isinstance(node, yaml.SequenceNode):
            raise InvalidMarkupError("'children' must hold a list", (path, line))
        element.children = [_only_key(item, path) for item in listed]
    elif listed and isinstance(listed[0], yaml.MappingNode):
        element.lists[name] = [_yaml_element(name, item, item.start_mark.line + 1, path) for item in listed]
    else:
        element.attributes[name] = yaml.SafeLoader("").construct_object(node, deep=True)
