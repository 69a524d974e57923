"""Substitutions written as text: `$(var name)`."""

from __future__ import annotations

import re
from typing import Any

from .._base import Substitution
from .expose import exposed_substitutions

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


def replace_escaped_characters(data: str) -> str:
    """Remove the backslashes that protect characters."""
    return re.sub(r"\\(.)", r"\1", data)


def parse_substitution(string_value: str) -> list[Substitution]:
    """Read a text with `$(...)` in it as a list of substitutions.

    Raises
    ------
    ValueError
        A parenthesis is not closed, or the name of a substitution is missing.
    RuntimeError
        There is no substitution of that name.
    """
    from ..substitutions import TextSubstitution

    if not string_value:
        return [TextSubstitution(text="")]
    parts, _ = _template(string_value, 0, "")
    return parts


def _template(text: str, start: int, end: str) -> tuple[list[Substitution], int]:
    from ..substitutions import TextSubstitution

    parts: list[Substitution] = []
    plain = ""
    position = start
    while position < len(text) and not (end and text[position] in end):
        if text.startswith("$(", position):
            if plain:
                parts.append(TextSubstitution(text=replace_escaped_characters(plain)))
                plain = ""
            sub, position = _substitution(text, position)
            parts.append(sub)
            continue
        step = 2 if text[position] == "\\" and position + 1 < len(text) else 1
        plain += text[position : position + step]
        position += step
    if plain:
        parts.append(TextSubstitution(text=replace_escaped_characters(plain)))
    return parts, position


def _substitution(text: str, start: int) -> tuple[Any, int]:
    name = _NAME.match(text, start + 2)
    if name is None:
        raise ValueError(f"'{text}': a name is missing after '$('")
    arguments: list[Any] = []
    position = name.end()
    while position < len(text) and text[position] == " ":
        while position < len(text) and text[position] == " ":
            position += 1
        if position < len(text) and text[position] == ")":
            break
        quote = text[position] if position < len(text) and text[position] in "'\"" else ""
        value, position = _template(text, position + len(quote), quote or " )")
        if quote:
            if position >= len(text):
                raise ValueError(f"'{text}': a quote is not closed")
            position += 1
        arguments.append(value)
    if position >= len(text) or text[position] != ")":
        raise ValueError(f"'{text}': '$({name.group()}' is not closed")
    return _instantiate(name.group(), arguments), position + 1


def _instantiate(name: str, arguments: list[Any]) -> Any:
    import launch_ros.substitutions  # noqa: F401 - makes its names known

    if name not in exposed_substitutions:
        known = ", ".join(sorted(exposed_substitutions))
        raise RuntimeError(f"there is no substitution '$({name} ...)'; there are: {known}")
    made, kwargs = exposed_substitutions[name].parse(arguments)
    return made(**kwargs)


def parse_if_substitutions(value: Any) -> Any:
    """Read the substitutions in a value, if it is text; plain text stays text."""
    from ..substitutions import TextSubstitution

    if isinstance(value, list):
        return [parse_if_substitutions(item) for item in value]
    if not isinstance(value, str):
        return value
    parts = parse_substitution(value)
    if len(parts) == 1 and isinstance(parts[0], TextSubstitution):
        return parts[0].text
    return parts
