"""The situation of a check for the rules that decide it, and the order of these rules."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from grader.checks.base import Context
from grader.result import Finding


@dataclass(frozen=True, kw_only=True)
class Situation:
    """One check before or after its measurement."""

    context: Context
    #: None before the measurement.
    finding: Finding | None = None

    @property
    def found(self) -> Finding:
        """The finding so far; rules that look at it are asked after the measurement only."""
        assert self.finding is not None
        return self.finding

    @property
    def took_points(self) -> bool:
        """True if the check loses points by the finding so far."""
        return self.found.outcome.took_points


@dataclass(frozen=True)
class Basis:
    """The function of a check, and the doubts about its findings."""

    #: Returns the finding; called only if the file of the check's artifact was handed in.
    find: Callable[[Context, Any], Finding]
    #: True if it can be passed without all messages of its topics.
    by_endpoints: bool = False
    #: True if a step of the system's clock, in the window of the check or in its session, may cause a loss.
    by_clock: bool = False
    #: True for a lab's own check. Its author cannot know the software that is missing here, so each loss of a program
    #: that needs such software stays open.
    of_author: bool = False


@dataclass(frozen=True, kw_only=True)
class Measurement(Situation):
    """One check with its parameters."""

    check: Basis
    p: Any


S = TypeVar("S", bound=Situation)


def first_answer(situation: S, rules: Iterable[Callable[[S], Finding | None]]) -> Finding | None:
    """Return the finding of the first rule that gives one, with the name of the rule."""
    for rule in rules:
        finding = rule(situation)
        if finding is not None:
            return replace(finding, decided_by=rule.__name__)
    return None


def last_answer(situation: S, rules: Iterable[Callable[[S], Finding | None]]) -> Finding:
    """Return the finding of the last rule that gives one, or else the finding so far.

    Each rule sees the finding of the rules before.
    """
    for rule in rules:
        finding = rule(situation)
        if finding is not None:
            decided = replace(finding, decided_by=rule.__name__)
            situation = replace(situation, finding=decided)
    return situation.found
