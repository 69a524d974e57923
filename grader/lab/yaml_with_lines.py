"""YAML that people write, read with lines, so that all mistakes are reported at once."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
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
from grader.lab.similar_words import suggestion
from grader.yaml_text import SAFE, require_few, require_flat

if TYPE_CHECKING:
    from typing import Self

Loc = tuple[str | int, ...]
#: A mistake in a YAML file: its place, and its description.
Fault = tuple[Loc, str]

_INT = "tag:yaml.org,2002:int"
_TIMESTAMP = "tag:yaml.org,2002:timestamp"
_WHOLE = re.compile(r"[-+]?(0|[1-9][0-9]*)$")


def _resolvers() -> dict[str, list[tuple[str, Any]]]:
    """Return the types of plain scalars by their first characters, without times, and with decimal integers only."""
    found: dict[str, list[tuple[str, Any]]] = {}
    for first, pairs in SAFE.yaml_implicit_resolvers.items():
        kept = found.setdefault(first, [])
        for tag, pattern in pairs:
            if tag == _INT:
                kept.append((tag, _WHOLE))
            elif tag != _TIMESTAMP:
                kept.append((tag, pattern))
    return found


class _Loader(SAFE):  # type: ignore[misc]
    """Loader that keeps dates as texts, and also numbers of YAML 1.1 only: `0123456`, `12_34` and `12:34`."""

    yaml_implicit_resolvers: ClassVar[dict[str, list[tuple[str, Any]]]] = _resolvers()


def read_text(path: Path, what: str, remedy: str) -> str:
    """Read a file, named in words such as "the rubric"; raises RubricError if it is missing, or is not text."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        reason = getattr(problem, "strerror", None) or str(problem)
        raise RubricError(
            f"{what} cannot be read", [reason], location=str(path), remedy=remedy
        ) from problem


#: Plain words for pydantic's kinds of mistakes.
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


def mistakes_at(found: Iterable[Fault]) -> ValidationError:
    """Return pydantic's error for mistakes at places below the validated value."""
    details: list[InitErrorDetails] = []
    for loc, words in found:
        mistake = PydanticCustomError("mistake", "{words}", {"words": words})
        details.append({"type": mistake, "loc": loc, "input": None})
    return ValidationError.from_exception_data("mistakes", details)


class Strict(BaseModel):
    """A part of a file that people write: unknown keys are mistakes, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    @model_validator(mode="wrap")
    @classmethod
    def _all_mistakes(cls, value: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        try:
            return handler(value)
        except ValidationError as error:
            found = []
            for item in error.errors():
                # A list with wrong elements is not empty.
                if item["type"] != "too_short" or not item["input"]:
                    found.append((tuple(item["loc"]), cls._words_for(item)))
        raise mistakes_at(found)

    @classmethod
    def _words_for(cls, item: ErrorDetails) -> str:
        kind = item["type"]
        given = item["input"]
        if kind == "literal_error" and isinstance(given, str):
            possible = re.findall(r"'([^']*)'", item["ctx"]["expected"])
            return f"{given!r} is not possible here{suggestion(given, possible)}"
        words = _PLAINER.get(kind, item["msg"].removeprefix("Value error, "))
        words = words.replace("Input should", "it should", 1)
        if kind == "extra_forbidden" and len(item["loc"]) == 1:
            known = [field.alias or key for key, field in cls.model_fields.items()]
            words += suggestion(str(item["loc"][0]), known)
        return words


class Mistakes:
    """Mistakes in a file, named in words such as "the rubric", with the line, from 1, of each."""

    def __init__(self, path: Path, what: str, lines: Mapping[Loc, int]) -> None:
        self.path = path
        self.what = what
        self.lines = lines
        self.found: list[tuple[int, str]] = []

    def line_of(self, loc: Loc) -> int:
        """Return the line of a node, or of the nearest node around it."""
        for depth in range(len(loc), -1, -1):
            if loc[:depth] in self.lines:
                return self.lines[loc[:depth]]
        return 1

    def add(self, loc: Loc, message: str) -> None:
        """Add a mistake at a node."""
        line = self.line_of(loc)
        if loc:
            message = f"{'.'.join(map(str, loc))}: {message}"
        self.found.append((line, f"{self.path.name}:{line}: {message}"))

    def add_validation(self, loc: Loc, error: ValidationError) -> None:
        """Add the mistakes that pydantic found in a node."""
        for item in error.errors():
            self.add(loc + tuple(item["loc"]), item["msg"])

    def error(self, remedy: str) -> RubricError:
        """Return the error with all mistakes, in the order of their lines."""
        if len(self.found) == 1:
            count = "1 mistake"
        else:
            count = f"{len(self.found)} mistakes"
        messages = [message for _, message in sorted(self.found)]
        problem = f"{self.what} has {count}"
        return RubricError(problem, messages, location=str(self.path), remedy=remedy)

    def raise_any(self, remedy: str) -> None:
        """Raise `error` if there are mistakes."""
        if self.found:
            raise self.error(remedy)


def parse_yaml(path: Path, text: str, what: str) -> tuple[dict[str, Any], Mistakes]:
    """Parse a mapping into plain data, and note repeated keys as mistakes; raises RubricError if it is not a mapping."""
    lines: dict[Loc, int] = {}
    repeated: list[Loc] = []
    try:
        require_flat(text)
        loader = _Loader(text)
        root = loader.get_single_node()
        if root is not None:
            require_few(root)
            # The construction merges keys, and loses their lines.
            _note_lines(root, (), lines, repeated)
        plain = None if root is None else loader.construct_document(root)
    except (yaml.YAMLError, ValueError, RecursionError) as problem:
        raise RubricError(
            f"{what} is not valid YAML",
            [_describe(path, problem)],
            location=str(path),
            remedy="Fix the line named.",
        ) from problem
    if not isinstance(plain, dict):
        wrong = f"{path.name}:1: a mapping is expected"
        raise RubricError(f"{what} is empty or not a mapping", [wrong], location=str(path))
    mistakes = Mistakes(path, what, lines)
    for loc in repeated:
        mistakes.add(loc, "this key stands here twice")
    return plain, mistakes


def _describe(path: Path, problem: Exception) -> str:
    """Return a mistake of the syntax with its line, such as "rubric.yaml:3: ..."."""
    mark = getattr(problem, "problem_mark", None)
    line = mark.line + 1 if mark else 1
    detail = getattr(problem, "problem", None) or str(problem)
    if isinstance(problem, RecursionError):
        detail = "something in it contains itself, or is nested too deeply"
    return f"{path.name}:{line}: {detail}"


def _note_lines(node: yaml.Node, loc: Loc, lines: dict[Loc, int], repeated: list[Loc]) -> None:
    """Note the lines of a node and of all nodes in it, and the positions of repeated keys."""
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
