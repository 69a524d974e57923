"""The action of the step `wait_for` in the director: finds names in the graph, also misspelt ones."""

from __future__ import annotations

import time
from contextlib import suppress

from grader.evidence.near_miss import Candidate, candidates_in, near_miss
from grader.lab.steps.base import Answer
from grader.lab.steps.wait_for import WaitForResult, WaitForStep
from grader.live.ros_node.probe import Probe
from grader.recording.session import GraphSnapshot

#: Time in s that the wanted name may still take to appear once a node of the student is there.
_NEAR_MISS_AFTER_S = 2.0
#: Names that are passed on if the wanted one did not come.
_MOST_THERE = 50


def wait_for(probe: Probe, step: WaitForStep) -> Answer:
    """Wait for something in the graph, and note the name that the student uses for it."""
    search = _Search(probe, step)
    started_s = time.monotonic()
    is_there = probe.until_in_graph(search.wanted, search.found, step.timeout_s)
    waited_s = round(time.monotonic() - started_s, 3)
    if not is_there:
        names = sorted({candidate.name for candidate in search.candidates()})
        return Answer("timeout", WaitForResult(waited_s=waited_s, there=names[:_MOST_THERE]))
    meant = min(search.found(), key=search.rank)
    if meant.name != search.wanted:
        probe.names[search.wanted] = meant.name
        probe.watch.first.add(meant.name)
    if search.key == "action":
        # The client is in the graph early, so that the server knows it by the time of the goal. A type that cannot
        # be used is reported there.
        with suppress(Exception):
            probe.action(meant.name, meant.type)
    return Answer("done", WaitForResult(waited_s=waited_s, name=meant.name, type=meant.type))


class _Search:
    """Looks for a name in the graph, again and again."""

    def __init__(self, probe: Probe, step: WaitForStep) -> None:
        self._probe = probe
        self.key, self.wanted = step.awaited
        self._type = step.type
        #: Time since which a node of the student is there.
        self._since_s: float | None = None
        #: Graph of the last search, and whether it looked for near misses. A graph of thousands of names is
        #: searched once.
        self._searched: tuple[GraphSnapshot | None, bool] = (None, False)
        self._latest: list[Candidate] = []

    def found(self) -> list[Candidate]:
        """Return the candidates with the name, or with the nearest name if the wanted one does not come."""
        if not self._students():
            self._since_s = None
        elif self._since_s is None:
            self._since_s = time.monotonic()
        is_near = False
        if self._since_s is not None:
            is_near = time.monotonic() - self._since_s > _NEAR_MISS_AFTER_S
        graph, was_near = self._searched
        if graph is not self._probe.watch.last or was_near != is_near:
            self._searched = (self._probe.watch.last, is_near)
            self._latest = self._search(is_near=is_near)
        return self._latest

    def _search(self, *, is_near: bool) -> list[Candidate]:
        candidates = self.candidates()
        # A name that once stood for the wanted one does so as long as it is there.
        names = (self.wanted, self._probe.names.get(self.wanted))
        same = [candidate for candidate in candidates if candidate.name in names]
        if same or not is_near:
            return same
        taken = self._probe.expected | set(self._probe.names.values())
        free = [candidate for candidate in candidates if candidate.name not in taken]
        guess = near_miss(self.wanted, self._type, free, self._missing())
        return [] if guess is None else [guess]

    def _missing(self) -> set[str]:
        """Return the names of the lab that nothing in the graph has, nor a misspelt one."""
        probe = self._probe
        graph = probe.watch.last
        there = set(graph.nodes)
        for endpoint in graph.endpoints:
            there.add(endpoint.topic)
        for server in graph.services:
            there.add(server.name)
        return probe.expected - there - probe.names.keys()

    def candidates(self) -> list[Candidate]:
        """Return everything of the wanted kind that the student has in the graph."""
        probe = self._probe
        return candidates_in(
            probe.watch.last, self.key, self.wanted, probe.reference_nodes, probe.forgotten
        )

    def rank(self, candidate: Candidate) -> tuple[bool, bool]:
        """Return a key that sorts the wanted type first, then the wanted name."""
        return candidate.type != self._type, candidate.name != self.wanted

    def _students(self) -> bool:
        reference = self._probe.reference_nodes
        return any(node not in reference for node in self._probe.watch.last.nodes)
