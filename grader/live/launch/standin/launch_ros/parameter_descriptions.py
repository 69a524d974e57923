"""Parameters of nodes: values, rules and files."""

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


class ParameterValue(Located):
    """A value, perhaps with the type that it is to have."""

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


class _Path(Field):
    def normal(self, value: Any) -> Any:
        if isinstance(value, (str, Path, Substitution)) or not isinstance(value, (os.PathLike, bytes)):
            return normalize_to_list_of_substitutions(value)
        return normalize_to_list_of_substitutions(os.fsdecode(value))


class ParameterFile(Located):
    """A file of parameters, perhaps with substitutions in it."""

    param_file = _Path(
        positional=POSITIONAL,
        types=(*SomeSubstitutionsType_types_tuple, os.PathLike, bytes),
        remedy="Let each item of parameters be a dict or the path of a file.",
    )
    # A list of substitutions is what XML and YAML give.
    allow_substs = Typed(False, kind=bool, types=(bool, list), remedy="Write allow_substs=True, or leave it out.")

    def evaluate(self, context: Any) -> Path:
        """The path; of a file with substitutions, that of a copy in which they are resolved."""
        path = Path(perform_substitutions(context, self.param_file))
        if not perform_typed_substitution(context, self.allow_substs, bool):
            return path
        import yaml
        from launch.frontend.parse_substitution import parse_substitution

        resolved = perform_substitutions(context, parse_substitution(path.read_text()))  # comments too
        try:
            yaml.safe_load(resolved)
        except Exception as error:
            message = f"the parameter file '{path}' is not valid YAML after its substitutions"
            raise SubstitutionFailure(message) from error
        return Path(context.session.files.add(path.stem, ".yaml", resolved))
