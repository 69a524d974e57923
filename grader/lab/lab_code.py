"""Declarations in Python files of a lab, read without executing them: settings of reference nodes, own checks.

A rubric can name a function or a class of a file beside it. Its annotations are enough to check the rubric: parameters
annotated with a name of `LAB_TYPES` are looked up like parameters of built-in checks.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, ValidationInfo, create_model

from grader.lab import references
from grader.lab.references import Definition, Parameters, Reference, Scope, definition_at

#: Version of the interface for a lab's own checks (`grader.own_checks`).
API_VERSION = 1
#: Names of types in `grader.lab.references` for annotations of a lab's own check.
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
    """Model with unknown additional fields."""

    model_config = ConfigDict(extra="allow")


def model_of(found: Definition) -> type[Parameters]:
    """Return the model of a class in a lab's file, as far as its annotations tell.

    A field without a value is required. Fields of bases from other files, and limits of values, are unknown here.
    """
    assert isinstance(found.node, ast.ClassDef)
    bases = []
    for base in found.node.bases:
        name = ast.unparse(base).rpartition(".")[2]
        if name not in _NO_BASES:
            bases.append(_model_named(name, found) or _Open)
    typed: dict[str, Any] = {}
    for node in found.node.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            typed[node.target.id] = (_type_of(node.annotation, found), _value(node.value))
    return create_model(found.node.name, __base__=tuple(bases) or (Parameters,), **typed)


def _model_named(name: str, found: Definition) -> type[Parameters] | None:
    """Return the model of a class in a lab's file by its name; None for another name, or for the class itself."""
    node = found.beside.get(name)
    if not isinstance(node, ast.ClassDef) or node is found.node:
        return None
    inner = {other: each for other, each in found.beside.items() if each is not found.node}
    return model_of(Definition(node, inner))


def _value(node: ast.expr | None) -> Any:
    """Return the value of a field: `...` without a value, None if only execution can tell."""
    with suppress(ValueError):
        return ... if node is None else ast.literal_eval(node)
    return None


def _type_of(node: ast.expr, found: Definition) -> Any:
    """Return the type of an annotation; Any for an unknown one."""
    try:
        return _annotated(node, found)
    except (TypeError, ValueError, SyntaxError):
        return Any


def _annotated(node: ast.expr, found: Definition) -> Any:
    if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value:
        return _annotated(ast.parse(node.value, mode="eval").body, found)
    if isinstance(node, ast.Constant):
        return type(node.value)
    if isinstance(node, ast.Name):
        return _named(node.id, found)
    if isinstance(node, ast.Attribute):
        return _named(node.attr, found)
    found_type: Any = Any
    if isinstance(node, ast.BinOp):
        either = [_annotated(node.left, found), _annotated(node.right, found)]
        if Any not in either:
            found_type = either[0] | either[1]
    elif isinstance(node, ast.Subscript):
        found_type = _subscripted(node, found)
    return found_type


def _named(name: str, found: Definition) -> Any:
    return _KNOWN.get(name) or _model_named(name, found) or Any


def _subscripted(node: ast.Subscript, found: Definition) -> Any:
    """Return a type with arguments, such as `list[float]`."""
    kind = _annotated(node.value, found)
    if kind is Any:
        return Any
    inner = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    arguments = []
    for each in inner:
        # The values of a Literal, and the dots of a tuple, are no types.
        if kind is Literal or ast.unparse(each) == "...":
            arguments.append(ast.literal_eval(each))
        else:
            arguments.append(_annotated(each, found))
    return kind[tuple(arguments)]


def _settings(scope: Scope, value: Mapping[str, Any], info: ValidationInfo) -> None:
    """Check settings by the class that the rubric names for the reference node before them."""
    try:
        found = definition_at(scope, scope.settings_of(info.data.get("reference") or ""))
    except ValueError:
        # No class is named, or its own place has the mistake.
        return
    if isinstance(found.node, ast.ClassDef):
        model_of(found).model_validate(value, context=scope)


Settings = Annotated[dict[str, Any], Reference("Settings of the reference node.", _settings)]


# -- checks of a lab's own -------------------------------------------------------------------------


class OwnParameters(Parameters):
    """Parameters of a lab's own check; they get their types when the check's file is executed."""

    model_config = ConfigDict(extra="allow")


def is_own(check: str) -> bool:
    """Return whether a check's name is one of a file beside the rubric."""
    return ".py" in check


def require_own(scope: Scope, check: str) -> None:
    """Raise ValueError unless a check's function exists, with the arguments of a check."""
    _signature(definition_at(scope, check))


def own_parameters(scope: Scope, check: str, value: Any) -> OwnParameters:
    """Validate the parameters of a lab's own check, by the annotations of the class in its function's signature."""
    found = definition_at(scope, check)
    context, given = _signature(found)
    if scope.session is None and context != "Submission":
        raise ValueError(f"{check} looks at a recording; say which by the key session")
    model = _model_named(given, found) if given else Parameters
    assert model is not None
    plain = model.model_validate({} if value is None else value, context=scope)
    return OwnParameters(**plain.model_dump(exclude_none=True, by_alias=True))


def _signature(found: Definition) -> tuple[str, str]:
    """Return the types of a check's arguments: of its context, and of its parameters, empty without any."""
    node = found.node
    name = node.name
    if isinstance(node, ast.ClassDef):
        raise ValueError(
            f"{name} is a class; a check is a function (context: Context, p: Parameters) -> Finding"
        )
    arguments = [*node.args.posonlyargs, *node.args.args]
    if len(arguments) not in (1, 2) or node.args.kwonlyargs:
        raise ValueError(
            f"{name} must take (context: Context), or (context: Context, p: Parameters)"
        )
    typed = list(map(_annotation, arguments))
    made = found.beside.get("".join(typed[1:]))
    if len(typed) == 2 and not _is_model(made):
        raise ValueError(
            f"the second argument of {name} must name the dataclass of its parameters, in the same file"
        )
    return typed[0], "".join(typed[1:])


def _annotation(argument: ast.arg) -> str:
    """Return the name of an argument's type, without its module; empty without an annotation."""
    if argument.annotation is None:
        return ""
    return ast.unparse(argument.annotation).strip("'\"").rpartition(".")[2]


def _is_model(made: ast.AST | None) -> bool:
    """Return whether a definition can define a check's parameters: a class with a base or a decorator."""
    if not isinstance(made, ast.ClassDef):
        return False
    return bool(made.bases or made.decorator_list)
