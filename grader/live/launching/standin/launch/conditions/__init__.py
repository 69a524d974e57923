"""Conditions of actions."""

from __future__ import annotations

from typing import Any

from .._base import (
    Condition,
    InvalidConditionExpressionError,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from .._catalogue import missing_name

__all__ = [
    "IfCondition",
    "InvalidConditionExpressionError",
    "LaunchConfigurationEquals",
    "LaunchConfigurationNotEquals",
    "UnlessCondition",
    "evaluate_condition_expression",
]


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)


_TRUE = ("true", "1")
_FALSE = ("false", "0")


def evaluate_condition_expression(context: Any, expression: Any) -> bool:
    """Read a resolved text as a truth value.

    Raises
    ------
    InvalidConditionExpressionError
        It is none of the four accepted words, in any case.
    """
    text = perform_substitutions(context, expression).strip().lower()
    if text in _TRUE:
        return True
    if text in _FALSE:
        return False
    raise InvalidConditionExpressionError(
        f"a condition must be one of {', '.join(_TRUE + _FALSE)} (in any case), but it is '{text}'"
    )


class IfCondition(Condition):
    """Holds if its text says so."""

    def __init__(self, predicate_expression: Any) -> None:
        self.__expression = normalize_to_list_of_substitutions(predicate_expression)
        super().__init__(predicate=self._predicate_of_expression)

    def _predicate_of_expression(self, context: Any) -> bool:
        return evaluate_condition_expression(context, self.__expression)

    def describe(self) -> str:
        """Text for people."""
        return f"IfCondition({' + '.join(s.describe() for s in self.__expression)})"


class UnlessCondition(Condition):
    """Holds if its text says not."""

    def __init__(self, predicate_expression: Any) -> None:
        self.__expression = normalize_to_list_of_substitutions(predicate_expression)
        super().__init__(predicate=self._predicate_of_expression)

    def _predicate_of_expression(self, context: Any) -> bool:
        return not evaluate_condition_expression(context, self.__expression)

    def describe(self) -> str:
        """Text for people."""
        return f"UnlessCondition({' + '.join(s.describe() for s in self.__expression)})"


class LaunchConfigurationEquals(Condition):
    """Holds if a launch configuration has a value."""

    def __init__(self, launch_configuration_name: str, expected_value: Any) -> None:
        self.__name = launch_configuration_name
        self.__expected = None if expected_value is None else normalize_to_list_of_substitutions(expected_value)
        super().__init__(predicate=self._compare)

    def describe(self) -> str:
        """Text for people."""
        expected = "None" if self.__expected is None else " + ".join(s.describe() for s in self.__expected)
        return f"{type(self).__name__}('{self.__name}', {expected})"

    def _compare(self, context: Any) -> bool:
        expected = None if self.__expected is None else perform_substitutions(context, self.__expected)
        return bool(context.launch_configurations.get(self.__name) == expected)


class LaunchConfigurationNotEquals(LaunchConfigurationEquals):
    """Holds if a launch configuration has another value."""

    def _compare(self, context: Any) -> bool:
        return not super()._compare(context)
