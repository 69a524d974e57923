"""What the Python files of a lab declare, read without executing them: settings of its reference nodes, its own checks.

A rubric may name a function or a class of a file beside it. To check the rubric, its annotations are enough: parameters
that are annotated with a name of `LAB_TYPES` are looked up like those of built-in checks.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, ValidationInfo, create_model

from grader.lab import references
from grader.lab.references import (
    Definition,
    Parameters,
    Reference,
    References,
    Scope,
    definition_at,
)

#: Version of what a lab's own checks are given (`grader.own_checks`).
API_VERSION = 1
#: Names of types in `grader.lab.references` by which a lab's own check may annotate its parameters.
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
    *("Pattern", "Patterns", "Share"),
)
_KNOWN: dict[str, Any] = {
    **{"float": float, "int": int, "bool": bool, "str": str, "Literal": Literal},
    **{"list": list, "tuple": tuple, "dict": dict, "Sequence": Sequence, "Mapping": Mapping},
    **{name: getattr(references, name) for name in LAB_TYPES},
}
_NO_BASES = ("BaseModel", "object", "Parameters")


class _Open(Parameters):
    """Has fields that are not known here."""

    model_config = ConfigDict(extra="allow")


def model_of(found: Definition) -> type[Parameters]:
    """Return the model of a class in a lab's file, as far as its annotations say it.

    A field without a value is required. What bases from elsewhere add, and limits of values, is not known here.
    """
    assert isinstance(found.node, ast.ClassDef)
    names = [
        name
        for base in found.node.bases
        if (name := ast.unparse(base).rpartition(".")[2]) not in _NO_BASES
    ]
    bases = [_model_named(name, found) or _Open for name in names]
    typed: dict[str, Any] = {}
    for node in found.node.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            typed[node.target.id] = (_type_of(node.annotation, found), _value(node.value))
    return create_model(found.node.name, __base__=tuple(bases) or (Parameters,), **typed)


def _model_named(name: str, found: Definition) -> type[Parameters] | None:
    node = found.beside.get(name)
    # A class within itself is left to the file.
    inner = {other: each for other, each in found.beside.items() if each is not found.node}
    return (
        model_of(Definition(node, inner))
        if isinstance(node, ast.ClassDef) and name in inner
        else None
    )


def _value(node: ast.expr | None) -> Any:
    """Return the value of a field: `...` where it has none, None where only the file itself can tell."""
    with suppress(ValueError):
        return ... if node is None else ast.literal_eval(node)
    return None


def _type_of(node: ast.expr, found: Definition) -> Any:
    """Return the type that an annotation stands for; Any where it is none that is known here."""
    try:
        return _annotated(node, found)
    except (TypeError, ValueError, SyntaxError):
        return Any


def _annotated(node: ast.expr, found: Definition) -> Any:
    if isinstance(node, ast.Constant):
        text = node.value if isinstance(node.value, str) else ""
        return _annotated(ast.parse(text, mode="eval").body, found) if text else type(node.value)
    if isinstance(node, (ast.Name, ast.Attribute)):
        name = node.id if isinstance(node, ast.Name) else node.attr
        return _KNOWN.get(name) or _model_named(name, found) or Any
    if isinstance(node, ast.BinOp):
        either = [_annotated(side, found) for side in (node.left, node.right)]
        return Any if Any in either else reduce(or_, either)
    if not isinstance(node, ast.Subscript) or (kind := _annotated(node.value, found)) is Any:
        return Any
    inner = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    # Those of a Literal, and the dots of a tuple, stand for themselves.
    of = (
        ast.literal_eval(n) if kind is Literal or ast.unparse(n) == "..." else _annotated(n, found)
        for n in inner
    )
    return kind[tuple(of)]


def _settings(scope: Scope, value: Mapping[str, Any], info: ValidationInfo) -> None:
    """Look settings up in the class that the rubric names for those of the reference node before them."""
    try:
        found = definition_at(scope, scope.settings_of(info.data.get("reference") or ""))
    except ValueError:
        return  # None is named, or it is a mistake where it stands.
    if isinstance(found.node, ast.ClassDef):
        model_of(found).model_validate(value, context=scope)


Settings = Annotated[dict[str, Any], Reference("Settings of the reference node.", _settings)]


# -- checks of a lab's own -------------------------------------------------------------------------


class OwnParameters(Parameters):
    """What a rubric gives to a check of the lab's own; of its types once the check's file is executed."""

    model_config = ConfigDict(extra="allow")

    def references(self) -> References:
        """Return each text as a name and as a label: an author may annotate a topic as plain `str`."""
        texts = frozenset(_texts(self.model_dump()))
        return References(texts, texts)


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
    """Whether a check's name is that of a file beside the rubric."""
    return ".py" in check


def require_own(scope: Scope, check: str) -> None:
    """Raise ValueError unless there is such a function, of arguments that a check is called with."""
    _signature(definition_at(scope, check))


def own_parameters(scope: Scope, check: str, value: Any) -> OwnParameters:
    """Validate the parameters of a lab's own check, by the annotations of the class that its function names."""
    found = definition_at(scope, check)
    context, given = _signature(found)
    if scope.session is None and context != "Submission":
        raise ValueError(f"{check} looks at a recording; say which by the key session")
    model = _model_named(given, found) if given else Parameters
    assert model is not None
    plain = model.model_validate({} if value is None else value, context=scope)
    return OwnParameters(**plain.model_dump(exclude_none=True, by_alias=True))


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
    typed = [
        ast.unparse(a.annotation).strip("'\"").rpartition(".")[2] if a.annotation else ""
        for a in arguments
    ]
    made = found.beside.get("".join(typed[1:]))
    if len(typed) == 2 and not _is_model(made):
        raise ValueError(
            f"the second argument of {name} must name the dataclass of its parameters, in the same file"
        )
    return typed[0], "".join(typed[1:])


def _is_model(made: ast.AST | None) -> bool:
    """Tell whether a definition can be that of a check's parameters: a class with a base or a decorator."""
    if not isinstance(made, ast.ClassDef):
        return False
    return bool(made.bases or made.decorator_list)
