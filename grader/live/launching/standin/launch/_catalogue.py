"""What the real packages hold besides the stand-in's own names.

A name that is not in the stand-in does not exist in ROS 2 Jazzy either: `import` fails as it would there.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

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
        "event_named on_action_event_base on_execution_complete on_include_launch_description on_process_exit "
        "on_process_io on_process_start on_shutdown"
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
        "normalize_to_list_of_substitutions_impl perform_substitutions_impl signal_management typing_file_path "
        "visit_all_entities_and_collect_futures_impl"
    ),
    "launch.descriptions": "executable",
    "launch.frontend": "entity parser type_utils",
    "launch.logging": "handlers",
    "launch_xml": "entity parser",
    "launch_xml.launch_description_sources": "xml_launch_description_source",
    "launch_yaml": "entity parser",
    "launch_yaml.launch_description_sources": "yaml_launch_description_source",
    "launch_ros.actions": (
        "composable_node_container lifecycle_node lifecycle_transition load_composable_nodes node "
        "push_ros_namespace ros_timer set_parameter set_parameters_from_file set_remap set_ros_log_dir "
        "set_use_sim_time"
    ),
    "launch_ros.descriptions": "composable_lifecycle_node composable_node",
    "launch_ros.substitutions": "executable_in_package find_package parameter",
    "launch_ros.utilities": (
        "evaluate_parameters namespace_utils normalize_parameters normalize_remap_rule "
        "plugin_support to_parameters_list track_node_names"
    ),
    "launch_ros.events.lifecycle": "change_state state_transition lifecycle_node_matchers",
    "launch_ros.events": "matchers",
    "launch_ros.event_handlers": "on_state_transition",
    "launch_ros.events.matchers": "matches_node_name",
    "launch_ros": "parameters_type remap_rule_type default_launch_description ros_adapters",
}

# Names of types, which stand in annotations alone.
_TYPES = (
    "TargetType FilePath OptionalText ParameterDescription ParameterValueDescription Parameters ParametersDict "
    "ParameterName EvaluatedParameters EvaluatedParameterValue RemapRule RemapRules SomeParameters "
    "SomeParameterFile SomeParameterName SomeParameterValue SomeParameterValue_types_tuple SomeParametersDict "
    "SomeRemapRule SomeRemapRules"
)


# What Jazzy has and nobody evaluates: the name can be imported, and to use it ends in "not assessable here".
_UNEVALUATED = (
    "AsyncSafeSignalManager ExtractSubstitution NodeActionExtension ROSAdapter get_ros_adapter get_ros_node "
    "get_composable_node_load_request get_extensions instantiate_extension get_grammar_path to_parameters_list "
    "visit_all_entities_and_collect_futures match_node_name_goal match_node_name_start_goal "
    "get_data_type_from_identifier check_is_list_entity format_action format_entities format_event_handler "
    "format_substitutions indent tree_like_indent LaunchService LaunchLogger log_launch_config reset "
    "PluginException get_upper_bound_caret_version satisfies_version"
)


class _Unevaluated:
    """Something of the real packages that can be imported here, and does nothing."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        return self()

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        from ._base import UnsupportedByStandin

        raise UnsupportedByStandin(f"{self._name} is not evaluated by this grader", name=self._name.partition(".")[0])


def missing_name(module: str, name: str) -> Any:
    """What a module answers for a name that it does not hold.

    Raises
    ------
    AttributeError
        There is none; Python turns this into an ImportError for `from module import name`.
    """
    if name in _UNEVALUATED.split():
        return _Unevaluated(f"{module}.{name}")
    if name.startswith("__") or name not in SUBMODULES.get(module, "").split():
        raise AttributeError(f"module '{module}' has no attribute '{name}'")
    return importlib.import_module(f"{module}.{name}")


def exported(module: str, *others: str) -> list[str]:
    """The `__all__` of a module: what it and its private modules define, and other names that it shows."""
    held = vars(sys.modules[module])
    own = [name for name, value in held.items() if getattr(value, "__module__", "").startswith(module)]
    return sorted(name for name in {*own, *others} if not name.startswith("_"))


def missing_name_of(module: str) -> Callable[[str], Any]:
    """The `__getattr__` of a module of the stand-in."""
    return lambda name: missing_name(module, name)


# Where the names of such a sub-module are kept, if not in its parent.
_HOMES = {"launch_ros.parameters_type": "launch_ros.parameter_descriptions"}


class _Submodule(ModuleType):
    """A sub-module of the real packages: it has its parent's names, and those of `launch` itself that it uses."""

    def __getattr__(self, name: str) -> Any:
        homes = (_HOMES.get(self.__name__, self.__name__.rpartition(".")[0]), "launch", "launch.frontend")
        for home in homes if not name.startswith("_") else ():
            module = importlib.import_module(home)
            if name in vars(module) or name in getattr(module, "__all__", ()):
                return getattr(module, name)
        return Any if name in _TYPES.split() else missing_name(self.__name__, name)


class _SubmoduleLoader(Loader):
    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = _Submodule(spec.name)
        module.__path__ = []
        return module

    def exec_module(self, module: ModuleType) -> None:
        held = vars(importlib.import_module(module.__name__.rpartition(".")[0]))
        names = {n: v for n, v in held.items() if not n.startswith("_") and not isinstance(v, ModuleType)}
        vars(module).update(names)


class SubmoduleFinder(MetaPathFinder):
    """Finds the real packages' sub-modules, whose names the stand-in keeps in their parents."""

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        """The spec of such a sub-module."""
        parent, _, name = fullname.rpartition(".")
        if name not in SUBMODULES.get(parent, "").split():
            return None
        return ModuleSpec(fullname, _SubmoduleLoader(), is_package=True)


if not any(type(finder).__name__ == "SubmoduleFinder" for finder in sys.meta_path):
    sys.meta_path.append(SubmoduleFinder())
