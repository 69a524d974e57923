"""What the real packages hold besides the stand-in's own names, and what later releases hold.

A name that is not in the stand-in does not exist in ROS 2 Jazzy either: `import` fails as it would there.
"""

from __future__ import annotations

import difflib
import importlib
import sys
from collections.abc import Callable
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

# Names that a later release has, and Jazzy has not: to import them fails there.
LATER: dict[str, frozenset[str]] = {
    "launch.actions": frozenset(
        {"ForEach", "ForLoop", "DeclareBooleanLaunchArgument", "Log", "LogDebug", "LogError", "LogWarning"}
    ),
    "launch.substitutions": frozenset(
        {
            "ForEachVar",
            "ForLoopIndex",
            "IsEmptySubstitution",
            "NotEmptySubstitution",
            "StringJoinSubstitution",
            "StringStripSubstitution",
        }
    ),
    "launch.conditions": frozenset({"AndCondition", "OrCondition"}),
}

#: Where a ROS machine keeps what is not here.
ELSEWHERE = "/opt/ros/jazzy"


def _beside_the_standin(name: str) -> ModuleType:
    """A module that the grader uses itself too, and which no launch file can import."""
    spec = spec_from_file_location(f"grader_{name}", Path(__file__).parents[2] / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


is_released: Callable[[str], bool] = _beside_the_standin("released").is_released
parameter_text = _beside_the_standin("parameter_text")

# Sub-modules of the real packages whose names a launch file may import from the module itself.
SUBMODULES: dict[str, str] = {
    "launch": (
        "action condition event event_handler launch_context launch_description "
        "launch_description_entity launch_description_source launch_service some_entities_type "
        "some_substitutions_type substitution invalid_launch_file_error launch_introspector"
    ),
    "launch.actions": (
        "append_environment_variable declare_launch_argument emit_event execute_local execute_process "
        "group_action include_launch_description log_info opaque_coroutine opaque_function "
        "pop_environment pop_launch_configurations push_environment push_launch_configurations "
        "register_event_handler reset_environment reset_launch_configurations set_environment_variable "
        "set_launch_configuration shutdown_action timer_action unregister_event_handler "
        "unset_environment_variable unset_launch_configuration"
    ),
    "launch.substitutions": (
        "anon_name boolean_substitution command environment_variable equals_substitution file_content "
        "find_executable if_else_substitution launch_configuration launch_log_dir local_substitution "
        "not_equals_substitution path_join_substitution path_substitution python_expression substitution_failure "
        "text_substitution this_launch_file this_launch_file_dir"
    ),
    "launch.conditions": (
        "if_condition unless_condition launch_configuration_equals launch_configuration_not_equals "
        "evaluate_condition_expression_impl invalid_condition_expression_error"
    ),
    "launch.event_handlers": (
        "event_named on_action_event_base on_execution_complete on_process_exit on_process_io "
        "on_process_start on_shutdown"
    ),
    "launch.events": "execution_complete include_launch_description matchers shutdown timer_event",
    "launch.events.process": (
        "process_exited process_io process_matchers process_started process_stderr process_stdin "
        "process_stdout process_targeted_event running_process_event shutdown_process signal_process"
    ),
    "launch.launch_description_sources": (
        "any_launch_description_source any_launch_file_utilities frontend_launch_description_source "
        "frontend_launch_file_utilities python_launch_description_source python_launch_file_utilities"
    ),
    "launch.utilities": (
        "class_tools_impl ensure_argument_type_impl normalize_to_list_of_entities_impl "
        "normalize_to_list_of_substitutions_impl perform_substitutions_impl"
    ),
    "launch.descriptions": "executable",
    "launch.frontend": "entity parser type_utils",
    "launch_ros.actions": (
        "composable_node_container lifecycle_node lifecycle_transition load_composable_nodes node "
        "push_ros_namespace ros_timer set_parameter set_parameters_from_file set_remap set_ros_log_dir "
        "set_use_sim_time"
    ),
    "launch_ros.descriptions": "composable_lifecycle_node composable_node",
    "launch_ros.substitutions": "executable_in_package find_package parameter",
    "launch_ros.utilities": (
        "evaluate_parameters namespace_utils normalize_parameters normalize_remap_rule "
        "to_parameters_list track_node_names"
    ),
    "launch_ros.events.lifecycle": "change_state state_transition lifecycle_node_matchers",
    "launch_ros.events": "matchers",
    "launch_ros.event_handlers": "on_state_transition",
    "launch_ros": "parameters_type remap_rule_type default_launch_description ros_adapters",
}

# Where the names of such a sub-module are really kept, if not in its parent.
_HOMES = {"launch.condition": "launch", "launch_ros.parameters_type": "launch_ros.parameter_descriptions"}


def missing_name(module: str, name: str) -> Any:
    """What a module's `__getattr__` answers for a name that it does not hold.

    Raises
    ------
    AttributeError
        There is none; Python turns this into an ImportError for `from module import name`.
    """
    if name.startswith("__") or name not in SUBMODULES.get(module, "").split():
        raise AttributeError(f"module '{module}' has no attribute '{name}'")
    return importlib.import_module(f"{module}.{name}")


def similar_names(module: str, name: str) -> list[str]:
    """Public names of a module that look like a misspelt one."""
    held = sys.modules.get(module)
    names = [n for n in dir(held) if not n.startswith("_")] if held else []
    lower = {n.lower(): n for n in names}
    found = difflib.get_close_matches(name.lower(), lower, n=3, cutoff=0.6)
    return [lower[n] for n in found]


def homes_of(name: str) -> list[str]:
    """Modules of the stand-in that hold a name: for an import from the wrong one."""
    return [
        module
        for module, held in sorted(sys.modules.items())
        if module.split(".")[0] in ("launch", "launch_ros") and name in getattr(held, "__all__", ())
    ]


class _SubmoduleLoader(Loader):
    def __init__(self, home: str) -> None:
        self._home = home

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        home = importlib.import_module(self._home)
        for name, value in vars(home).items():
            if not name.startswith("_") and not isinstance(value, ModuleType):
                setattr(module, name, value)


class SubmoduleFinder(MetaPathFinder):
    """Finds the real packages' sub-modules, whose names the stand-in keeps in their parents."""

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        """The spec of such a sub-module."""
        parent, _, name = fullname.rpartition(".")
        if name not in SUBMODULES.get(parent, "").split():
            return None
        return ModuleSpec(fullname, _SubmoduleLoader(_HOMES.get(fullname, parent)))


if not any(type(finder).__name__ == "SubmoduleFinder" for finder in sys.meta_path):
    sys.meta_path.append(SubmoduleFinder())
