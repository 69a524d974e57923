"""Parameters of nodes: values, rules and files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from launch._base import (
    Located,
    SomeSubstitutionsType_types_tuple,
    SubstitutionFailure,
    ensure_argument_type,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from launch.utilities.type_utils import normalize_typed_substitution, perform_typed_substitution

__all__ = ["Parameter", "ParameterFile", "ParameterValue"]


class ParameterValue(Located):
    """A value, perhaps with the type that it is to have."""

    def __init__(self, value: Any, *, value_type: Any = None) -> None:
        self.__value = normalize_typed_substitution(value, value_type)
        self.__value_type = value_type
        self.__evaluated: Any = None

    @property
    def value(self) -> Any:
        """The value."""
        return self.__value if self.__evaluated is None else self.__evaluated

    @property
    def value_type(self) -> Any:
        """The type."""
        return self.__value_type

    def evaluate(self, context: Any) -> Any:
        """The value, resolved."""
        self.__evaluated = perform_typed_substitution(context, self.value, self.value_type)
        return self.__evaluated


class Parameter(Located):
    """A name with a value, passed on the command line."""

    def __init__(self, name: Any, value: Any, *, value_type: Any = None) -> None:
        ensure_argument_type(name, SomeSubstitutionsType_types_tuple, "name", "Parameter")
        self.__name = normalize_to_list_of_substitutions(name)
        self.__value = ParameterValue(value, value_type=value_type)

    @property
    def name(self) -> Any:
        """The name."""
        return self.__name

    @property
    def value(self) -> Any:
        """The value."""
        return self.__value.value

    @property
    def value_type(self) -> Any:
        """The type."""
        return self.__value.value_type

    def evaluate(self, context: Any) -> tuple[str, Any]:
        """Name and value, resolved."""
        return perform_substitutions(context, self.__name), self.__value.evaluate(context)


class ParameterFile(Located):
    """A file of parameters, perhaps with substitutions in it."""

    def __init__(self, param_file: Any, *, allow_substs: Any = False) -> None:
        types = (*SomeSubstitutionsType_types_tuple, os.PathLike, bytes)
        ensure_argument_type(param_file, types, "param_file", "ParameterFile")
        ensure_argument_type(allow_substs, bool, "allow_substs", "ParameterFile")
        if isinstance(param_file, SomeSubstitutionsType_types_tuple) and not isinstance(param_file, bytes):
            self.__file: Any = normalize_to_list_of_substitutions(param_file)
        else:
            self.__file = os.fsdecode(param_file)
        self.__allow_substs = normalize_typed_substitution(allow_substs, bool)

    @property
    def param_file(self) -> Any:
        """The path."""
        return self.__file

    @property
    def allow_substs(self) -> Any:
        """Whether there are substitutions in it."""
        return self.__allow_substs

    def evaluate(self, context: Any) -> tuple[Path, str | None]:
        """The path, and the resolved text if the file has substitutions.

        Raises
        ------
        SubstitutionFailure
            The text is no YAML.
        """
        path = Path(self.__file if isinstance(self.__file, str) else perform_substitutions(context, self.__file))
        if not perform_typed_substitution(context, self.__allow_substs, bool):
            return path, None
        import yaml
        from launch.frontend.parse_substitution import parse_substitution

        resolved = perform_substitutions(context, parse_substitution(path.read_text()))  # comments too
        try:
            yaml.safe_load(resolved)
        except Exception as error:
            message = f"the parameter file '{path}' is not valid YAML after its substitutions"
            raise SubstitutionFailure(message) from error
        return path, resolved
