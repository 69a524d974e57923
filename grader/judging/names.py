"""Names in the graph that a student used for names that checks seek, if no step waited for these."""

from __future__ import annotations

from collections.abc import Collection

from grader.evidence.near_miss import Candidate, candidates_in, near_miss
from grader.evidence.recorded import Recorded
from grader.lab.references import Sought
from grader.lab.rubric import Rubric


def names_not_awaited(recorded: Recorded, rubric: Rubric) -> dict[str, str]:
    """Return each sought name that is not in the graph, with the student's name for it.

    For example, `{"/arm/enable": "/arm/enabel"}` is a misspelt service.
    """
    sought = _sought(recorded, rubric)
    waited = _waited(recorded)
    references = [reference.node for reference in rubric.reference.values()]
    taken = {each.name for each in sought}
    taken.update(recorded.awaited, recorded.record.names.values())
    missing = rubric.names_in_checks - _in_graph(recorded)
    found: dict[str, str] = {}
    for each in sorted(sought):
        candidates = set()
        if (each.kind, each.name) not in waited:
            candidates = _candidates(recorded, each, references)
        names = {candidate.name for candidate in candidates}
        if recorded.used(each.name) in names:
            continue
        free = [candidate for candidate in candidates if candidate.name not in taken]
        guess = near_miss(each.name, each.type, free, missing)
        if guess is not None:
            found[each.name] = guess.name
            taken.add(guess.name)
    return found


def _sought(recorded: Recorded, rubric: Rubric) -> set[Sought]:
    """Return the typed endpoints that the checks of a session seek."""
    found: set[Sought] = set()
    for spec in rubric.checks():
        if spec.session == recorded.record.session:
            found.update(each for each in spec.given.sought() if each.type is not None)
    return found


def _in_graph(recorded: Recorded) -> set[str]:
    """Return the names in the graph of a session, and the names with a misspelt one there."""
    found = {*recorded.nodes, *recorded.record.names}
    for endpoint in recorded.endpoints:
        found.add(endpoint.topic)
    for graph in recorded.record.graph:
        for server in (*graph.services, *graph.actions):
            found.add(server.name)
    return found


def _waited(recorded: Recorded) -> set[tuple[str, object]]:
    """Return kind and name of the endpoints and nodes that steps waited for."""
    found: set[tuple[str, object]] = set()
    for step in recorded.record.steps:
        if step.kind == "wait_for":
            found.update(step.parameters.items())
    return found


def _candidates(recorded: Recorded, sought: Sought, references: Collection[str]) -> set[Candidate]:
    """Return the student's endpoints of a kind that were ever in the graph."""
    found: set[Candidate] = set()
    for graph in recorded.record.graph:
        found.update(candidates_in(graph, sought.kind, sought.name, references))
    return found
