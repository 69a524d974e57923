"""Gaps of a recording: messages that the recorder left out, and messages that never reached it; and their causes."""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from grader.evidence.authorship import Authorship, authorship, digests_of
from grader.evidence.recorded import Recorded
from grader.recording.session import ProcessRun, Published, RecordingGap
from grader.recording.trusted_channel import digest
from ros_bag.reading import Stream

#: The limit of a session's recording, as `ProcessRun.limit` names limits.
RECORDING = "recording"
#: The limit of the values that are decoded of a topic.
DECODING = "decoding"
#: Results that are kept, because a full recording takes long to search, and each check of its session asks.
_MOST_KEPT = 4
#: Share of missing messages that is accepted: more than a reliable connection on loopback loses, and too few to
#: change a verdict.
_HARMLESS = 0.05
#: Longest time until the recorder's subscription is matched, in s. A volatile publisher that does not wait for it, or
#: that ends before, publishes in vain.
_MATCHED_WITHIN_S = 5.0


def gaps_by_student(recorded: Recorded) -> list[RecordingGap]:
    """Return the gaps of a recording that the student's processes caused.

    Topics share the space of a recording; the processes that filled most of it caused its limit. If a process of the
    grader did not report its publications, the cause is unknown. A topic without any recorded message is the student's,
    unless the grader publishes it.
    """
    if recorded.silent_references:
        return []
    ours = {(entry.topic, entry.type) for entry in recorded.record.published}
    found = []
    for gap in recorded.record.unrecorded:
        is_unseen = gap.messages == 0 and (gap.topic, gap.type) not in ours
        is_limit = bool(gap.limit) and _student_wrote_more(recorded)
        if is_unseen or is_limit:
            found.append(gap)
    return found


@functools.lru_cache(maxsize=_MOST_KEPT)
def _student_wrote_more(recorded: Recorded) -> bool:
    """Return whether the student's messages take at least half of the recording."""
    bag = recorded.bag
    own_bytes = 0
    for entry in recorded.record.published:
        data = bag.stream(entry.topic, entry.type).data
        own_bytes += _size_of_known(data, set(digests_of(entry)))
    return own_bytes <= bag.size_bytes - own_bytes


def _size_of_known(data: Iterable[bytes], digests: Collection[str]) -> int:
    """Return the size of the messages with one of some digests, in bytes."""
    size_bytes = 0
    for each in data:
        if digest(each) in digests:
            size_bytes += len(each)
    return size_bytes


@dataclass
class UnreadGap(RecordingGap):
    """Recorded messages that are not read, because decoding them would take too long."""


def unread(recorded: Recorded, topic: str) -> UnreadGap | None:
    """Return the gap of unread messages on a topic (of the graph); None if all are read."""
    stream = recorded.bag.stream(topic)
    if not stream.unread:
        return None
    seen = len(stream)
    if seen:
        t_ns = int(stream.received_ns[-1])
    else:
        t_ns = recorded.record.started_ns
    reason = "they hold more values than are decoded of a topic"
    size_bytes = sum(map(len, stream.data))
    return UnreadGap(topic, stream.topic_type, t_ns, seen, size_bytes, reason, limit=True)


def is_unread_by_student(recorded: Recorded, gap: UnreadGap) -> bool:
    """Return whether at least half of the read messages of a topic are the student's."""
    if recorded.silent_references:
        return False
    ours = [entry for entry in recorded.record.published if entry.topic == gap.topic]
    if not ours:
        return True
    digests: set[str] = set()
    for entry in ours:
        digests.update(digests_of(entry))
    own_bytes = 0
    if digests:
        data = recorded.bag.stream(gap.topic).data
        own_bytes = _size_of_known(data, digests)
    return own_bytes <= gap.size_bytes - own_bytes


def describe_gap(gap: RecordingGap) -> str:
    """Describe the missing messages, and the reason."""
    if isinstance(gap, UnreadGap):
        many = f"the first {gap.messages}" if gap.messages else "none"
        return f"Of the messages on {gap.topic} {many} were looked at: {gap.reason} (limit: {DECODING})."
    if not gap.limit:
        return f"Messages on {gap.topic} of type {gap.type} cannot be recorded: {gap.reason}."
    if not gap.messages:
        return f"Messages on {gap.topic} are not recorded: {gap.reason} (limit: {RECORDING})."
    size = f"{_in_words(gap.size_bytes)}, {_in_words(gap.size_bytes / gap.messages)} each"
    many = "the first message"
    if gap.messages > 1:
        many = f"the first {gap.messages} messages"
    return f"Only {many} on {gap.topic} ({size}) are recorded: {gap.reason} (limit: {RECORDING})."


def _in_words(size_bytes: float) -> str:
    """Return a size with its unit, such as "1.5 MB"."""
    if size_bytes >= 1e6:
        return f"{size_bytes / 1e6:.3g} MB"
    return f"{size_bytes / 1e3:.3g} kB"


def limits_hit(recorded: Recorded) -> dict[str, str]:
    """Return the limits that a session's processes hit, by the process's name."""
    found: dict[str, str] = {}
    for run in recorded.record.processes:
        if run.limit is not None:
            found[run.name] = run.limit
    for gap in gaps_by_student(recorded):
        publisher = _publisher_of(recorded, gap) if gap.limit else None
        if publisher is not None:
            found.setdefault(publisher.name, RECORDING)
    return found


def _publisher_of(recorded: Recorded, gap: RecordingGap) -> ProcessRun | None:
    """Return the busiest student's process with a publisher on a topic, by its nodes' claims; else the busiest one."""
    asking = {claim.process for claim in recorded.claims_of("publisher", gap.topic)}
    asked = [run for run in recorded.students if run.name in asking]
    return max(asked or recorded.students, key=_cpu_ns, default=None)


def _cpu_ns(run: ProcessRun) -> int:
    if run.usage:
        return run.usage[-1].cpu_ns
    return 0


@functools.lru_cache(maxsize=_MOST_KEPT)
def dropped(recorded: Recorded) -> Mapping[str, str]:
    """Return the topics on which messages of the grader are missing, each with a sentence.

    A process that can send packets on a topic can pretend that messages are missing, or replace them. Therefore the
    recorded messages are compared with the reports of the trusted channel.
    """
    found: dict[str, str] = {}
    for (topic, _), entries in _comparable(recorded).items():
        published = sum(len(digests_of(entry)) for entry in entries)
        apart = _set_apart(recorded, topic, entries)
        there = 0
        early = 0
        if apart is not None:
            there = len(apart.own)
            early = _unseen_at_first(recorded, topic, entries, apart.own)
        if published - early - there > _HARMLESS * published:
            found[topic] = (
                f"Of the {published} messages that the grader published on {topic} {there} are recorded."
            )
    return found


def _comparable(recorded: Recorded) -> dict[tuple[str, str], list[Published]]:
    """Return reports of the grader's publishers by topic and type, for the topics that are recorded in full."""
    limited = {gap.topic for gap in recorded.record.unrecorded}
    found: dict[tuple[str, str], list[Published]] = {}
    for entry in recorded.record.published:
        if entry.topic in limited or unread(recorded, entry.topic) is not None:
            continue
        if not _gone_at_once(recorded, entry):
            found.setdefault((entry.topic, entry.type), []).append(entry)
    return found


def _set_apart(recorded: Recorded, topic: str, entries: Sequence[Published]) -> Authorship | None:
    """Separate the messages of some publishers on a topic from others; None if none of them is recorded."""
    apart = None
    if recorded.published_on(topic) == tuple(entries):
        apart = recorded.authorship(topic)
    if apart is None:
        apart = authorship(recorded.bag, topic, entries)
    return apart


def _unseen_at_first(
    recorded: Recorded, topic: str, entries: Sequence[Published], own: Stream
) -> int:
    """Return the number of messages that can precede the recorder, if a publisher did not wait for it."""
    if all(entry.recorded for entry in entries):
        return 0
    return _before_match(recorded, topic, own)


def _gone_at_once(recorded: Recorded, entry: Published) -> bool:
    """Return whether a publisher did not wait for the recorder, and ended before it could be matched."""
    run = recorded.process(entry.process)
    if entry.recorded or run is None:
        return False
    exited_ns = run.exited_ns or recorded.record.ended_ns
    return exited_ns - run.started_ns <= _MATCHED_WITHIN_S * 1e9


def _before_match(recorded: Recorded, topic: str, own: Stream) -> int:
    """Return the number of messages that a volatile publisher can have sent before the recorder was there."""
    if len(own) < 2 or not _is_volatile(recorded, topic):
        return 0
    steps_ns = np.diff(own.source_ns) / np.maximum(1, np.diff(own.sequence))
    early = int(own.sequence.min()) - 1
    early_s = early * float(np.median(steps_ns)) / 1e9
    return early if early_s <= _MATCHED_WITHIN_S else 0


def _is_volatile(recorded: Recorded, topic: str) -> bool:
    """Return whether an endpoint of the grader on a topic keeps no messages for later subscriptions."""
    for endpoint in recorded.endpoints:
        is_ours = endpoint.topic == topic and recorded.is_trusted(endpoint.gid)
        if is_ours and endpoint.qos.durability == "volatile":
            return True
    return False
