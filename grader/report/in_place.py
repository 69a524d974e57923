"""Display of progress that a terminal shows in place."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import TypeVar

from rich.console import Console, RenderableType
from rich.live import Live

Display = TypeVar("Display", bound="InPlace")


class InPlace:
    """A context in which a terminal shows a view that changes; elsewhere nothing is shown in place.

    Parameters
    ----------
    view : callable
        Returns what is shown at that moment.
    per_second : float
        How often it is drawn.
    """

    def __init__(self, console: Console, view: Callable[[], RenderableType], per_second: float = 4) -> None:
        self._console = console
        self._live = Live(console=console, refresh_per_second=per_second, get_renderable=view, transient=True)

    def __enter__(self: Display) -> Display:
        if self._console.is_terminal:
            self._live.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._console.is_terminal:
            self._live.__exit__(kind, value, trace)
