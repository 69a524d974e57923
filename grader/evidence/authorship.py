"""Whose a recorded message is. DDS does not report it; the digests that came through the pipe do.

A message is the grader's own if one of its publishers reported the same digest for the same publication sequence
number. Another publisher cannot know the digest of a message before it was sent, so what it sends of the same contents
under the same number comes later: of several, the first is the grader's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grader.recording.bag import Bag, Stream
from grader.recording.session import Published
from grader.recording.trusted_channel import DIGEST_DIGITS, digest


@dataclass(frozen=True)
class Authorship:
    """The messages of a topic, separated."""

    #: Those that the grader's own publishers sent, in the order in which they were received.
    own: Stream
    #: int64[n]: When those of other publishers were received, of any type, between the first and the last of `own`.
    others_ns: NDArray[np.int64]


def authorship(bag: Bag, topic: str, published: Sequence[Published]) -> Authorship | None:
    """Separate the messages of a topic; None where that cannot be done, as no message that was reported is there."""
    own_type = max(published, key=lambda entry: len(entry.digests)).type if published else ""
    others = []
    own: Stream | None = None
    for info in bag.topics:
        if info.topic == topic:
            stream = bag.stream(topic, info.topic_type)
            mine, theirs = _separated(
                stream, [entry for entry in published if entry.type == info.topic_type]
            )
            others.append(stream.received_ns[theirs])
            if info.topic_type == own_type:
                own = stream.only(mine)
    if own is None or not len(own):
        return None
    received_ns = np.sort(np.concatenate(others))
    during = (received_ns >= own.received_ns[0]) & (received_ns <= own.received_ns[-1])
    return Authorship(own, received_ns[during])


def _separated(
    stream: Stream, published: Sequence[Published]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which messages of a stream are the grader's own, and which are others'.

    What was recorded twice, as the source timestamp tells, is neither the second time.
    """
    digests = [digests_of(entry) for entry in published]
    taken: dict[tuple[int, int], int] = {}
    mine, theirs = np.zeros(len(stream), dtype=bool), np.zeros(len(stream), dtype=bool)
    rows = zip(stream.sequence.tolist(), stream.source_ns.tolist(), stream.data, strict=True)
    for row, (number, source_ns, data) in enumerate(rows):
        found = digest(data)
        fitting = [
            (which, number)
            for which, known in enumerate(digests)
            if 0 < number <= len(known) and known[number - 1] == found
        ]
        free = [key for key in fitting if key not in taken]
        if free:
            taken[free[0]] = source_ns
            mine[row] = True
        else:
            theirs[row] = source_ns not in [taken[key] for key in fitting]
    return mine, theirs


def digests_of(entry: Published) -> list[str]:
    """Return the digests that a process reported, in the order of its publications."""
    return [
        entry.digests[n : n + DIGEST_DIGITS] for n in range(0, len(entry.digests), DIGEST_DIGITS)
    ]
