"""Conditions of actions."""

from __future__ import annotations

from typing import Any

from launch_plan.inside.problems import mistake

from .._base import (
    POSITIONAL,
    Condition,
    Field,
    InvalidConditionExpressionError,
    Text,
    perform_substitutions,
)


def evaluate_condition_expression(context: Any, expression: Any) -> bool:
    """Return the truth value of a text, e.g. False for `0`."""
    text = perform_substitutions(context, expression).strip().lower()
    if text in ("true", "1"):
        return True
    if text in ("false", "0"):
        return False
    message = f"a condition must be one of true, 1, false, 0 (in any case), but it is '{text}'"
    remedy = "Let the condition be 'true' or 'false'."
    raise mistake(InvalidConditionExpressionError, message, "bad_condition", remedy)


class IfCondition(Condition):
    predicate = None
    predicate_expression = Text(positional=POSITIONAL)

    def holds(self, context: Any) -> bool:
        return evaluate_condition_expression(context, self.predicate_expression)

    def describe(self) -> str:
        return f"{type(self).__name__}({self.described('predicate_expression')})"


class UnlessCondition(IfCondition):
    def holds(self, context: Any) -> bool:
        return not super().holds(context)


class LaunchConfigurationEquals(Condition):
    predicate = None
    launch_configuration_name = Field(positional=POSITIONAL)
    expected_value = Text(None, POSITIONAL)

    def holds(self, context: Any) -> bool:
        subs = self.expected_value
        expected = None if subs is None else perform_substitutions(context, subs)
        return bool(context.launch_configurations.get(self.launch_configuration_name) == expected)

    def describe(self) -> str:
        expected = "None" if self.expected_value is None else self.described("expected_value")
        return f"{type(self).__name__}('{self.launch_configuration_name}', {expected})"


class LaunchConfigurationNotEquals(LaunchConfigurationEquals):
    def holds(self, context: Any) -> bool:
        return not super().holds(context)
