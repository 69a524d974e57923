"""Substitutions written as text: `$(var name)`."""

from __future__ import annotations

import re
from itertools import groupby
from typing import Any

from launch_plan.inside import problems
from launch_plan.inside.problems import mistake

from .._base import Substitution, exposed_substitutions
from ..substitutions import TextSubstitution

_ROS_1 = {
    "find": "Write $(find-pkg-share package) (ROS 1 wrote $(find package)).",
    "arg": "Write $(var name) (ROS 1 wrote $(arg name)).",
    "optenv": "Write $(env NAME default) (ROS 1 wrote $(optenv NAME default)).",
}

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


def instantiate_substitution(type_name: str, args: Any = None) -> Any:
    """Return the substitution of a name with arguments."""
    import launch_ros.substitutions  # noqa: F401 - makes its names known

    if type_name not in exposed_substitutions:
        known = ", ".join(sorted(exposed_substitutions))
        message = f"there is no substitution '$({type_name} ...)'; there are: {known}"
        similar = problems.near(type_name, exposed_substitutions)
        remedy = _ROS_1.get(type_name, f"{similar}Correct the name.")
        raise mistake(RuntimeError, message, "bad_markup", remedy)
    made, kwargs = exposed_substitutions[type_name].parse(args or [])
    return made(**kwargs)


def replace_escaped_characters(data: str) -> str:
    """Remove the backslashes before characters."""
    return re.sub(r"\\(.)", r"\1", data)


def parse_substitution(string_value: str) -> list[Substitution]:
    """Return the substitutions of a text, e.g. of `arm_$(var side)`."""
    if not string_value:
        return [TextSubstitution(text="")]
    return _Reader(string_value).template("")


class _Reader:
    """A reader of a text from left to right; `quote` is the quote around the present place, or empty."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0

    def template(self, quote: str) -> list[Substitution]:
        """Read any text outside of substitutions, or up to the closing quote."""
        parts: list[Any] = []
        while self._here() and self._here() != quote:
            if self._begins_substitution():
                parts.append(self._substitution(quote))
                continue
            escaped = quote and self._escapes(quote)
            parts.append(self._take(2 if escaped else 1))
        return _joined(parts)

    def _substitution(self, quote: str) -> Any:
        name = _NAME.match(self._text, self._at + 2)
        if name is None:
            raise self._wrong("a name is missing after '$('", "Correct this element of the file.")
        self._at = name.end()
        arguments: list[Any] = []
        while self._here() == " ":
            self._at += 1
            arguments.append(self._argument(quote, name.group()))
        if self._here() != ")":
            raise self._wrong(f"'$({name.group()}' is not closed", "Close it.")
        self._at += 1
        return instantiate_substitution(name.group(), arguments)

    def _argument(self, quote: str, name: str) -> list[Substitution]:
        # Between quotes, the quotes of an inner substitution are plain characters.
        opened = self._here()
        if not quote and opened and opened in "'\"":
            self._at += 1
            value = self.template(opened)
            if not self._here():
                raise self._wrong("a quote is not closed", "Close it.")
            self._at += 1
            return value
        value = self._unquoted(quote)
        if not value:
            if self._here() not in (" ", ")"):
                raise self._wrong(f"'$({name}' is not closed", "Close it.")
            remedy = "Write one blank between the arguments, and none before ')'."
            raise self._wrong(f"'$({name}' has one blank too many", remedy)
        return value

    def _unquoted(self, quote: str) -> list[Substitution]:
        parts: list[Any] = []
        barred = quote or "'\""
        while character := self._here():
            if self._begins_substitution():
                parts.append(self._substitution(quote))
                continue
            if any(self._escapes(each) for each in barred):
                parts.append(self._take(2))
                continue
            is_bracket = character in "()" and self._text[self._at - 1] != "\\"
            if character == "(" and is_bracket:
                message = "'(' in an argument needs quotes around the argument"
                raise self._wrong(message, "Put the argument in quotes.")
            if is_bracket or character in (" ", *barred):
                break
            parts.append(self._take(1))
        return _joined(parts)

    def _wrong(self, what: str, remedy: str) -> Any:
        return mistake(ValueError, f"'{self._text}': {what}", "bad_markup", remedy)

    def _here(self) -> str:
        return self._text[self._at : self._at + 1]

    def _take(self, count: int) -> str:
        taken = self._text[self._at : self._at + count]
        self._at += count
        return taken

    def _escapes(self, character: str) -> bool:
        return self._text.startswith("\\" + character, self._at)

    def _begins_substitution(self) -> bool:
        before = self._text[self._at - 1 : self._at]
        return before != "\\" and self._text.startswith("$(", self._at)


def _joined(parts: list[Any]) -> list[Substitution]:
    """Return substitutions, each with the run of characters before and behind it as a text."""
    found: list[Substitution] = []
    for is_text, run in groupby(parts, lambda part: isinstance(part, str)):
        if is_text:
            text = replace_escaped_characters("".join(run))
            found.append(TextSubstitution(text=text))
        else:
            found.extend(run)
    return found


def parse_if_substitutions(value: Any) -> Any:
    """Return the substitutions of a text; plain text and other values stay as they are."""
    if isinstance(value, list):
        return [parse_if_substitutions(item) for item in value]
    if not isinstance(value, str):
        return value
    parts = parse_substitution(value)
    if len(parts) == 1 and isinstance(parts[0], TextSubstitution):
        return parts[0].text
    return parts
