"""XML and YAML launch files, read into the actions of Python ones."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from launch_plan.inside.problems import UnsupportedByStandin, blaming, mistake

from .._base import (
    InvalidLaunchFileError,
    expose_action,
    expose_substitution,
    exposed_actions,
    written_at,
)
from .._description import LaunchDescription
from ..conditions import IfCondition, UnlessCondition
from ..utilities.type_utils import get_typed_value, is_instance_of
from .parse_substitution import (
    instantiate_substitution,
    parse_if_substitutions,
    parse_substitution,
    replace_escaped_characters,
)

#: Actions in the markup of later releases, and perhaps of Jazzy's latest patch.
_SINCE_WHEN = frozenset({"unset", "push_env", "pop_env", "rep_env"})
_ROS_1 = {
    ("arg", "value"): "Write default='...', or <let> for what is not to be an argument.",
    ("node", "required"): "Write on_exit='shutdown' (ROS 1 wrote required='true').",
    ("node", "ns"): "Write namespace='...' (ROS 1 wrote ns='...').",
    (
        "group",
        "ns",
    ): "Write push_ros_namespace as the first action of the group (ROS 1 wrote ns='...').",
}
_T = TypeVar("_T")
_ALIKE = "Write all items alike: [1.0, 2.5] instead of [1, 2.5]."
CORRECT = "Correct this element of the file."


def bad(message: str, remedy: str = CORRECT, raised: type[Exception] = ValueError) -> Any:
    """Return the error for a malformed element."""
    return mistake(raised, message, "bad_markup", remedy)


class InvalidFrontendLaunchFileError(InvalidLaunchFileError):
    """Raised for an XML or YAML launch file that is not well-formed."""

    def __init__(self, message: str, path: str, line: int) -> None:
        super().__init__(message)
        self.launch_source = (path, line)
        self.launch_kind = "bad_markup"
        self.launch_remedy = "Correct it where it says."


class Parser:
    """A reader of actions from elements."""

    def parse_substitution(self, value: Any) -> Any:
        return parse_substitution(value if isinstance(value, str) else str(value))

    def parse_if_substitutions(self, value: Any) -> Any:
        return parse_if_substitutions(value)

    def escape_characters(self, value: Any) -> str:
        return replace_escaped_characters(str(value))

    def condition(self, entity: Entity) -> dict[str, Any]:
        """Return the condition of an action as a keyword argument, if there is one."""
        holds = entity.get_attr("if", optional=True)
        fails = entity.get_attr("unless", optional=True)
        if holds is not None and fails is not None:
            raise bad("'if' and 'unless' cannot stand in one element", raised=RuntimeError)
        if holds is not None:
            return {"condition": IfCondition(self.parse_substitution(holds))}
        if fails is not None:
            return {"condition": UnlessCondition(self.parse_substitution(fails))}
        return {}

    def pairs(self, entity: Entity, tag: str) -> dict[Any, Any]:
        """Return value by name of the inner elements with a tag."""

        def read(inner: Entity) -> tuple[Any, Any]:
            name = self.parse_substitution(inner.get_attr("name"))
            return tuple(name), self.parse_substitution(inner.get_attr("value"))

        return dict(entity.each(tag, read))

    def parse_action(self, entity: Entity) -> Any:
        import launch_ros.actions

        with blaming(entity), written_at(*entity.source_line):
            made, kwargs = _action_of(entity.type_name).parse(entity, self)
            entity.assert_entity_completely_parsed()
            return made(**kwargs)

    def parse_description(self, root: Entity) -> Any:
        """Return the launch description of a file."""
        with blaming(root):
            if root.type_name != "launch":
                message = (
                    f"the root of a launch file must be 'launch', but it is '{root.type_name}'"
                )
                raise bad(message, "Correct it where it says.")
            reason = root.get_attr("deprecated", optional=True)
            with written_at(*root.source_line):
                actions = [self.parse_action(child) for child in root.children]
                return LaunchDescription(actions, deprecated_reason=reason)


def _action_of(tag: str) -> Any:
    if tag in _SINCE_WHEN:
        raise UnsupportedByStandin(f"this grader does not know <{tag}>", name="launch")
    if tag in exposed_actions:
        return exposed_actions[tag]
    close = difflib.get_close_matches(tag, exposed_actions, n=1)
    meant = ""
    remedy = CORRECT
    if close:
        meant = f"; did you mean '{close[0]}'?"
        remedy = "Correct the name."
    if tag == "rosparam":
        remedy = "Write <param from='...'/> inside the node (ROS 1 wrote rosparam)."
    raise bad(f"there is no action '{tag}'{meant}", remedy, RuntimeError)


def instantiate_action(entity: Any, parser: Any) -> Any:
    return parser.parse_action(entity)


# -- one kind of tree for XML and YAML, with lines and used names ----------------------------------


class Entity:
    """An element: a tag of XML, or a key of YAML with its value; values of YAML have types."""

    def __init__(self, tag: str, path: str, line: int, *, typed: bool) -> None:
        self.type_name = tag
        self.typed = typed
        self.source_line = (path, line)
        self.attributes: dict[str, Any] = {}
        #: None in a mapping of YAML without the key `children`.
        self.inner: list[Entity] | None = []
        #: Other lists of mappings in YAML, by key; their XML forms are among the inner elements.
        self.lists: dict[str, list[Entity]] = {}
        self._used: set[str] = set()

    @property
    def children(self) -> list[Entity]:
        """The inner elements."""
        if self.inner is None:
            message = f"<{self.type_name}> needs a list of actions under the key 'children'"
            raise bad(message, "Write the actions as a list: each begins with a dash.")
        self._used |= self._names_of_children(self.inner)
        return self.inner

    def _names_of_children(self, inner: list[Entity]) -> set[str]:
        if self.typed:
            return {"children"}
        return {child.type_name for child in inner}

    def nested(self, tag: str) -> list[Entity]:
        """Return the inner elements with a tag; in YAML, the mappings in the list of a key."""
        self._used.add(tag)
        if self.typed and tag in self.attributes:
            message = f"the attribute '{tag}' of <{self.type_name}> must be a list of mappings"
            raise bad(message, "Begin each item with a dash: '- name: ...'.", TypeError)
        if self.typed:
            return self.lists.get(tag, [])
        return [inner for inner in self.inner or [] if inner.type_name == tag]

    def each(self, tag: str, read: Callable[[Entity], _T]) -> list[_T]:
        """Return the results of a function for the nested elements; each must be read completely."""
        found = []
        for inner in self.nested(tag):
            found.append(read(inner))
            inner.assert_entity_completely_parsed()
        return found

    def get_attr(
        self, name: str, *, data_type: Any = str, optional: bool = False, can_be_str: bool = True
    ) -> Any:
        """Return an attribute, read as a type."""
        self._used.add(name)
        if name not in self.attributes:
            if optional:
                return None
            raise self._missing_attribute(name)
        value = self.attributes[name]
        separator = f"{name}-sep"
        if separator in self.attributes and not self.typed:
            self._used.add(separator)
            value = value.split(self.attributes[separator])
        if not self.typed:
            try:
                return get_typed_value(value, data_type, can_be_str=can_be_str)
            except ValueError as error:
                message = f"the attribute '{name}' of <{self.type_name}> is '{value}': {error}"
                raise bad(message, _remedy_of_text(str(error)), TypeError) from error
        if not is_instance_of(value, data_type, can_be_str):
            wanted, remedy = _wanted(value, data_type)
            message = f"the attribute '{name}' of <{self.type_name}> must be {wanted}"
            raise bad(message, remedy, TypeError)
        return value

    def _missing_attribute(self, name: str) -> Any:
        remedy = "Add the attribute."
        if name == "exec":
            remedy = "Write exec='...' (ROS 1 wrote type='...')."
        return bad(f"<{self.type_name}> needs the attribute '{name}'", remedy, AttributeError)

    def assert_entity_completely_parsed(self) -> None:
        """Refuse attributes and inner elements that nothing has read."""
        here = {*self.attributes, *self.lists}
        if self.inner is not None:
            here |= self._names_of_children(self.inner)
        unknown = sorted(here - self._used)
        if not unknown:
            return
        meant = ""
        remedy = "Take it out."
        close = difflib.get_close_matches(unknown[0], self._used, n=1)
        if close:
            meant = f"; did you mean '{close[0]}'?"
            remedy = "Correct the name."
        remedy = _ROS_1.get((self.type_name, unknown[0]), remedy)
        if self.type_name == "include":
            remedy = "Put the include into a group, after push_ros_namespace or <let>."
        raise bad(f"<{self.type_name}> cannot have {', '.join(unknown)}{meant}", remedy)


def _remedy_of_text(problem: str) -> str:
    if "YAML makes it a dict" in problem:
        return "Write the inner names as <param> inside this one."
    return _ALIKE if "not of one type" in problem else CORRECT


def _wanted(value: Any, data_type: Any) -> tuple[str, str]:
    """Return the wanted form of a value of YAML, and the instruction."""
    if data_type is None:
        wanted = (
            f"a bool, a number, a text, or a list of which all items are of one type, not {value!r}"
        )
        return wanted, _ALIKE
    named = f"of type {getattr(data_type, '__name__', data_type)}, not {value!r}"
    if value is None:
        return (
            f"{named}: it stands here without a value",
            "Write a value behind it, or take it out.",
        )
    if data_type is float and type(value) is int:
        return f"{named}; write it with a decimal point", "Write 2.0 instead of 2."
    if data_type is str:
        return f"{named}; put it in quotes", "Put the value in quotes."
    return named, CORRECT


def read_entity(path: str) -> Entity:
    """Return the root of an XML or YAML launch file."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        message = "a character of this file is not encoded in UTF-8"
        raise InvalidFrontendLaunchFileError(message, path, line) from error
    markup = markup_of(text)
    if markup is None and path.endswith(".xml"):
        markup = "xml"
    return _read_xml(text, path) if markup == "xml" else _read_yaml(text, path)


def markup_of(text: str) -> str | None:
    """Return the language of a text by its beginning: `xml`, `yaml`, or None."""
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        return "xml"
    if re.match(r"\ufeff?\s*(#.*\n\s*)*(%YAML|---|launch\s*:)", text):
        return "yaml"
    return None


def _read_xml(text: str, path: str) -> Entity:
    from xml.parsers import expat

    # A tag with a namespace becomes an unknown name.
    parser = expat.ParserCreate(namespace_separator="}")
    document = Entity("", path, 1, typed=False)
    ancestors = [document]

    def start(tag: str, attributes: dict[str, str]) -> None:
        entity = Entity(tag, path, parser.CurrentLineNumber, typed=False)
        entity.attributes = dict(attributes)
        ancestors[-1].children.append(entity)
        ancestors.append(entity)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: ancestors.pop()
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        message = f"this is not well-formed XML: {error}"
        raise InvalidFrontendLaunchFileError(message, path, error.lineno) from error
    return document.children[0]


def _read_yaml(text: str, path: str) -> Entity:
    import yaml

    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        message = f"this is not well-formed YAML: {getattr(error, 'problem', None) or error}"
        line = mark.line + 1 if mark else 1
        raise InvalidFrontendLaunchFileError(message, path, line) from error
    if not isinstance(node, yaml.MappingNode) or not node.value:
        message = "the file must be a mapping with the key 'launch'"
        raise InvalidFrontendLaunchFileError(message, path, 1)
    (name, (key, value)), *others = _keys(node).items()
    for other, (second, _) in others:
        message = f"the file must have one key at its outermost level, 'launch', but '{other}' is a second one"
        raise InvalidFrontendLaunchFileError(message, path, second.start_mark.line + 1)
    return _yaml_entity(name, value, key.start_mark.line + 1, path)


def _keys(mapping: Any) -> dict[str, tuple[Any, Any]]:
    """Return the nodes of keys and values by name, those merged by `<<` too; the last of equal keys counts."""
    import yaml

    yaml.SafeLoader("").flatten_mapping(mapping)
    return {str(key.value): (key, value) for key, value in mapping.value}


def _yaml_entity(tag: str, node: Any, line: int, path: str) -> Entity:
    import yaml

    entity = Entity(tag, path, line, typed=True)
    if isinstance(node, yaml.SequenceNode):
        entity.inner = _actions(node, path)
        return entity
    if not isinstance(node, yaml.MappingNode):
        raise InvalidFrontendLaunchFileError(f"'{tag}' must hold a mapping or a list", path, line)
    entity.inner = None
    for name, (key, value) in _keys(node).items():
        _add_key(entity, name, value, key.start_mark.line + 1)
    return entity


def _add_key(entity: Entity, name: str, value: Any, line: int) -> None:
    """Add a key of a mapping to its entity: as actions, as a list of mappings, or as an attribute."""
    import yaml

    path, _ = entity.source_line
    is_list = isinstance(value, yaml.SequenceNode)
    if name == "children" and not is_list:
        raise InvalidFrontendLaunchFileError("'children' must hold a list", path, line)
    if name == "children":
        entity.inner = _actions(value, path)
    elif is_list and value.value and isinstance(value.value[0], yaml.MappingNode):
        entity.lists[name] = [_mapping_entity(name, item, path) for item in value.value]
    else:
        entity.attributes[name] = yaml.SafeLoader("").construct_object(value, deep=True)


def _mapping_entity(name: str, node: Any, path: str) -> Entity:
    return _yaml_entity(name, node, node.start_mark.line + 1, path)


def _actions(items: Any, path: str) -> list[Entity]:
    import yaml

    found = []
    for item in items.value:
        line = item.start_mark.line + 1
        keys = _keys(item) if isinstance(item, yaml.MappingNode) else {}
        if len(keys) != 1:
            message = "every item of this list must be a mapping with one key: the action"
            raise InvalidFrontendLaunchFileError(message, path, line)
        ((name, (_key, value)),) = keys.items()
        found.append(_yaml_entity(name, value, line, path))
    return found
