"""XML and YAML launch files, brought into the same actions as Python ones."""

from __future__ import annotations

import difflib
from typing import Any

from .._base import (
    InvalidLaunchFileError,
    UnsupportedByStandin,
    blaming,
    expose_action,
    expose_substitution,
    exposed_actions,
    written_at,
)
from .._description import LaunchDescription
from ..conditions import IfCondition, UnlessCondition
from ._entity import CORRECT, Entity, InvalidFrontendLaunchFileError, bad, markup_of, read_entity
from .parse_substitution import (
    instantiate_substitution,
    parse_if_substitutions,
    parse_substitution,
    replace_escaped_characters,
)

#: Actions that later releases read from markup; whether Jazzy's latest patch does is not known here.
_SINCE_WHEN = frozenset({"unset", "push_env", "pop_env", "rep_env"})


class Parser:
    """Makes actions of elements."""

    def parse_substitution(self, value: Any) -> Any:
        """Read the substitutions in a text."""
        return parse_substitution(value if isinstance(value, str) else str(value))

    def parse_if_substitutions(self, value: Any) -> Any:
        """Read the substitutions in a value, if it is text."""
        return parse_if_substitutions(value)

    def escape_characters(self, value: Any) -> str:
        return replace_escaped_characters(str(value))

    def condition(self, entity: Entity) -> dict[str, Any]:
        """The condition that every action can have."""
        kinds = {"if": IfCondition, "unless": UnlessCondition}
        texts = {name: text for name in kinds if (text := entity.get_attr(name, optional=True)) is not None}
        if len(texts) > 1:
            raise bad("'if' and 'unless' cannot stand in one element", raised=RuntimeError)
        for name, text in texts.items():
            return {"condition": kinds[name](self.parse_substitution(text))}
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
        import launch_ros.actions

        with blaming(entity), written_at(*entity.source_line):
            made, kwargs = _action_of(entity.type_name).parse(entity, self)
            entity.assert_entity_completely_parsed()
            return made(**kwargs)

    def parse_description(self, root: Entity) -> Any:
        """The launch description of a file."""
        with blaming(root):
            if root.type_name != "launch":
                message = f"the root of a launch file must be 'launch', but it is '{root.type_name}'"
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
    meant, remedy = (f"; did you mean '{close[0]}'?", "Correct the name.") if close else ("", CORRECT)
    if tag == "rosparam":
        remedy = "Write <param from='...'/> inside the node (ROS 1 wrote rosparam)."
    raise bad(f"there is no action '{tag}'{meant}", remedy, RuntimeError)


def instantiate_action(entity: Any, parser: Any) -> Any:
    return parser.parse_action(entity)
