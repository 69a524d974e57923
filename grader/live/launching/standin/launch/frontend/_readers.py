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
        self.launch_source = line


@dataclass
class Element:
    """One element: a tag of XML, or a key of YAML with what it holds, whose values have types already."""

    tag: str
    line: int
    attributes: dict[str, Any] = field(default_factory=dict)
    children: list[Element] = field(default_factory=list)
    typed: bool = False


def read_xml(text: str, path: str) -> Element:
    """Read an XML launch file.

    Raises
    ------
    InvalidMarkupError
        It is not well-formed.
    """
    from xml.parsers import expat

    parser = expat.ParserCreate()
    roots: list[Element] = []
    open_elements: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, parser.CurrentLineNumber, dict(attributes))
        (open_elements[-1].children if open_elements else roots).append(element)
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
    key, value = node.value[0]
    return _yaml_element(str(key.value), value, key.start_mark.line + 1, path)


def _yaml_element(tag: str, node: Any, line: int, path: str) -> Element:
    import yaml

    element = Element(tag, line, typed=True)
    if isinstance(node, yaml.SequenceNode):
        element.children = [_only_key(item, path) for item in node.value]
    elif isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            _add_key(element, str(key.value), value, key.start_mark.line + 1, path)
    elif not (isinstance(node, yaml.ScalarNode) and node.tag.endswith(":null")):
        raise InvalidMarkupError(f"'{tag}' must hold a mapping or a list", (path, line))
    return element


def _only_key(item: Any, path: str) -> Element:
    import yaml

    line = item.start_mark.line + 1
    if not isinstance(item, yaml.MappingNode) or len(item.value) != 1:
        raise InvalidMarkupError("every item of this list must be a mapping with one key: the action", (path, line))
    key, value = item.value[0]
    return _yaml_element(str(key.value), value, line, path)


def _add_key(element: Element, name: str, node: Any, line: int, path: str) -> None:
    import yaml

    nested = isinstance(node, yaml.SequenceNode) and any(isinstance(i, yaml.MappingNode) for i in node.value)
    if nested and name == "children":
        element.children += [_only_key(item, path) for item in node.value]
    elif nested:
        for item in node.value:
            element.children.append(_yaml_element(name, item, item.start_mark.line + 1, path))
    else:
        element.attributes[name] = yaml.SafeLoader("").construct_object(node, deep=True)
