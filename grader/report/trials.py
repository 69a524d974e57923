"""The terminal's view of `grade selftest`: what runs, what has ended, and a table of what is not as expected."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from grader.report.in_place import InPlace
from grader.report.plain import terminal_text
from grader.report.terminal import points_text

_NAME_WIDTH = 40
_LONGEST = 600


@dataclass(frozen=True)
class TrialLine:
    """What is told of a fixture that was graded.

    Attributes
    ----------
    sign : str
        "✓" as expected, "✗" not, "?" undecided, "!" not graded.
    differences : tuple of str
        In what it differs from what is expected, or why it was not graded.
    """

    name: str
    sign: str
    earned: Decimal
    possible: Decimal
    took_s: float
    differences: tuple[str, ...] = ()

    def text(self) -> Text:
        """Return it as one line."""
        style = {"✓": "green", "?": "magenta"}.get(self.sign, "red")
        line = Text(f"{self.sign} ", style).append(terminal_text(self.name, _NAME_WIDTH), "default")
        return line.append(f": {self.points()} ({self.took_s:.0f} s)", "dim")

    def points(self) -> str:
        """Return its points in words."""
        if not self.possible:
            return "not graded" if self.sign in "!✗" else ""
        return f"{points_text(self.earned)} / {points_text(self.possible)}"


class TrialsDisplay(InPlace):
    """Shows how far the fixtures are: on a terminal in place, elsewhere a line when one has ended."""

    def __init__(self, console: Console, names: Sequence[str]) -> None:
        self._console = console
        self._waiting = list(names)
        self._phases: dict[str, dict[str, str]] = {}
        self._ended: list[TrialLine] = []
        self._whole = len(names)
        self._began_s = time.monotonic()
        super().__init__(console, self._view)

    def phase(self, name: str, session: str, text: str, ended: bool) -> None:
        """Take note of what is being done with a fixture; `session` is empty for the grader's own work."""
        if name in self._waiting:
            self._waiting.remove(name)
        phases = self._phases.setdefault(name, {})
        if not session:
            phases.pop("", None)
        if ended:
            phases.pop(session, None)
        else:
            phases[session] = text

    def ended(self, line: TrialLine) -> None:
        """Take note that a fixture needs no more."""
        if line.name in self._waiting:
            self._waiting.remove(line.name)
        self._phases.pop(line.name, None)
        self._ended.append(line)
        if not self._console.is_terminal:
            count = Text(f"[{len(self._ended)}/{self._whole}] ", "dim")
            self._console.print(count.append(line.text()), soft_wrap=True, highlight=False)

    def _view(self) -> RenderableType:
        table = Table.grid(padding=(0, 2))
        for name, phases in self._phases.items():
            doing = " · ".join(f"{session}: {text}" if session else text for session, text in phases.items())
            table.add_row(terminal_text(name, _NAME_WIDTH), Text(terminal_text(doing, 160), "dim"))
        wrong = sum(line.sign != "✓" for line in self._ended)
        headline = f"{len(self._ended)} of {self._whole} done, {wrong} not as expected, {len(self._waiting)} waiting"
        elapsed = f" · {time.monotonic() - self._began_s:.0f} s"
        return Group(*(line.text() for line in self._ended[-6:]), Text(headline + elapsed, "bold"), table)


def print_trials(console: Console, lines: Sequence[TrialLine]) -> None:
    """Print a table of all fixtures, and below it in what some differ from what is expected."""
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    table.add_column(justify="right", no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    for line in lines:
        style = {"✓": "green", "?": "magenta"}.get(line.sign, "red")
        name = Text(terminal_text(line.name, _NAME_WIDTH))
        table.add_row(Text(line.sign, style), name, line.points(), f"{line.took_s:.1f} s")
    console.print(table)
    for line in lines:
        if line.differences:
            console.print(Text(f"\n{terminal_text(line.name, _NAME_WIDTH)}", "bold"))
            for difference in line.differences:
                console.print(Text(f"  • {terminal_text(difference, _LONGEST)}"))
