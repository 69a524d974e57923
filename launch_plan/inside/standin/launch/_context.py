"""The state of a launch: configurations, environment, locals, event handlers."""

from __future__ import annotations

import collections
import itertools
import os
from collections.abc import MutableMapping
from typing import Any

from launch_plan.inside import executor as _executor

from ._base import Substitution, perform_substitution


def evaluate(file: str, arguments: dict[str, Any], root: str) -> Any:
    """Evaluate a launch file as `ros2 launch FILE name:=value` would, and return the plan, ready for JSON."""
    context = LaunchContext()
    context.session = _executor.Executor(root)
    return context.session.evaluate(context, file, arguments)


class _Locals:
    def __init__(self, values: dict[str, Any]) -> None:
        self.__dict__["_values"] = values

    def __getattr__(self, key: str) -> Any:
        try:
            return self.__dict__["_values"][key]
        except KeyError:
            known = ", ".join(self.__dict__["_values"])
            raise AttributeError(f"context.locals has no '{key}'; it has: {known}") from None

    def __setattr__(self, key: str, value: Any) -> None:
        raise AttributeError(f"context.locals are read-only, so '{key}' cannot be set")


class Configurations(dict[str, Any]):
    def __missing__(self, key: str) -> Any:
        raise KeyError(f"launch configuration '{key}' does not exist")


class LaunchContext:
    def __init__(self, *, argv: list[str] | None = None, noninteractive: bool = False) -> None:
        self.argv = argv or []
        self.noninteractive = noninteractive
        self.is_shutdown = False
        self.asyncio_loop = None
        self.session = _executor.Executor()
        self.anonymous_numbers = itertools.count()
        self.process_numbers = itertools.count(1)
        self._event_handlers: collections.deque[Any] = collections.deque()
        self.__globals: dict[str, Any] = {}
        self.__locals: dict[str, Any] = {}
        self.__locals_stack: list[dict[str, Any]] = []
        self.__configurations = Configurations()
        self.__configurations_stack: list[Configurations] = []
        self.__environment_stack: list[dict[str, str]] = []

    def _set_is_shutdown(self, state: bool) -> None:
        self.is_shutdown = state

    @property
    def launch_configurations(self) -> dict[str, Any]:
        return self.__configurations

    @property
    def environment(self) -> MutableMapping[str, str]:
        return os.environ

    @property
    def locals(self) -> _Locals:
        return _Locals(self.get_locals_as_dict())

    def get_locals_as_dict(self) -> dict[str, Any]:
        return {**self.__globals, **self.__locals}

    def get_locals_keys(self) -> Any:
        return self.get_locals_as_dict().keys()

    def extend_globals(self, extensions: dict[str, Any]) -> None:
        self.__globals.update(extensions)

    def extend_locals(self, extensions: dict[str, Any]) -> None:
        self.__locals.update(extensions)

    def _push_locals(self) -> None:
        self.__locals_stack.append(dict(self.__locals))

    def _pop_locals(self) -> None:
        self.__locals = self.__locals_stack.pop()

    def _push_launch_configurations(self) -> None:
        self.__configurations_stack.append(Configurations(self.__configurations))

    def _pop_launch_configurations(self) -> None:
        if not self.__configurations_stack:
            raise RuntimeError("there are no launch configurations to pop")
        self.__configurations = self.__configurations_stack.pop()

    def _push_environment(self) -> None:
        self.__environment_stack.append(dict(os.environ))

    def _pop_environment(self) -> None:
        if not self.__environment_stack:
            raise RuntimeError("there is no environment to pop")
        self._replace_environment(self.__environment_stack.pop())

    def _reset_environment(self) -> None:
        self._replace_environment(self.session.initial_environment)

    def _replace_environment(self, environment: dict[str, str]) -> None:
        for name in set(os.environ) - set(environment):
            del os.environ[name]
        os.environ.update(environment)

    def perform_substitution(self, substitution: Substitution) -> str:
        return perform_substitution(self, substitution)

    def would_handle_event(self, event: Any) -> bool:
        return any(handler.matches(event) for handler in self._event_handlers)

    def register_event_handler(self, event_handler: Any, append: bool = False) -> None:
        """Add a handler before all others, or after them with `append`."""
        if append:
            self._event_handlers.append(event_handler)
        else:
            self._event_handlers.appendleft(event_handler)

    def unregister_event_handler(self, event_handler: Any) -> None:
        self._event_handlers.remove(event_handler)

    def emit_event_sync(self, event: Any) -> None:
        self.session.emit(event, self)

    async def emit_event(self, event: Any) -> None:
        self.emit_event_sync(event)

    def add_completion_future(self, completion_future: Any) -> None:
        """Ignore a future, because nothing waits for it."""
