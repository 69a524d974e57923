"""Near misses: the student's name that was meant for a name of the lab.

A typo in a name costs points once; all other measurements then follow the student's name.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

from grader.recording.session import OF_ACTION, STANDARD_TOPICS, UNKNOWN_NODE, GraphSnapshot

#: Likeness (difflib's ratio of the plain names) below which two names are unrelated.
LEAST_RATIO = 0.5
#: Weight of the likeness of two names without their namespaces.
_LAST_PART_WEIGHT = 0.95
#: Types of services that every node has.
_STANDARD_SERVICE_TYPES = ("rcl_interfaces/srv/", "type_description_interfaces/srv/")
#: Words of a frame's name without a meaning of their own.
_IDLE = frozenset({"link", "frame"})
#: Likeness from which a word is a misspelt other one.
_SLIP = 0.7


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
    """Return the student's names that can be meant by a wanted name.

    Names that belong to an action are candidates for such a name only.

    Parameters
    ----------
    graph
        The graph.
    kind
        "node", "publisher", "subscription", "service", "action" or "action_client".
    wanted
        The name of the lab.
    references
        Nodes of the lab, which offer no candidates.
    forgotten
        Gids of endpoints that offer no candidates.
    """
    if kind == "node":
        return [Candidate(node, "") for node in graph.nodes if node not in references]
    found = []
    for candidate, node in _offers(graph, kind, forgotten):
        if node in references or UNKNOWN_NODE in node:
            continue
        if candidate.name in STANDARD_TOPICS:
            continue
        if (OF_ACTION in candidate.name) == (OF_ACTION in wanted):
            found.append(candidate)
    return found


def _offers(
    graph: GraphSnapshot, kind: str, forgotten: Collection[str]
) -> Iterator[tuple[Candidate, str]]:
    """Yield the names of a kind in the graph, with their nodes."""
    servers = {
        "service": graph.services,
        "action": graph.actions,
        "action_client": graph.action_clients,
    }
    for server in servers.get(kind, ()):
        if not server.type.startswith(_STANDARD_SERVICE_TYPES):
            yield Candidate(server.name, server.type), server.node
    for endpoint in graph.endpoints:
        if endpoint.kind == kind and endpoint.gid not in forgotten:
            yield Candidate(endpoint.topic, endpoint.type), endpoint.node


def _ratio(some: str, other: str) -> float:
    return difflib.SequenceMatcher(None, some, other).ratio()


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _last_part(name: str) -> str:
    return _plain(name.rsplit("/", 1)[-1])


def likeness(wanted: str, name: str) -> float:
    """Return the likeness of two ROS names, from 0 to 1; an additional namespace counts little."""
    whole = _ratio(_plain(wanted), _plain(name))
    last = _ratio(_last_part(wanted), _last_part(name))
    return max(whole, _LAST_PART_WEIGHT * last)


def is_misspelt(wanted: str, name: str) -> bool:
    """Return whether a frame's name is a misspelt wanted one.

    Names are compared word by word: `left` is not a misspelt `right`.
    """
    words = _words(wanted)
    others = _words(name)
    if not words or wanted == name:
        return False
    matcher = difflib.SequenceMatcher(None, words, others)
    for kind, start, end, other_start, other_end in matcher.get_opcodes():
        some = words[start:end]
        other = others[other_start:other_end]
        if kind in ("insert", "delete") and not _IDLE.issuperset(some + other):
            return False
        if kind == "replace" and not _are_slips(some, other):
            return False
    return True


def _words(name: str) -> list[str]:
    return re.findall(r"[a-z]+|\d+", name.lower())


def _are_slips(words: list[str], others: list[str]) -> bool:
    """Return whether words are misspelt others, one by one or, if their numbers differ, together."""
    if len(words) != len(others):
        words = ["".join(words)]
        others = ["".join(others)]
    for word, other in zip(words, others, strict=True):
        if _ratio(word, other) < _SLIP:
            return False
    return True


def _is_like_one(name: str, others: Iterable[str], least: float) -> bool:
    """Tell whether a name is more like one of some names than a least likeness."""
    for other in others:
        if likeness(other, name) > least:
            return True
    return False


def near_miss(
    wanted: str,
    wanted_type: str | None,
    candidates: Iterable[Candidate],
    others: Iterable[str] = (),
) -> Candidate | None:
    """Return the candidate that was meant; None if there is none.

    The only candidate of the wanted type is taken regardless of its name, unless another name was meant by it.

    Parameters
    ----------
    others
        Other names of the lab that are missing in the graph. A candidate that is more like one of them is not taken:
        `/my_depth` is no `/depth_count` where `/depth` is missing too.
    """
    rivals = set(others) - {wanted}
    found = set()
    for candidate in candidates:
        least = max(likeness(wanted, candidate.name), LEAST_RATIO)
        if not _is_like_one(candidate.name, rivals, least):
            found.add(candidate)
    same_type = {candidate for candidate in found if candidate.type == wanted_type}
    if len(same_type) == 1:
        return same_type.pop()
    alike = []
    for candidate in same_type or found:
        ratio = likeness(wanted, candidate.name)
        if ratio >= LEAST_RATIO:
            alike.append((-ratio, candidate.name, candidate.type))
    if not alike:
        return None
    _, name, its_type = min(alike)
    return Candidate(name, its_type)
