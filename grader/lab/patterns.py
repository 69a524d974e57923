"""Regular expressions of a rubric, matched against what students wrote within a bound of time.

Who writes a rubric does not think of the text that is hardest for a pattern, and a student might. So what a check may
spend on its patterns is bounded. A text that takes longer counts as not recognised, as if the pattern did not match,
and the result says so in a note for a person: the pattern is as likely to blame as the text.
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

from grader.result import FOR_A_PERSON

T = TypeVar("T")

#: What the patterns of a check, or of a page's figures, may take of computing. Over the recordings that are kept for
#: tests, all patterns of a submission take 0.02 s together.
BUDGET_S = 2.0
NOTE = f"{FOR_A_PERSON} comparing the text with the rubric's patterns took too long, so the rest was not read."


@dataclass
class Budget:
    """What is left to spend; `exceeded` tells whether anything was not read for it."""

    left_s: float = BUDGET_S
    exceeded: bool = False


_CURRENT: ContextVar[Budget | None] = ContextVar("budget", default=None)


@contextmanager
def patterns_bounded() -> Iterator[Budget]:
    """Give a new budget to all that is searched within."""
    budget = Budget()
    token = _CURRENT.set(budget)
    try:
        yield budget
    finally:
        _CURRENT.reset(token)


@lru_cache(maxsize=256)
def compiled(pattern: str, *, ignore_case: bool = False) -> regex.Pattern[str]:
    """Return a pattern, ready to be searched; raises ValueError if it is no regular expression."""
    try:
        return regex.compile(pattern, regex.IGNORECASE if ignore_case else 0)
    except regex.error as problem:
        raise ValueError(f"not a valid regular expression: {problem}") from problem


def search(pattern: str, text: str, *, ignore_case: bool = False) -> regex.Match[str] | None:
    """Return where a pattern of the rubric is found first; None where it is not, or no time is left to look."""
    return _within_budget(compiled(pattern, ignore_case=ignore_case).search, text)


def without(pattern: str, text: str) -> tuple[str, int]:
    """Return a text with a blank for each place where a pattern is found, and how many these are."""
    return _within_budget(partial(compiled(pattern).subn, " "), text) or (text, 0)


def _within_budget(look: Callable[..., T], text: str) -> T | None:
    budget = _CURRENT.get() or Budget()
    if budget.left_s <= 0:
        return None
    began_s = time.process_time()  # Of this process, so that a busy machine changes nothing.
    try:
        return look(text, timeout=budget.left_s)
    except TimeoutError:
        budget.exceeded = True
        return None
    finally:
        budget.left_s -= time.process_time() - began_s
