"""YAML that people write, read so that all its mistakes can be reported at once, each with its line."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import yaml
from pydantic import (
    BaseModel,
    ConfigDict,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from grader.errors import RubricError
from grader.yaml_text import SAFE, require_few, require_flat

if TYPE_CHECKING:
    from typing_extensions import Self

Loc = tuple[str | int, ...]

_INT, _TIMESTAMP = "tag:yaml.org,2002:int", "tag:yaml.org,2002:timestamp"
_WHOLE = re.compile(r"[-+]?(0|[1-9][0-9]*)$")


class _Loader(SAFE):  # type: ignore[misc]
    """Leaves dates as they are written, and what is a number only in YAML 1.1: `0123456`, `12_34` and `12:34`."""

    yaml_implicit_resolvers: ClassVar[dict[str, list[tuple[str, Any]]]] = {
        first: [
            (tag, _WHOLE if tag == _INT else pattern) for tag, pattern in pairs if tag != _TIMESTAMP
        ]
        for first, pairs in SAFE.yaml_implicit_resolvers.items()
    }


def read_text(path: Path, what: str, remedy: str) -> str:
    """Read a file (in words, e.g. "the rubric"); raises RubricError if it is not there, or is no text."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        reason = (
            problem.strerror if isinstance(problem, OSError) and problem.strerror else str(problem)
        )
        raise RubricError(
            f"{what} cannot be read", [reason], location=str(path), remedy=remedy
        ) from problem


#: Kind of mistake, as pydantic knows it -> plainer words.
_PLAINER = {
    "extra_forbidden": "unknown key",
    "missing": "this key is missing",
    "string_type": "a text is expected",
    "float_type": "a number is expected",
    "int_type": "a whole number is expected",
    "bool_type": "true or false is expected",
    "string_too_short": "it is empty",
    "too_short": "it is empty",
    "model_type": "a mapping is expected",
    "dict_type": "a mapping is expected",
    "tuple_type": "a list is expected",
}


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return what may be meant by a word that is none of the known ones, as the end of a sentence."""
    names = sorted(set(known))
    return meant(word, names) or (f"; known are {', '.join(names)}" if names else "")


def meant(word: str, known: Sequence[str]) -> str:
    """Return which of the known words a word is likely to stand for, as the end of a sentence; empty if none."""
    near = difflib.get_close_matches(word, known, n=1)
    return f"; did you mean '{near[0]}'?" if near else ""


def mistakes_at(found: Iterable[tuple[Loc, str]]) -> ValidationError:
    """Return the error that has pydantic report mistakes at places below the value that is being validated."""
    details: list[InitErrorDetails] = [
        {
            "type": PydanticCustomError("mistake", "{words}", {"words": words}),
            "loc": loc,
            "input": None,
        }
        for loc, words in found
    ]
    return ValidationError.from_exception_data("mistakes", details)


class Strict(BaseModel):
    """A part of such a file: unknown keys are mistakes, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    @model_validator(mode="wrap")
    @classmethod
    def _all_mistakes(cls, value: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        try:
            return handler(value)
        except ValidationError as error:
            # A list is not empty by elements that are there, but wrong.
            items = (
                item for item in error.errors() if item["type"] != "too_short" or not item["input"]
            )
            found = [(tuple(item["loc"]), cls._words_for(item)) for item in items]
        raise mistakes_at(found)

    @classmethod
    def _words_for(cls, item: ErrorDetails) -> str:
        loc, words = (
            item["loc"],
            _PLAINER.get(item["type"], item["msg"].removeprefix("Value error, ")),
        )
        words = words.replace("Input should", "it should", 1)
        if item["type"] == "extra_forbidden" and len(loc) == 1:
            return words + suggestion(
                str(loc[0]), (field.alias or key for key, field in cls.model_fields.items())
            )
        if item["type"] == "literal_error" and isinstance(item["input"], str):
            return f"{item['input']!r} is not possible here" + suggestion(
                item["input"], re.findall(r"'([^']*)'", item["ctx"]["expected"])
            )
        return words


class Mistakes:
    """Collects mistakes in a file (in words, e.g. "the rubric") with the line, from 1, of the node they concern."""

    def __init__(self, path: Path, what: str, lines: Mapping[Loc, int]) -> None:
        self.path, self.what, self.lines = path, what, lines
        self.found: list[tuple[int, str]] = []

    def line_of(self, loc: Loc) -> int:
        """Return the line of a node, or of the nearest that is there around it."""
        return next(
            (self.lines[loc[:n]] for n in range(len(loc), -1, -1) if loc[:n] in self.lines), 1
        )

    def add(self, loc: Loc, message: str) -> None:
        """Note a mistake at a node."""
        line, place = self.line_of(loc), ".".join(map(str, loc))
        self.found.append(
            (line, f"{self.path.name}:{line}: {place + ': ' if place else ''}{message}")
        )

    def add_validation(self, loc: Loc, error: ValidationError) -> None:
        """Note what pydantic found wrong in a node."""
        for item in error.errors():
            self.add(loc + tuple(item["loc"]), item["msg"])

    def error(self, remedy: str) -> RubricError:
        """Return the error with all of them, in the order of their lines."""
        problem = f"{self.what} has {len(self.found)} mistake{'s' * (len(self.found) != 1)}"
        return RubricError(
            problem, [m for _, m in sorted(self.found)], location=str(self.path), remedy=remedy
        )

    def raise_any(self, remedy: str) -> None:
        """Raise `error` if there are mistakes."""
        if self.found:
            raise self.error(remedy)


def parse_yaml(path: Path, text: str, what: str) -> tuple[dict[str, Any], Mistakes]:
    """Parse a mapping into plain data; raises RubricError if it is none. A repeated key is the first mistake."""
    lines: dict[Loc, int] = {}
    repeated: list[Loc] = []
    try:
        require_flat(text)
        loader = _Loader(text)
        root = loader.get_single_node()
        if root is not None:
            require_few(root)
            _note_lines(root, (), lines, repeated)  # Before merged keys take their place in it.
        plain = None if root is None else loader.construct_document(root)
    except (yaml.YAMLError, ValueError, RecursionError) as problem:
        mark = getattr(problem, "problem_mark", None)
        detail = getattr(problem, "problem", None) or str(problem)
        if isinstance(problem, RecursionError):
            detail = "something in it contains itself, or is nested too deeply"
        wrong, remedy = (
            f"{path.name}:{mark.line + 1 if mark else 1}: {detail}",
            "Fix the line named.",
        )
        raise RubricError(
            f"{what} is not valid YAML", [wrong], location=str(path), remedy=remedy
        ) from problem
    if not isinstance(plain, dict):
        wrong = f"{path.name}:1: a mapping is expected"
        raise RubricError(f"{what} is empty or not a mapping", [wrong], location=str(path))
    mistakes = Mistakes(path, what, lines)
    for loc in repeated:
        mistakes.add(loc, "this key stands here twice")
    return plain, mistakes


def _note_lines(node: yaml.Node, loc: Loc, lines: dict[Loc, int], repeated: list[Loc]) -> None:
    lines.setdefault(loc, node.start_mark.line + 1)
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            inner = (*loc, str(key.value))
            if inner in lines:
                repeated.append(inner)
            lines[inner] = key.start_mark.line + 1
            _note_lines(value, inner, lines, repeated)
    elif isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            _note_lines(item, (*loc, index), lines, repeated)
