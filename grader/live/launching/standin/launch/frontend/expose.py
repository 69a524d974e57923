"""Names under which XML and YAML launch files know actions and substitutions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

exposed_actions: dict[str, Any] = {}
exposed_substitutions: dict[str, Any] = {}

_T = TypeVar("_T")


def expose_action(name: str) -> Callable[[_T], _T]:
    """Make an action known to XML and YAML launch files."""

    def register(exposed: _T) -> _T:
        exposed_actions[name] = exposed
        return exposed

    return register


def expose_substitution(name: str) -> Callable[[_T], _T]:
    """Make a substitution known to XML and YAML launch files."""

    def register(exposed: _T) -> _T:
        exposed_substitutions[name] = exposed
        return exposed

    return register
