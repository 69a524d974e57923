"""Evaluation with the real `launch`, for a machine with ROS.

Entities are visited as by a launch service. Actions that would start a process, wait, or call a running node are
replaced by methods of the executor, as in the stand-in.
"""

from __future__ import annotations

import sys
from typing import Any

from launch_plan.inside.executor import Executor
from launch_plan.inside.installed import find_executable
from launch_plan.inside.processes import text_of


def evaluate(file: str, arguments: dict[str, Any], root: str) -> dict[str, Any]:
    """Evaluate a launch file as `ros2 launch FILE name:=value` would, and return the plan, ready for JSON."""
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
    """Let each action, and each node for a container, keep the line of the submission that constructs the object."""
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
    """Let actions call the executor, and let executables be found by `find_executable`."""
    from launch import Action, actions
    from launch_ros import actions as ros_actions
    from launch_ros.substitutions import ExecutableInPackage

    replaced = {
        actions.LogInfo: executor.log,
        actions.TimerAction: executor.wait,
        actions.ExecuteLocal: executor.start,
        actions.OpaqueCoroutine: executor.skip_coroutine,
        ros_actions.LoadComposableNodes: executor.load,
        ros_actions.ROSTimer: executor.wait,
        ros_actions.LifecycleNode: executor.start_lifecycle,
        ros_actions.SetUseSimTime: executor.follow_sim_time,
    }
    for kind, execute in replaced.items():
        _set(kind, "execute", _as_method(execute))
    _set(Action, "visit", _as_method(executor.visit_action))
    _note_before(actions.DeclareLaunchArgument, executor.declare)
    _note_after(actions.IncludeLaunchDescription, executor.enter)

    def found(substitution: Any, context: Any) -> str:
        package = text_of(substitution.package, context)
        return find_executable(text_of(substitution.executable, context), package, executor.root)

    _set(ExecutableInPackage, "perform", found)


def _as_method(function: Any) -> Any:
    """Return a function that a class binds to its objects; a bound method would not be bound again."""
    return lambda action, context: function(action, context)


def _note_before(kind: Any, note: Any) -> None:
    """Call a function of the executor before an action is executed."""
    execute = kind.execute

    def noted(action: Any, context: Any) -> Any:
        note(action, context)
        return execute(action, context)

    _set(kind, "execute", noted)


def _note_after(kind: Any, note: Any) -> None:
    """Call a function of the executor after an action is executed."""
    execute = kind.execute

    def noted(action: Any, context: Any) -> Any:
        entities = execute(action, context)
        note(action, context)
        return entities

    _set(kind, "execute", noted)
