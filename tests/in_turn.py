"""Order of the tests, and their distribution over the workers, to keep the cores busy for the whole run.

Live tests wait most of their time, and measure it: computation beside them would keep them from a core. Therefore all
workers but the last begin with them, and the last one computes at a lower priority. The rest is for all workers.
"""

from __future__ import annotations

import os
import re
from enum import IntEnum
from functools import cache
from pathlib import Path

import pytest
from xdist.scheduler import LoadScopeScheduling
from xdist.workermanage import WorkerController

ROOT = Path(__file__).resolve().parents[1]
#: With fewer workers, each runs everything.
FEWEST_WORKERS = 4
#: Priority of the worker that computes beside live tests: a tenth of a core if these take all.
NICE = 10
#: Each attack's batch runs as many sessions side by side as the machine takes.
ATTACKS_AT_A_TIME = 2
#: Live modules with long tests that are independent of each other.
ONE_BY_ONE = (
    "test_fixtures.py", "test_runner.py", "test_launch_containment.py", "test_isolation.py", "test_class.py",
)  # fmt: skip
#: Folders of tests that compute without a bound on their wall time; other computing tests have bounds in seconds.
PATIENT = ("checks", "cohort", "evidence", "judging", "lab", "recording", "reference", "report")
IMPATIENT = ("test_writing.py",)


class Kind(IntEnum):
    """Kind of a test, in the order of starts: the kind that may take longest comes first."""

    ATTACK, LIVE_MODULE, LIVE_TEST, FIXTURE, CLOCK, LONG, PURE = range(7)


@cache
def _kind_of_module(module: str) -> Kind:
    name = Path(module).name
    text = (ROOT / module).read_text(encoding="utf-8")
    if re.search(r"pytest\.mark\.live\b", text):
        return _kind_of_live_module(name)
    if re.search(r"^pytestmark = .*pytest\.mark\.slow\b", text, re.MULTILINE):
        return Kind.LONG
    if Path(module).parts[1] in PATIENT and name not in IMPATIENT:
        return Kind.PURE
    return Kind.CLOCK


def _kind_of_live_module(name: str) -> Kind:
    if name == "test_attacks.py":
        return Kind.ATTACK
    if name == "test_fixtures.py":
        return Kind.FIXTURE
    if name in ONE_BY_ONE:
        return Kind.LIVE_TEST
    return Kind.LIVE_MODULE


def kind_of(nodeid: str) -> Kind:
    """Return the kind of a test, by its module."""
    return _kind_of_module(nodeid.partition("::")[0])


class InTurn(LoadScopeScheduling):  # type: ignore[misc]
    """Gives a worker a module at a time, or one of the long tests: a live fixture, or a batch of attacks."""

    #: The worker that computes behind the others; empty if there is none.
    _behind: str | None = None

    def _split_scope(self, nodeid: str) -> str:
        kind, (module, _, test) = kind_of(nodeid), nodeid.partition("::")
        if kind is Kind.ATTACK:
            return f"{module}::{'-'.join(test.partition('[')[2].rstrip(']').split('-')[:2])}"
        if kind in (Kind.LIVE_TEST, Kind.FIXTURE):
            return nodeid
        return module

    def _assign_work_unit(self, node: WorkerController) -> None:
        """Let the unit be the first that is the worker's turn."""
        scope = min(self.workqueue, key=lambda scope: self._turn(node, kind_of(scope)))
        self.workqueue.move_to_end(scope, last=False)
        super()._assign_work_unit(node)

    def _turn(self, node: WorkerController, kind: Kind) -> int:
        if kind is Kind.ATTACK:
            theirs = []
            for n, w in self.assigned_work.items():
                if n is not node and self._attacks(w):
                    theirs.append(w)
            return kind if len(theirs) < ATTACKS_AT_A_TIME else Kind.PURE + 1
        if self._is_behind(node) and kind >= Kind.LONG:
            return kind - len(Kind)
        return kind

    def _attacks(self, work: dict[str, dict[str, bool]]) -> bool:
        return any(
            kind_of(scope) is Kind.ATTACK and not all(tests.values())
            for scope, tests in work.items()
        )

    def _is_behind(self, node: WorkerController) -> bool:
        if self._behind is None:
            self._behind = worker_behind(self.numnodes, self.collection or [])
        return bool(node.gateway.id == self._behind)

    def _reschedule(self, node: WorkerController) -> None:
        """Let the worker that computes end when all is computed."""
        if self._is_behind(node) and not any(
            kind_of(scope) >= Kind.LONG for scope in self.workqueue
        ):
            if not node.shutting_down:
                node.shutdown()
            return
        super()._reschedule(node)


def worker_behind(workers: int, collection: list[str]) -> str:
    """Return the worker that computes behind live tests, where there are both; else nothing."""
    kinds = {kind_of(nodeid) for nodeid in collection}
    both = min(kinds, default=Kind.PURE) < Kind.CLOCK and max(kinds) >= Kind.LONG
    if both and workers >= FEWEST_WORKERS:
        return f"gw{workers - 1}"
    return ""


def step_behind(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Lower the priority of this process, and of its children, if it is the computing worker."""
    told = getattr(config, "workerinput", None)
    if told and told["workerid"] == worker_behind(
        told["workercount"], [item.nodeid for item in items]
    ):
        os.nice(NICE)
