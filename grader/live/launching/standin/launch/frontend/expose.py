"""Names under which XML and YAML launch files know actions and substitutions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from .._base import mistake, near

_ROS_1 = {
    "find": "Write $(find-pkg-share package) (ROS 1 wrote $(find package)).",
    "arg": "Write $(var name) (ROS 1 wrote $(arg name)).",
    "optenv": "Write $(env NAME default) (ROS 1 wrote $(optenv NAME default)).",
}
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


def instantiate_action(entity: Any, parser: Any) -> Any:
    """The action of an element."""
    return parser.parse_action(entity)


def instantiate_substitution(type_name: str, args: Any = None) -> Any:
    """The substitution of a name with some arguments.

    Raises
    ------
    RuntimeError
        There is no substitution of that name.
    """
    import launch_ros.substitutions  # noqa: F401 - makes its names known

    if type_name not in exposed_substitutions:
        known = ", ".join(sorted(exposed_substitutions))
        message = f"there is no substitution '$({type_name} ...)'; there are: {known}"
        remedy = _ROS_1.get(type_name) or near(type_name, exposed_substitutions) + "Correct the name."
        raise mistake(RuntimeError, message, "bad_markup", remedy)
    made, kwargs = exposed_substitutions[type_name].parse(args or [])
    return made(**kwargs)
