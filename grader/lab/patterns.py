"""Regular expressions of a rubric, matched against students' texts within a bound of time.

Authors of rubrics do not think of the hardest text for a pattern, but a student might. Therefore the time of a check's
patterns is bounded. A text that takes longer counts as not recognised, as if the pattern did not match. The result gets a
note for a person, because the pattern can be the cause as well as the text.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TypeVar

import regex

from grader.user_cache import computed

T = TypeVar("T")

#: CPU time for the patterns of a check, or of a page's figures, in s. In the recordings of the tests, all patterns of a
#: submission take 0.02 s together.
BUDGET_S = 2.0


@dataclass
class Budget:
    """The remaining CPU time; `exceeded` is True if a text was not read for lack of time."""

    left_s: float = BUDGET_S
    exceeded: bool = False


_CURRENT: ContextVar[Budget | None] = ContextVar("budget", default=None)


@contextmanager
def patterns_bounded() -> Iterator[Budget]:
    """Give the searches within the context a new budget."""
    budget = Budget()
    token = _CURRENT.set(budget)
    try:
        yield budget
    finally:
        _CURRENT.reset(token)


def compiled_once(pattern: str, flags: int = 0) -> regex.Pattern[str]:
    """Return a pattern, compiled or from the user's cache; raises `regex.error` as `regex.compile` does.

    To compile all patterns of a lab takes a tenth of a second, and to read them a hundredth.
    """
    key = (regex.__version__, pattern, flags)
    return computed("patterns", key, lambda: regex.compile(pattern, flags))


@lru_cache(maxsize=256)
def compiled(pattern: str, *, ignore_case: bool = False) -> regex.Pattern[str]:
    """Return a pattern, ready to be searched; raises ValueError if it is not a regular expression."""
    try:
        return compiled_once(pattern, regex.IGNORECASE if ignore_case else 0)
    except regex.error as problem:
        raise ValueError(f"not a valid regular expression: {problem}") from problem


def search(pattern: str, text: str, *, ignore_case: bool = False) -> regex.Match[str] | None:
    """Return the first match of a pattern; None if there is no match, or no time left."""
    return _within_budget(compiled(pattern, ignore_case=ignore_case).search, text)


def without(pattern: str, text: str) -> tuple[str, int]:
    """Return a text with a blank for each match of a pattern, and the number of matches."""
    return _within_budget(partial(compiled(pattern).subn, " "), text) or (text, 0)


def has_time_left() -> bool:
    """Tell whether all searches within the present budget came to their ends; False without a budget."""
    budget = _CURRENT.get()
    if budget is None or budget.exceeded:
        return False
    return budget.left_s > 0


def _within_budget(look: Callable[..., T], text: str) -> T | None:
    budget = _CURRENT.get() or Budget()
    if budget.left_s <= 0:
        return None
    # A busy machine does not change the CPU time of this process.
    began_s = time.process_time()
    try:
        return look(text, timeout=budget.left_s)
    except TimeoutError:
        budget.exceeded = True
        return None
    finally:
        budget.left_s -= time.process_time() - began_s
