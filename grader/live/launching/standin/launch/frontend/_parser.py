"""From the elements of an XML or YAML launch file to actions."""

from __future__ import annotations

import difflib
from typing import Any

from .._base import InvalidLaunchFileError, UnsupportedByStandin, blame, mistake, written_at
from ..conditions import IfCondition, UnlessCondition
from ..utilities.type_utils import get_typed_value, is_instance_of
from ._readers import Element
from .expose import exposed_actions
from .parse_substitution import parse_if_substitutions, parse_substitution, replace_escaped_characters

#: Actions that later releases read from markup; whether Jazzy's latest patch does is not known here.
_SINCE_WHEN = frozenset({"unset", "push_env", "pop_env", "rep_env"})


class Entity:
    """An element, with note of what of it was used."""

    def __init__(self, element: Element, path: str, parent: Entity | None = None) -> None:
        self.__element = element
        self.__path = path
        self.__read: set[str] = set()
        self.parent = parent
        self.source_line = (path, element.line)

    @property
    def type_name(self) -> str:
        """The tag."""
        return self.__element.tag

    @property
    def children(self) -> list[Entity]:
        """The elements inside.

        Raises
        ------
        ValueError
            It is a mapping of YAML that has none.
        """
        element = self.__element
        if element.children is None:
            message = f"<{self.type_name}> needs a list of actions under the key 'children'"
            raise _bad(message, "Write the actions as a list: each begins with a dash.")
        self.__read.update(["children"] if element.typed else [child.tag for child in element.children])
        return [Entity(child, self.__path, self) for child in element.children]

    def nested(self, tag: str) -> list[Entity]:
        """The elements inside that have a tag; in YAML, the mappings in the list that a key holds.

        Raises
        ------
        TypeError
            The key of YAML holds something else.
        """
        self.__read.add(tag)
        element = self.__element
        if element.typed and tag in element.attributes:
            message = f"the attribute '{tag}' of <{self.type_name}> must be a list of mappings"
            raise _bad(message, "Begin each item with a dash: '- name: ...'.", TypeError)
        found = element.lists.get(tag, []) if element.typed else element.children or []
        return [Entity(child, self.__path, self) for child in found if child.tag == tag]

    def get_attr(self, name: str, *, data_type: Any = str, optional: bool = False, can_be_str: bool = True) -> Any:
        """An attribute, read as a type.

        Raises
        ------
        AttributeError
            It is missing.
        TypeError
            It is not of that type.
        """
        self.__read.add(name)
        value = self.__element.attributes.get(name)
        if value is None:
            if optional:
                return None
            remedy = "Write exec='...' (ROS 1 wrote type='...')." if name == "exec" else "Add the attribute."
            raise _bad(f"<{self.type_name}> needs the attribute '{name}'", remedy, AttributeError)
        separator = self.__element.attributes.get(f"{name}-sep")
        if separator is not None:
            self.__read.add(f"{name}-sep")
            value = value.split(separator)
        try:
            if not self.__element.typed:
                return get_typed_value(value, data_type, can_be_str=can_be_str)
        except ValueError as error:
            message = f"the attribute '{name}' of <{self.type_name}> is '{value}': {error}"
            raise _bad(message, _remedy(value, str, error), TypeError) from error
        if not is_instance_of(value, data_type, can_be_str):
            message = f"the attribute '{name}' of <{self.type_name}> must be {_wanted(value, data_type)}"
            raise _bad(message, _remedy(value, data_type, None), TypeError)
        return value

    def assert_entity_completely_parsed(self) -> None:
        """Check that nothing was left unused.

        Raises
        ------
        ValueError
            The element has an attribute or a tag inside that it cannot have.
        """
        element = self.__element
        here = {*element.attributes, *element.lists}
        here |= {"children"} if element.typed and element.children is not None else set()
        here |= set() if element.typed else {child.tag for child in element.children or []}
        unknown = sorted(here - self.__read)
        if unknown:
            close = difflib.get_close_matches(unknown[0], self.__read, n=1)
            meant = f"; did you mean '{close[0]}'?" if close else ""
            remedy = _ROS_1.get((self.type_name, unknown[0])) or ("Correct the name." if close else "Take it out.")
            if self.type_name == "include":
                remedy = "Put the include into a group, after push_ros_namespace or <let>."
            raise _bad(f"<{self.type_name}> cannot have {', '.join(unknown)}{meant}", remedy)


_ROS_1 = {
    ("arg", "value"): "Write default='...', or <let> for what is not to be an argument.",
    ("node", "required"): "Write on_exit='shutdown' (ROS 1 wrote required='true').",
    ("node", "ns"): "Write namespace='...' (ROS 1 wrote ns='...').",
    ("group", "ns"): "Write push_ros_namespace as the first action of the group (ROS 1 wrote ns='...').",
}
_ALIKE = "Write all items alike: [1.0, 2.5] instead of [1, 2.5]."


def _bad(message: str, remedy: str, raised: type[Exception] = ValueError) -> Any:
    return mistake(raised, message, "bad_markup", remedy)


def _wanted(value: Any, data_type: Any) -> str:
    if data_type is None:
        return f"a bool, a number, a text, or a list of which all items are of one type, not {value!r}"
    meant = "; write it with a decimal point" if data_type is float and type(value) is int else ""
    meant = "; put it in quotes" if data_type is str else meant
    return f"of type {getattr(data_type, '__name__', data_type)}, not {value!r}{meant}"


def _remedy(value: Any, data_type: Any, error: Exception | None) -> str:
    if error is not None and "YAML makes it a dict" in str(error):
        return "Write the inner names as <param> inside this one."
    if error is not None:
        return _ALIKE if "not of one type" in str(error) else "Correct this element of the file."
    if data_type is float and type(value) is int:
        return "Write 2.0 instead of 2."
    return {str: "Put the value in quotes.", None: _ALIKE}.get(data_type, "Correct this element of the file.")


class Parser:
    """Makes actions of elements."""

    def __init__(self, path: str) -> None:
        self.path = path

    def parse_substitution(self, value: Any) -> Any:
        """Read the substitutions in a text."""
        return parse_substitution(value if isinstance(value, str) else str(value))

    def parse_if_substitutions(self, value: Any) -> Any:
        """Read the substitutions in a value, if it is text."""
        return parse_if_substitutions(value)

    def escape_characters(self, value: Any) -> str:
        """Remove the backslashes that protect characters."""
        return replace_escaped_characters(str(value))

    def condition(self, entity: Entity) -> dict[str, Any]:
        """The condition that every action can have."""
        wanted = entity.get_attr("if", optional=True)
        unwanted = entity.get_attr("unless", optional=True)
        if wanted is not None and unwanted is not None:
            message = "'if' and 'unless' cannot stand in one element"
            raise _bad(message, "Correct this element of the file.", RuntimeError)
        if wanted is not None:
            return {"condition": IfCondition(self.parse_substitution(wanted))}
        if unwanted is not None:
            return {"condition": UnlessCondition(self.parse_substitution(unwanted))}
        return {}

    def pairs(self, entity: Entity, tag: str) -> dict[Any, Any]:
        """Names and values of the elements inside that have a tag."""
        found = {}
        for inner in entity.nested(tag):
            name = tuple(self.parse_substitution(inner.get_attr("name")))
            found[name] = self.parse_substitution(inner.get_attr("value"))
            inner.assert_entity_completely_parsed()
        return found

    def parse_action(self, entity: Entity) -> Any:
        """The action of an element."""
        import launch_ros.actions  # noqa: F401 - makes its names known

        try:
            with written_at(*entity.source_line):
                if entity.type_name in _SINCE_WHEN:
                    raise UnsupportedByStandin(f"this grader does not know <{entity.type_name}>", name="launch")
                if entity.type_name not in exposed_actions:
                    close = difflib.get_close_matches(entity.type_name, exposed_actions, n=1)
                    meant = f"; did you mean '{close[0]}'?" if close else ""
                    remedy = "Correct the name." if close else "Correct this element of the file."
                    if entity.type_name == "rosparam":
                        remedy = "Write <param from='...'/> inside the node (ROS 1 wrote rosparam)."
                    raise _bad(f"there is no action '{entity.type_name}'{meant}", remedy, RuntimeError)
                made, kwargs = exposed_actions[entity.type_name].parse(entity, self)
                entity.assert_entity_completely_parsed()
                return made(**kwargs)
        except Exception as error:
            blame(error, entity)
            raise

    def parse_description(self, root: Element) -> Any:
        """The launch description of a file.

        Raises
        ------
        InvalidLaunchFileError
            Its root is not `launch`.
        """
        from .._description import LaunchDescription

        entity = Entity(root, self.path)
        if root.tag != "launch":
            message = f"the root of a launch file must be 'launch', but it is '{root.tag}'"
            error = _bad(message, "Correct it where it says.", InvalidLaunchFileError)
            error.args = (message,)
            blame(error, entity)
            raise error
        try:
            reason = entity.get_attr("deprecated", optional=True)
            with written_at(*entity.source_line):
                actions = [self.parse_action(child) for child in entity.children]
                return LaunchDescription(actions, deprecated_reason=reason)
        except Exception as error:
            blame(error, entity)
            raise
