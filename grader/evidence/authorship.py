"""Authorship of recorded messages. DDS does not report it; digests from the trusted channel do.

A message is the grader's if one of its publishers reported the same digest for the same publication sequence number.
Another publisher cannot know the contents of a message before it was sent. Its copy under the same number therefore
comes later, and the first of several equal messages is the grader's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grader.recording.session import Published
from grader.recording.trusted_channel import DIGEST_DIGITS, digest
from ros_bag.reading import Bag, Stream


@dataclass(frozen=True)
class Authorship:
    """The messages of a topic, separated."""

    #: Messages of the grader's publishers, in the order of arrival.
    own: Stream
    #: int64[n]: Arrival of messages of other publishers, of any type, between the first and the last of `own`.
    others_ns: NDArray[np.int64]


def authorship(bag: Bag, topic: str, published: Sequence[Published]) -> Authorship | None:
    """Separate the messages of a topic; None if no reported message is recorded."""
    own_type = _main_type(published)
    others = []
    own: Stream | None = None
    for info in bag.topics:
        if info.topic != topic:
            continue
        stream = bag.stream(topic, info.topic_type)
        reported = [entry for entry in published if entry.type == info.topic_type]
        mine, theirs = _separated(stream, reported)
        others.append(stream.received_ns[theirs])
        if info.topic_type == own_type:
            own = stream.only(mine)
    if own is None or not len(own):
        return None
    received_ns = np.sort(np.concatenate(others))
    has_begun = received_ns >= own.received_ns[0]
    during = has_begun & (received_ns <= own.received_ns[-1])
    return Authorship(own, received_ns[during])


def _main_type(published: Sequence[Published]) -> str:
    """Return the type with the most digests of one publisher."""
    if not published:
        return ""
    return max(published, key=lambda entry: len(entry.digests)).type


def _separated(
    stream: Stream, published: Sequence[Published]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return masks of the grader's messages in a stream, and of other messages.

    The second recording of a message, with the same source timestamp, is in neither mask.
    """
    digests = [digests_of(entry) for entry in published]
    #: Source timestamps of the grader's messages, by publisher and sequence number.
    taken: dict[tuple[int, int], int] = {}
    mine = np.zeros(len(stream), dtype=bool)
    theirs = np.zeros(len(stream), dtype=bool)
    rows = zip(stream.sequence.tolist(), stream.source_ns.tolist(), stream.data, strict=True)
    for row, (number, source_ns, data) in enumerate(rows):
        repeated = False
        found = digest(data)
        for publisher, known in enumerate(digests):
            if not 0 < number <= len(known):
                continue
            if known[number - 1] != found:
                continue
            key = (publisher, number)
            if key not in taken:
                taken[key] = source_ns
                mine[row] = True
                break
            repeated = repeated or taken[key] == source_ns
        if not mine[row]:
            theirs[row] = not repeated
    return mine, theirs


def digests_of(entry: Published) -> list[str]:
    """Return the digests that a process reported, in the order of its publications."""
    starts = range(0, len(entry.digests), DIGEST_DIGITS)
    return [entry.digests[start : start + DIGEST_DIGITS] for start in starts]
