"""Reads declarations in the Python files of a lab without executing them: settings of reference nodes, own checks.

A rubric may name a function or a class of a file beside it. To check the rubric, its annotations are enough: parameters
that are annotated with a name of `LAB_TYPES` are looked up like those of built-in checks.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import lru_cache, reduce
from operator import or_
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from pydantic import ConfigDict, Field, PrivateAttr, ValidationInfo, create_model

from grader.lab import references
from grader.lab.references import (
    Definition,
    OwnCheck,
    Parameters,
    Reference,
    References,
    Scope,
    Sought,
    definition_at,
    definition_in,
)

#: Version of the interface for a lab's own checks (`grader.own_checks`).
API_VERSION = 1
#: Names of types in `grader.lab.references` for annotations of an own check's parameters.
LAB_TYPES = (
    *("Artifact", "Process", "ReferenceNode", "SessionId", "EarlierCheckId"),
    *("AnyStep", "CallLabel", "ExitLabel", "GetLabel", "PlanLabel", "SetLabel", "Window"),
    *(
        "GivenName",
        "RosName",
        "Topic",
        "MessageType",
        "ServiceType",
        "FieldPath",
        "StampField",
        "TextField",
    ),
    *("Pattern", "Patterns", "Share", "CheckId", "Loadable"),
    *("Reliability", "Durability", "History"),
)
#: Functions in `grader.lab.references` for marking a type within `Annotated`.
LAB_MARKERS = ("fields_of_type",)
_KNOWN: dict[str, Any] = {
    **{"float": float, "int": int, "bool": bool, "str": str, "Literal": Literal},
    **{"list": list, "tuple": tuple, "dict": dict, "Sequence": Sequence, "Mapping": Mapping},
    **{name: getattr(references, name) for name in LAB_TYPES},
}
_NO_BASES = ("BaseModel", "object", "Parameters")
#: Arguments of pydantic's `Field` that limit and describe a value.
_OF_FIELD = (
    *("gt", "ge", "lt", "le", "min_length", "max_length", "pattern"),
    *("description", "examples"),
)


class _Open(Parameters):
    """Has fields that are not known here."""

    model_config = ConfigDict(extra="allow")


def model_of(found: Definition) -> type[Parameters]:
    """Return the model of a class in a lab's file, as far as its annotations say it.

    A field without a value is required. Limits and descriptions count if they are literals in a call of pydantic's
    `Field`. Fields of bases from elsewhere are not known here.
    """
    assert isinstance(found.node, ast.ClassDef)
    bases = []
    for base in found.node.bases:
        name = _last_name(base)
        if name not in _NO_BASES:
            bases.append(_model_named(name, found) or _Open)
    typed: dict[str, Any] = {}
    for node in found.node.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            kind = _type_of(node.annotation, found)
            value = _value(node.value, limited=kind is not Any)
            typed[node.target.id] = (kind, value)
    doc = ast.get_docstring(found.node)
    return create_model(
        found.node.name, __base__=tuple(bases) or (Parameters,), __doc__=doc, **typed
    )


def _model_named(name: str, found: Definition) -> type[Parameters] | None:
    node = found.beside.get(name)
    # A class within itself is left to the file.
    inner = {other: each for other, each in found.beside.items() if each is not found.node}
    if isinstance(node, ast.ClassDef) and name in inner:
        return model_of(Definition(node, inner))
    return None


def _value(node: ast.expr | None, *, limited: bool = False) -> Any:
    """Return the default of a field: `...` if it is required, None if it is not a literal.

    Parameters
    ----------
    limited
        Whether the limits of a `Field` count; a value of an unknown type cannot be compared with them.
    """
    if node is None:
        return ...
    if isinstance(node, ast.Call) and _last_name(node.func) == "Field":
        return _field(node, limited=limited)
    return _literal(node)


def _literal(node: ast.expr) -> Any:
    """Return the value of an expression; None if it is not a literal."""
    with suppress(ValueError):
        return ast.literal_eval(node)
    return None


def _field(node: ast.Call, *, limited: bool) -> Any:
    """Return the field that a call `Field(...)` describes, as far as its arguments are literals."""
    given = {keyword.arg: keyword.value for keyword in node.keywords}
    default: Any = ...
    if node.args:
        default = _literal(node.args[0])
    elif "default" in given:
        default = _literal(given["default"])
    elif "default_factory" in given:
        default = None
    names = _OF_FIELD if limited else ("description",)
    known = {name: _literal(given[name]) for name in names if name in given}
    return Field(default, **known)


def _type_of(node: ast.expr, found: Definition) -> Any:
    """Return the type that an annotation stands for; Any if the type is not known here."""
    try:
        return _annotated(node, found)
    except (TypeError, ValueError, SyntaxError):
        return Any


def _annotated(node: ast.expr, found: Definition) -> Any:
    """Return the type of a part of an annotation; Any if it is not known. Raises as `_type_of` catches."""
    if isinstance(node, ast.Constant):
        text = node.value
        if isinstance(text, str) and text:
            return _annotated(ast.parse(text, mode="eval").body, found)
        return type(text)
    if isinstance(node, (ast.Name, ast.Attribute)):
        name = _last_name(node)
        return _KNOWN.get(name) or _model_named(name, found) or Any
    if isinstance(node, ast.BinOp):
        either = [_annotated(side, found) for side in (node.left, node.right)]
        return Any if Any in either else reduce(or_, either)
    if isinstance(node, ast.Subscript):
        return _subscripted(node, found)
    return Any


def _subscripted(node: ast.Subscript, found: Definition) -> Any:
    """Return a type with its arguments, such as `tuple[float, ...]`."""
    inner = [node.slice]
    if isinstance(node.slice, ast.Tuple):
        inner = node.slice.elts
    if _last_name(node.value) == "Annotated":
        return _marked(inner, found)
    kind = _annotated(node.value, found)
    if kind is Any:
        return Any
    of = []
    for each in inner:
        # Values of a Literal and the dots of a tuple are not types.
        if kind is Literal or ast.unparse(each) == "...":
            of.append(ast.literal_eval(each))
        else:
            of.append(_annotated(each, found))
    return kind[tuple(of)]


def _marked(inner: Sequence[ast.expr], found: Definition) -> Any:
    """Return a type with its markers, such as `Annotated[str, fields_of_type("_Response", "step")]`."""
    kind = _annotated(inner[0], found)
    for marker in inner[1:]:
        if not isinstance(marker, ast.Call):
            continue
        name = _last_name(marker.func)
        if name in LAB_MARKERS:
            make = getattr(references, name)
            kind = Annotated[kind, make(*map(ast.literal_eval, marker.args))]
    return kind


def _last_name(node: ast.expr) -> str:
    """Return the name of an expression without its module, such as `Field` of `pydantic.Field`."""
    return ast.unparse(node).rpartition(".")[2]


def _settings(scope: Scope, value: Mapping[str, Any], info: ValidationInfo) -> None:
    """Look settings up in the class that the rubric names for the settings of the reference node."""
    try:
        found = definition_at(scope, scope.settings_of(info.data.get("reference") or ""))
    except ValueError:
        return  # None is named, or it is a mistake where it is used.
    if isinstance(found.node, ast.ClassDef):
        model_of(found).model_validate(value, context=scope)


Settings = Annotated[dict[str, Any], Reference("Settings of the reference node.", _settings)]


# -- checks of a lab's own -------------------------------------------------------------------------


@dataclass(frozen=True)
class Traits:
    """Properties of a check that it states by the decorator `check` of `grader.own_checks`."""

    commands: tuple[str, ...] = ()
    by_endpoints: bool = False
    seeks: tuple[str, ...] = ()


class OwnParameters(Parameters):
    """Values for a check of the lab's own; of its types once the check's file is executed."""

    model_config = ConfigDict(extra="allow")
    _traits: Traits = PrivateAttr(default_factory=Traits)

    @property
    def traits(self) -> Traits:
        """Properties of the check."""
        return self._traits

    @property
    def _values(self) -> dict[str, Any]:
        """Values, as plain data; the first call of `model_dump` would take 10 ms."""
        return cast(dict[str, Any], self.model_extra)

    def references(self) -> References:
        """Return each text as a name and as a label: an author may annotate a topic as plain `str`."""
        texts = frozenset(_texts(self._values))
        return References(texts, texts)

    def sought(self) -> list[Sought]:
        """Return the endpoints of the kinds that the check states, each with the type beside its name."""
        found = []
        for kind in self.traits.seeks:
            key = "topic" if kind in ("publisher", "subscription") else kind
            for values in _mappings(self._values):
                if isinstance(values.get(key), str):
                    found.append(Sought(kind, values[key], values.get("type")))
        return found


def _mappings(value: Any) -> Iterator[Mapping[str, Any]]:
    """Yield a mapping and all mappings in nested values."""
    if isinstance(value, Mapping):
        yield value
        for part in value.values():
            yield from _mappings(part)
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from _mappings(part)


def _texts(value: Any) -> Iterator[str]:
    """Yield all texts in nested values."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from _texts(part)
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from _texts(part)


def is_own(check: str) -> bool:
    """Return whether a check's name names a file beside the rubric."""
    return ".py" in check


def require_own(scope: Scope, check: str) -> None:
    """Raise ValueError unless there is such a function, of arguments that a check is called with."""
    _signature(definition_at(scope, check))


def own_parameters(scope: Scope, check: OwnCheck, value: Any) -> OwnParameters:
    """Validate the parameters of a lab's own check, by the annotations of the class that its function names."""
    found = definition_in(*check)
    context, _ = _signature(found)
    if scope.session is None and context != "Submission":
        raise ValueError(f"{check.name} looks at a recording; say which by the key session")
    return given(found, {} if value is None else value, scope)


def given(found: Definition, value: Any, scope: Scope | None = None) -> OwnParameters:
    """Return validated parameters of a lab's own check; without a scope, names in them are not looked up."""
    plain = _model_of_check(found).model_validate(value, context=scope)
    parameters = OwnParameters(**plain.model_dump(exclude_none=True, by_alias=True))
    parameters._traits = _traits(found)
    return parameters


def model_at(folder: Path, check: str) -> type[Parameters]:
    """Return the model of the parameters of a lab's own check, "file.py:function" in a folder.

    Raises ValueError if there is no such check.
    """
    return _model_of_check(definition_in(folder, check))


@lru_cache(maxsize=64)
def _model_of_check(found: Definition) -> type[Parameters]:
    _, given = _signature(found)
    if not given:
        return Parameters
    model = _model_named(given, found)
    assert model is not None
    return model


def _traits(found: Definition) -> Traits:
    """Return the properties that a check states, by the literals in its decorator `check(...)`."""
    stated: dict[str, Any] = {}
    try:
        for decorator in found.node.decorator_list:
            if isinstance(decorator, ast.Call) and _last_name(decorator.func) == "check":
                stated = {
                    str(each.arg): ast.literal_eval(each.value) for each in decorator.keywords
                }
        return Traits(**stated)
    except (TypeError, ValueError) as error:
        known = ", ".join(each.name for each in fields(Traits))
        words = f"{found.node.name} has a decorator whose arguments are not literals for {known}"
        raise ValueError(words) from error


def _signature(found: Definition) -> tuple[str, str]:
    """Return the types of a check's arguments: of what it looks at, and of its parameters, empty where it has none."""
    name, node = found.node.name, found.node
    if isinstance(node, ast.ClassDef):
        raise ValueError(
            f"{name} is a class; a check is a function (context: Context, p: Parameters) -> Finding"
        )
    arguments = [*node.args.posonlyargs, *node.args.args]
    if len(arguments) not in (1, 2) or node.args.kwonlyargs:
        raise ValueError(
            f"{name} must take (context: Context), or (context: Context, p: Parameters)"
        )
    looked_at = _type_named(arguments[0])
    if len(arguments) == 1:
        return looked_at, ""
    parameters = _type_named(arguments[1])
    if not _is_model(found.beside.get(parameters)):
        raise ValueError(
            f"the second argument of {name} must name the dataclass of its parameters, in the same file"
        )
    return looked_at, parameters


def _type_named(argument: ast.arg) -> str:
    """Return the last name in an argument's annotation; empty without one."""
    if argument.annotation is None:
        return ""
    return ast.unparse(argument.annotation).strip("'\"").rpartition(".")[2]


def _is_model(made: ast.AST | None) -> bool:
    """Tell whether a definition can be that of a check's parameters: a class with a base or a decorator."""
    if not isinstance(made, ast.ClassDef):
        return False
    return bool(made.bases or made.decorator_list)
