"""One evaluation of a launch file: events in virtual time, and the plan that they build.

No process is started. Instead each one that would be is noted with what it waits for, and the events that
its start and its end would bring about are played in order: first everything that happens at once, then
the timers by their time, then the ends of processes, then the shutdown.
"""

from __future__ import annotations

import heapq
import itertools
import os
import re
from collections.abc import Callable, Iterable
from typing import Any

from ._base import SourceLine, blame, no_action

SUBSTITUTION_AS_TEXT = re.compile(r"<launch(_ros)?\.(substitutions|parameter_descriptions)[\w.]* object at 0x")

EVENT_LIMIT = 2000
PROCESS_LIMIT = 400
ENTITY_LIMIT = 10_000
LOG_LIMIT, LOG_LENGTH = 500, 2000
DEPTH_LIMIT = 150
INCLUDE_LIMIT = 20
EXIT_LIMIT = 2  # ends of processes that were started because another ended, and so on

_HOLDS_OTHERS = ("GroupAction", "IncludeLaunchDescription", "OpaqueFunction", "TimerAction")  # besides processes

_AT_ONCE, _TIMED, _EXITS, _SHUTDOWN = range(4)


class LimitExceededError(RuntimeError):
    """The launch description goes on without end."""


class Session:
    """What an evaluation has found so far."""

    def __init__(self) -> None:
        self.root = ""
        self.initial_environment = dict(os.environ)
        self.processes: list[dict[str, Any]] = []
        self.arguments: list[dict[str, Any]] = []
        self.includes: list[dict[str, Any]] = []
        self.logs: list[dict[str, Any]] = []
        self.warnings: list[dict[str, Any]] = []
        self.shutdowns: list[dict[str, Any]] = []
        self.signals: list[dict[str, Any]] = []
        self.parameter_files: dict[str, str] = {}
        self.components: list[dict[str, Any]] = []
        self.unassessed: list[dict[str, Any]] = []
        self.include_chain: list[str] = []
        self.when: dict[str, Any] | None = None
        self.anonymous_numbers = itertools.count()
        self.transitions: list[dict[str, Any]] = []
        self._deferred: list[Callable[[], None]] = []
        self._condition_of: dict[int, str] = {}
        self._queue: list[tuple[int, float, int, int, Any, dict[str, Any]]] = []
        self._ends_before = 0
        self._handled_last: Any = None
        self._visited = 0
        self._order = itertools.count()
        self._clock_s = 0.0
        self._names: dict[str, int] = {}
        self._process_numbers = itertools.count(1)

    def log(self, message: str, line: SourceLine | None) -> None:
        """Note what the launch file says, unless it has said more than anybody reads."""
        if len(self.logs) < LOG_LIMIT:
            self.logs.append({"message": message[:LOG_LENGTH], "when": self.when, "source": line})

    def warn(self, message: str, line: SourceLine | None) -> None:
        """Note something that does not stop the launch."""
        self.warnings.append({"message": message, "source": line})

    def warn_of_objects(self, texts: Iterable[str], line: SourceLine | None) -> None:
        """Warn if a substitution was turned into text before it could be resolved."""
        if any(SUBSTITUTION_AS_TEXT.search(text) for text in texts):
            message = "str() or an f-string made text of a substitution before it has a value"
            self.warn(f"{message}; write a list instead: ['text', LaunchConfiguration(...)]", line)

    def note_condition(self, action: Any, holds: bool) -> None:
        """Remember on what condition an action was carried out, or note that it was not."""
        described = action.condition.describe()
        if holds:
            self._condition_of[id(action)] = f"{described} holds"
        elif hasattr(action, "process_description") or type(action).__name__ in _HOLDS_OTHERS:
            self.unassessed.append(
                {
                    "what": type(action).__name__,
                    "why": f"{described} does not hold",
                    "source": action.source_line,
                }
            )

    def condition_note(self, action: Any) -> str:
        """On what condition an action was carried out."""
        return self._condition_of.get(id(action), "")

    def completed(self, action: Any) -> None:
        """Play the completion of an action, where a handler waits for it."""
        from .events import ExecutionComplete

        event = ExecutionComplete(action=action)
        if action.context_of_completion is not None and action.context_of_completion.would_handle_event(event):
            action.complete(event, self)

    def number_process(self, name: str) -> str:
        """The name of the next process, with its number."""
        return f"{name}-{next(self._process_numbers)}"

    def defer(self, work: Callable[[], None]) -> None:
        """Do something once all entities of the event that is being handled were visited, as a task would."""
        self._deferred.append(work)

    def do_deferred(self) -> None:
        """Do what was deferred."""
        while self._deferred:
            self._deferred.pop(0)()

    def emit(self, event: Any, when: dict[str, Any] | None = None, *, phase: int = _AT_ONCE) -> None:
        """Queue an event that happens at once, or in a later phase."""
        entry = (phase, self._clock_s, next(self._order), self._ends_before, event, when or {})
        heapq.heappush(self._queue, entry)

    def emit_exit(self, event: Any, when: dict[str, Any]) -> None:
        """Queue the end of a process, unless it is one of a chain that need not end, such as a restart."""
        if self._ends_before < EXIT_LIMIT:
            self.emit(event, when, phase=_EXITS)

    def emit_shutdown(self, event: Any) -> None:
        """Queue the end of the launch, once."""
        self.shutdowns.append({"reason": event.reason, "when": self.when, "source": event.source_line})
        if len(self.shutdowns) == 1:
            self.emit(event, {"on_shutdown": True}, phase=_SHUTDOWN)

    def emit_after(self, event: Any, after_s: float) -> None:
        """Queue an event for a later time."""
        when: dict[str, Any] = {"after_s": after_s}
        if self.when is not None and set(self.when) != {"after_s"}:
            when["since"] = self.when
        elif self.when is not None:
            when["after_s"] = after_s + self.when["after_s"]
        entry = (_TIMED, self._clock_s + after_s, next(self._order), self._ends_before, event, when)
        heapq.heappush(self._queue, entry)

    def play(self, context: Any) -> None:
        """Play all events.

        Raises
        ------
        LimitExceededError
            They do not end.
        """
        for _ in range(EVENT_LIMIT):
            if not self._queue:
                return
            phase, self._clock_s, _order, before, event, self.when = heapq.heappop(self._queue)
            self._ends_before = before + (phase == _EXITS)
            self.when = self.when or None
            try:
                self._dispatch(event, context)
            except Exception as error:
                if phase < _EXITS or isinstance(error, LimitExceededError):
                    raise
                self.warn(f"when this happens, it fails: {error}", getattr(error, "launch_source", None))
        endless = LimitExceededError(f"the launch description gives rise to more than {EVENT_LIMIT} events")
        blame(endless, getattr(event, "timer_action", self._handled_last))
        raise endless

    def _dispatch(self, event: Any, context: Any) -> None:
        context._set_is_shutdown(type(event).__name__ == "Shutdown")
        for handler in list(context.event_handlers):
            if not handler.matches(event):
                continue
            self._handled_last = handler
            context._push_locals()
            context.extend_locals({"event": event})
            try:
                visit_all(handler.handle(event, context), context, handler)
            except Exception as error:
                blame(error, getattr(event, "timer_action", handler))
                raise
            finally:
                context._pop_locals()
        self.do_deferred()

    def enter_include(self, file: str) -> None:
        """Note that a launch file is being visited.

        Raises
        ------
        LimitExceededError
            It includes itself without end.
        """
        self.include_chain.append(file)
        if self.include_chain.count(file) > INCLUDE_LIMIT:
            shown = os.path.relpath(file, self.root) if self.root else file
            raise LimitExceededError(f"'{shown}' includes itself without end")

    def count_visit(self) -> None:
        """Note that an entity is visited.

        Raises
        ------
        LimitExceededError
            There is no end of them.
        """
        self._visited += 1
        if self._visited > ENTITY_LIMIT:
            raise LimitExceededError(f"the launch description has more than {ENTITY_LIMIT} actions")

    def add_process(self, process: dict[str, Any]) -> None:
        """Note a process that would be started.

        Raises
        ------
        LimitExceededError
            There are too many.
        """
        if len(self.processes) >= PROCESS_LIMIT:
            raise LimitExceededError(f"the launch description starts more than {PROCESS_LIMIT} processes")
        self.processes.append(process)

    def add_file(self, name: str, suffix: str, text: str) -> str:
        """Keep the text of a file to be written when the process runs; the path as it stands in argv."""
        stem = "".join(c if c.isalnum() or c in "_-" else "_" for c in name) or "node"
        number = self._names[stem] = self._names.get(stem, 0) + 1
        filename = f"{stem}_{number}{suffix}"
        self.parameter_files[filename] = text
        return f"{{parameters}}/{filename}"


def visit_all(entities: Any, context: Any, parent: Any, depth: int = 0) -> None:
    """Visit entities, and what they yield, in order.

    Raises
    ------
    LimitExceededError
        They are nested without end.
    AttributeError
        One of them is no entity.
    """
    from ._base import LaunchDescriptionEntity
    from .event_handlers import BaseEventHandler

    if depth > DEPTH_LIMIT:
        raise LimitExceededError("the launch description is nested without end")
    if entities is None:
        return
    if isinstance(parent, BaseEventHandler):
        entities = entities if isinstance(entities, (list, tuple)) else [entities]
        entities = [entity for entity in entities if entity is not None]
    elif isinstance(entities, LaunchDescriptionEntity):
        raise TypeError(f"'{type(entities).__name__}' object is not iterable")
    for position, entity in enumerate(entities, start=1):
        if not hasattr(entity, "visit"):
            raise no_action(entity, position, parent)
        try:
            context.session.count_visit()
            entity.context_of_completion = context
            visit_all(entity.visit(context), context, entity, depth + 1)
        except Exception as error:
            blame(error, entity)
            raise
