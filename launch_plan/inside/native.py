"""Evaluates a launch file with the real `launch`, on a machine that has it, into the plan of the stand-in.

Entities are visited as a launch service visits them, but an action that would start a process, wait, or talk with
a running node, does what the executor makes of it: the same as that of the stand-in.
"""

from __future__ import annotations

import sys
from typing import Any

from launch_plan.inside.executor import Executor
from launch_plan.inside.installed import find_executable
from launch_plan.inside.processes import text_of


def evaluate(file: str, arguments: dict[str, Any], root: str) -> dict[str, Any]:
    """Evaluate a launch file as `ros2 launch FILE name:=value` would; see `Executor.evaluate`."""
    from launch import LaunchContext

    executor = Executor(root)
    _remember_lines(root)
    _replace(executor)
    context = LaunchContext(argv=[f"{name}:={value}" for name, value in arguments.items()])
    _set(context, "emit_event_sync", lambda event: executor.emit(event, context))
    return executor.evaluate(context, file, arguments)


def _set(target: Any, name: str, value: Any) -> None:
    setattr(target, name, value)


def _remember_lines(root: str) -> None:
    """Let every action, and every node for a container, keep the line of the submission that constructs it."""
    from launch import Action
    from launch_ros.descriptions import ComposableNode

    for kind in (Action, ComposableNode):
        _set(kind, "__init__", _with_line(kind.__init__, root))


def _with_line(construct: Any, root: str) -> Any:
    def constructed(made: Any, *args: Any, **kwargs: Any) -> None:
        construct(made, *args, **kwargs)
        frame = sys._getframe(1)
        while frame is not None and not frame.f_code.co_filename.startswith(f"{root}/"):
            frame = frame.f_back  # type: ignore[assignment]
        if frame is not None:
            made.source_line = (frame.f_code.co_filename, frame.f_lineno)

    return constructed


def _replace(executor: Executor) -> None:
    """Let actions do what the executor makes of them, and executables be found with what it says of them."""
    from launch import Action, actions
    from launch_ros import actions as ros_actions
    from launch_ros.substitutions import ExecutableInPackage

    for kind, execute in {
        actions.LogInfo: executor.log,
        actions.TimerAction: executor.wait,
        actions.ExecuteLocal: executor.start,
        actions.OpaqueCoroutine: executor.skip_coroutine,
        ros_actions.LoadComposableNodes: executor.load,
        ros_actions.ROSTimer: executor.wait,
        ros_actions.LifecycleNode: executor.start_lifecycle,
        ros_actions.SetUseSimTime: executor.follow_sim_time,
    }.items():
        _set(kind, "execute", lambda action, context, execute=execute: execute(action, context))
    _set(Action, "visit", lambda action, context: executor.visit_action(action, context))
    declare, include = (
        actions.DeclareLaunchArgument.execute,
        actions.IncludeLaunchDescription.execute,
    )

    def note_argument(action: Any, context: Any) -> Any:
        executor.declare(action, context)
        return declare(action, context)

    def note_include(action: Any, context: Any) -> Any:
        entities = include(action, context)
        executor.enter(action, context)
        return entities

    def found(substitution: Any, context: Any) -> str:
        package = text_of(substitution.package, context)
        return find_executable(text_of(substitution.executable, context), package, executor.root)

    _set(actions.DeclareLaunchArgument, "execute", note_argument)
    _set(actions.IncludeLaunchDescription, "execute", note_include)
    _set(ExecutableInPackage, "perform", found)
