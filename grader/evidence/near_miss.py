"""Near misses: which of a student's names was meant by one that the lab asks for.

A typo in a name is charged once; everything else is then measured on the name that the student used.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from grader.recording.session import OF_ACTION, STANDARD_TOPICS, UNKNOWN_NODE, GraphSnapshot

#: Below this likeness (difflib's ratio of the plain names) two names have nothing to do with each other.
LEAST_RATIO = 0.5
#: Services that every node has.
_STANDARD_SERVICE_TYPES = ("rcl_interfaces/srv/", "type_description_interfaces/srv/")


@dataclass(frozen=True)
class Candidate:
    """A name in the graph that belongs to a student's node."""

    name: str
    type: str


def candidates_in(
    graph: GraphSnapshot,
    kind: str,
    wanted: str,
    references: Collection[str],
    forgotten: Collection[str] = (),
) -> list[Candidate]:
    """Return what may be meant of the student's; what belongs to an action only where such a name is wanted.

    The nodes of the lab offer nothing that is meant, nor do the endpoints that are forgotten, by their gids.
    """
    offers = {
        "service": graph.services,
        "action": graph.actions,
        "action_client": graph.action_clients,
    }
    if kind == "node":
        return [Candidate(node, "") for node in graph.nodes if node not in references]
    found = [
        (s.name, s.type, s.node)
        for s in offers.get(kind, ())
        if not s.type.startswith(_STANDARD_SERVICE_TYPES)
    ]
    found += [
        (e.topic, e.type, e.node)
        for e in graph.endpoints
        if e.kind == kind and e.gid not in forgotten
    ]
    return [
        Candidate(name, its_type)
        for name, its_type, node in found
        if node not in references
        and UNKNOWN_NODE not in node
        and name not in STANDARD_TOPICS
        and (OF_ACTION in name) == (OF_ACTION in wanted)
    ]


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def likeness(wanted: str, name: str) -> float:
    """Return how alike two ROS names are, from 0 to 1; a namespace more or less counts little."""
    whole = difflib.SequenceMatcher(None, _plain(wanted), _plain(name)).ratio()
    last = difflib.SequenceMatcher(
        None, _plain(wanted.rsplit("/", 1)[-1]), _plain(name.rsplit("/", 1)[-1])
    ).ratio()
    return max(whole, 0.95 * last)


def is_misspelt(wanted: str, name: str) -> bool:
    """Whether a frame's name is a wanted one with slips of the pen: word by word, where `left` is none of `right`."""
    words, others = (re.findall(r"[a-z]+|\d+", each.lower()) for each in (wanted, name))
    for kind, a, b, c, d in difflib.SequenceMatcher(None, words, others).get_opcodes():
        left, right = words[a:b], others[c:d]
        if kind in ("insert", "delete") and not _IDLE.issuperset(left + right):
            return False
        pairs = (
            zip(left, right, strict=True)
            if len(left) == len(right)
            else [("".join(left), "".join(right))]
        )
        if kind == "replace" and any(
            difflib.SequenceMatcher(None, *pair).ratio() < _SLIP for pair in pairs
        ):
            return False
    return bool(words) and wanted != name


#: Words of a frame's name that say nothing, and how alike a word is to one that was meant.
_IDLE = frozenset({"link", "frame"})
_SLIP = 0.7


def near_miss(
    wanted: str, wanted_type: str | None, candidates: Iterable[Candidate]
) -> Candidate | None:
    """Choose the candidate that was meant, or None.

    The only one of the wanted type is taken whatever its name: it can mean no other.
    """
    found = sorted(
        set(candidates), key=lambda c: (c.type != wanted_type, -likeness(wanted, c.name), c.name)
    )
    if not found:
        return None
    same_type = [c for c in found if c.type == wanted_type]
    if len(same_type) == 1:
        return same_type[0]
    alike = [c for c in (same_type or found) if likeness(wanted, c.name) >= LEAST_RATIO]
    return alike[0] if alike else None
