"""Parameters of nodes (values, rules and files) and remappings, with their form in XML and YAML."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from launch._base import (
    POSITIONAL,
    Field,
    Located,
    SomeSubstitutionsType_types_tuple,
    Substitution,
    SubstitutionFailure,
    Text,
    Typed,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from launch.utilities.type_utils import normalize_typed_substitution, perform_typed_substitution

from launch_plan.inside.problems import blaming, mistake


class ParameterValue(Located):
    """A value, perhaps with its type."""

    value: Any = Field(positional=POSITIONAL)
    value_type = Field(None)

    def made(self) -> None:
        self.value = normalize_typed_substitution(self.given["value"], self.value_type)

    def evaluate(self, context: Any) -> Any:
        self.value = perform_typed_substitution(context, self.value, self.value_type)
        return self.value


class Parameter(Located):
    """A name with a value, passed on the command line."""

    name = Text(positional=POSITIONAL, types=SomeSubstitutionsType_types_tuple)
    value: Any = Field(positional=POSITIONAL)
    value_type = Field(None)

    def made(self) -> None:
        self.__value = ParameterValue(self.given["value"], value_type=self.value_type)

    def evaluate(self, context: Any) -> tuple[str, Any]:
        return perform_substitutions(context, self.name), self.__value.evaluate(context)


def _path(value: Any) -> list[Substitution]:
    if isinstance(value, (str, Path, Substitution)):
        return normalize_to_list_of_substitutions(value)
    if isinstance(value, (os.PathLike, bytes)):
        value = os.fsdecode(value)
    return normalize_to_list_of_substitutions(value)


class ParameterFile(Located):
    """A parameter file, perhaps with substitutions inside."""

    param_file = Field(
        positional=POSITIONAL,
        normal=_path,
        types=(*SomeSubstitutionsType_types_tuple, os.PathLike, bytes),
        remedy="Let each item of parameters be a dict or the path of a file.",
    )
    # XML and YAML give a list of substitutions.
    allow_substs = Typed(
        False, kind=bool, types=(bool, list), remedy="Write allow_substs=True, or leave it out."
    )

    def evaluate(self, context: Any) -> Path:
        """Return the path of the file, or of a copy with its substitutions resolved."""
        path = Path(perform_substitutions(context, self.param_file))
        if not perform_typed_substitution(context, self.allow_substs, bool):
            return path
        import yaml
        from launch.frontend.parse_substitution import parse_substitution

        # Substitutions in comments are resolved too.
        resolved = perform_substitutions(context, parse_substitution(path.read_text()))
        try:
            yaml.safe_load(resolved)
        except Exception as error:
            message = f"the parameter file '{path}' is not valid YAML after its substitutions"
            raise SubstitutionFailure(message) from error
        return Path(context.session.files.add(path.stem, ".yaml", resolved))


# -- in XML and YAML launch files ------------------------------------------------------------------


def read_remappings(entity: Any, parser: Any) -> Any:
    """Return the rules of the elements `<remap>` inside an element."""

    def read(rule: Any) -> tuple[Any, Any]:
        source = parser.parse_substitution(rule.get_attr("from"))
        return source, parser.parse_substitution(rule.get_attr("to"))

    return entity.each("remap", read) or None


def read_parameters(entity: Any, parser: Any) -> Any:
    """Return the parameters of the elements `<param>` inside an element."""

    def read(param: Any) -> Any:
        with blaming(param):
            return _parse_param(param, parser)

    return entity.each("param", read) or None


_TYPE_NAMES = (
    "int",
    "float",
    "bool",
    "str",
    "list_of_int",
    "list_of_float",
    "list_of_bool",
    "list_of_str",
    "yaml",
)


def _bad(message: str, remedy: str = "Correct this element of the file.") -> Any:
    return mistake(RuntimeError, message, "bad_markup", remedy)


def _type_named(name: str | None) -> Any:
    from typing import List  # noqa: UP035

    if name is None or name == "yaml":
        return None
    if name not in _TYPE_NAMES:
        message = f"the type '{name}' is not one of {', '.join(_TYPE_NAMES)}"
        raise _bad(message, "Use one of the types.")
    scalar = {"int": int, "float": float, "bool": bool, "str": str}[name.removeprefix("list_of_")]
    return List[scalar] if name.startswith("list_of_") else scalar  # type: ignore[valid-type]  # noqa: UP006


def _parse_param(param: Any, parser: Any) -> Any:
    source = param.get_attr("from", optional=True)
    name = param.get_attr("name", optional=True)
    allow = param.get_attr("allow_substs", data_type=bool, optional=True)
    if source is not None and name is not None:
        raise _bad("a <param> has either 'name' or 'from'")
    if source is None and allow is not None:
        raise _bad("a <param> has 'allow_substs' only with 'from'")
    if source is not None:
        allow = parser.parse_substitution(allow) if isinstance(allow, str) else bool(allow)
        return ParameterFile(parser.parse_substitution(source), allow_substs=allow)
    if name is None:
        raise _bad("a <param> needs 'name' or 'from'")
    return _named_param(param, parser)


def _named_param(param: Any, parser: Any) -> dict[Any, Any]:
    name = tuple(parser.parse_substitution(param.get_attr("name")))
    type_name = param.get_attr("type", optional=True)
    kind = _type_named(type_name)
    value = param.get_attr("value", data_type=kind, optional=True)
    inner = param.nested("param")
    if inner and (value is not None or kind is not None):
        raise _bad("a <param> has either 'value' and 'type', or others inside")
    if value is not None:
        return {name: ParameterValue(parser.parse_if_substitutions(value), value_type=kind)}
    if not inner:
        raise _bad("a <param> needs 'value' or others inside")
    content: dict[Any, Any] = {}
    for read in param.each("param", lambda each: _named_param(each, parser)):
        content.update(read)
    return {name: content}
