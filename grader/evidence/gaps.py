"""What is missing in a recording: what the recorder left out, and what never reached it; and whose doing that is."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from grader.evidence.authorship import Authorship, authorship, digests_of
from grader.evidence.recorded import Recorded
from grader.recording.bag import Stream
from grader.recording.session import ProcessRun, Published, RecordingGap
from grader.recording.trusted_channel import digest

#: The limit of a session's recording, as `ProcessRun.limit` names limits.
RECORDING = "recording"
#: The limit of what is decoded of a topic.
DECODING = "decoding"
#: What fills a recording takes long to look through, and each check of its session asks.
_MOST_KEPT = 4


def gaps_by_student(recorded: Recorded) -> list[RecordingGap]:
    """Return the gaps of a recording that come of the student's processes; others cannot be laid at their door.

    Topics share the room of a recording, so that it counts who filled the whole. Where one of the grader's own
    processes did not report what it published, nobody can say. A topic of which nothing was recorded is the student's
    unless the grader publishes it.
    """
    ours = {(entry.topic, entry.type) for entry in recorded.record.published}
    known = [] if recorded.silent_references else recorded.record.unrecorded
    unseen = [gap for gap in known if gap.messages == 0 and (gap.topic, gap.type) not in ours]
    return [gap for gap in known if gap in unseen or (gap.limit and _student_wrote_more(recorded))]


@functools.lru_cache(maxsize=_MOST_KEPT)
def _student_wrote_more(recorded: Recorded) -> bool:
    """Whether most of the recording is not the grader's own."""
    bag = recorded.bag
    own = 0
    for entry in recorded.record.published:
        digests = set(digests_of(entry))
        own += sum(
            len(data)
            for data in bag.stream(entry.topic, entry.type).data
            if digest(data) in digests
        )
    return own <= bag.size_bytes - own


@dataclass
class UnreadGap(RecordingGap):
    """Messages that are recorded, and not looked at: decoding them would take too long."""


def unread(recorded: Recorded, topic: str) -> UnreadGap | None:
    """Return which messages on a topic (of the graph) are not looked at; None if all are."""
    stream = recorded.bag.stream(topic)
    if not stream.unread:
        return None
    seen = len(stream)
    t_ns = int(stream.received_ns[-1]) if seen else recorded.record.started_ns
    reason = "they hold more values than are decoded of a topic"
    size_bytes = sum(map(len, stream.data))
    return UnreadGap(topic, stream.topic_type, t_ns, seen, size_bytes, reason, limit=True)


def is_unread_by_student(recorded: Recorded, gap: UnreadGap) -> bool:
    """Whether the student's messages are what makes a topic too long: none of the grader's is among the first ones."""
    if recorded.silent_references:
        return False
    ours = [entry for entry in recorded.record.published if entry.topic == gap.topic]
    digests = {each for entry in ours for each in digests_of(entry)}
    data = recorded.bag.stream(gap.topic).data
    own_bytes = sum(len(each) for each in data if digest(each) in digests) if digests else 0
    return not ours or own_bytes <= gap.size_bytes - own_bytes


def describe_gap(gap: RecordingGap) -> str:
    """Say what was left out, and why."""
    if isinstance(gap, UnreadGap):
        many = f"the first {gap.messages}" if gap.messages else "none"
        return f"Of the messages on {gap.topic} {many} were looked at: {gap.reason} (limit: {DECODING})."
    if not gap.limit:
        return f"Messages on {gap.topic} of type {gap.type} cannot be recorded: {gap.reason}."
    if not gap.messages:
        return f"Messages on {gap.topic} are not recorded: {gap.reason} (limit: {RECORDING})."
    size = f"{_in_words(gap.size_bytes)}, {_in_words(gap.size_bytes / gap.messages)} each"
    many = f"the first {gap.messages} messages" if gap.messages > 1 else "the first message"
    return f"Only {many} on {gap.topic} ({size}) are recorded: {gap.reason} (limit: {RECORDING})."


def _in_words(size_bytes: float) -> str:
    return f"{size_bytes / 1e6:.3g} MB" if size_bytes >= 1e6 else f"{size_bytes / 1e3:.3g} kB"


def limits_hit(recorded: Recorded) -> dict[str, str]:
    """Return the limits that a session's processes hit, by the process's name."""
    found = {run.name: run.limit for run in recorded.record.processes if run.limit is not None}
    for gap in gaps_by_student(recorded):
        if gap.limit and (run := _publisher_of(recorded, gap)) is not None:
            found.setdefault(run.name, RECORDING)
    return found


def _publisher_of(recorded: Recorded, gap: RecordingGap) -> ProcessRun | None:
    """Return the student's process that published a topic, by what its nodes asked for; else the busiest one."""
    students = [run for run in recorded.record.processes if run.role == "student"]
    asking = {claim.process for claim in recorded.claims_of("publisher", gap.topic)}
    asked = [run for run in students if run.name in asking]
    return max(
        asked or students, key=lambda run: run.usage[-1].cpu_ns if run.usage else 0, default=None
    )


#: So many may be missing: more than a reliable connection on loopback loses, and too few to change a verdict.
_HARMLESS = 0.05
#: For so long one that does not wait for the recorder's subscription may publish before it is matched: in vain, if it
#: keeps nothing for those who come later, or is gone by then.
_MATCHED_WITHIN_S = 5.0


@functools.lru_cache(maxsize=_MOST_KEPT)
def dropped(recorded: Recorded) -> Mapping[str, str]:
    """Return the topics on which messages of the grader's own processes are missing, each with a sentence.

    A process that can send packets there can pretend that messages are missing, or put others in their place.
    Therefore the recorded messages are compared with the reports of the trusted channel.
    """
    found: dict[str, str] = {}
    for (topic, _), entries in _comparable(recorded).items():
        published = sum(len(digests_of(entry)) for entry in entries)
        apart = _set_apart(recorded, topic, entries)
        there = early = 0
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
    """Return how many messages may precede the recorder, if a publisher did not wait for it."""
    if all(entry.recorded for entry in entries):
        return 0
    return _before_match(recorded, topic, own)


def _gone_at_once(recorded: Recorded, entry: Published) -> bool:
    run = recorded.process(entry.process)
    if entry.recorded or run is None:
        return False
    return (run.exited_ns or recorded.record.ended_ns) - run.started_ns <= _MATCHED_WITHIN_S * 1e9


def _before_match(recorded: Recorded, topic: str, own: Stream) -> int:
    """Return how many messages may have been published before the recorder was there, by one who keeps none."""
    publishers = [e for e in recorded.endpoints if e.topic == topic and recorded.is_trusted(e.gid)]
    steps = np.diff(own.source_ns) / np.maximum(1, np.diff(own.sequence))
    if not len(steps) or not any(e.qos.durability == "volatile" for e in publishers):
        return 0
    first = int(own.sequence.min())
    return first - 1 if (first - 1) * float(np.median(steps)) / 1e9 <= _MATCHED_WITHIN_S else 0
