"""When a session, or a piece of the grader's own work, may burden a machine that several submissions share."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager, AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

from grader.live.isolation import Isolation
from grader.rubric import SessionSpec


class Turns(Protocol):
    """Hands out turns on the machine."""

    def cell(self, spec: SessionSpec, *, alone: bool) -> AbstractAsyncContextManager[None]:
        """Wait until a session may run, and hold its place while it does.

        Parameters
        ----------
        alone : bool
            Whether nothing else may run meanwhile.
        """
        ...

    def work(self, what: str) -> AbstractContextManager[None]:
        """Wait until the grader's own work, such as judging, takes no core from a session that is being timed.

        Parameters
        ----------
        what : str
            What is done, for people who watch.
        """
        ...


@dataclass(frozen=True)
class Shared:
    """What gradings on one machine have in common.

    Attributes
    ----------
    isolation : Isolation
        How students' code is confined here, found once for all.
    """

    turns: Turns
    isolation: Isolation
