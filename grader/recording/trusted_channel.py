"""Reports of the grader's own processes through their pipes, which no student's process can write to.

Students' processes can read and forge everything that travels over DDS. The grader's processes therefore report their
identity and their messages by another way: the director in its messages, a reference node in lines on standard output:

    participant GID_PREFIX
    published TOPIC TYPE DIGESTS [recorded]

The second kind may come in several lines, in order; `-` stands for no messages, `recorded` for a node that waited for
the recorder's subscription before it published.
"""

from __future__ import annotations

import hashlib
import re

from grader.recording.session import ProcessRun, Published, SessionRecord, Trusted

#: Hexadecimal digits of a message's digest, enough that no other message of the same digest can be found within the
#: time of a session.
DIGEST_DIGITS = 12

_PARTICIPANT = re.compile(r"participant ([0-9a-f]{24})")
_PUBLISHED = re.compile(rf"published (/\S+) (\S+) (-|(?:[0-9a-f]{{{DIGEST_DIGITS}}})+)( recorded)?")


def digest(data: bytes) -> str:
    """Return the digest of a message's CDR, its header included.

    RTPS pads messages to a multiple of four bytes, and some messages arrive longer than they were sent.
    """
    padded = data + bytes(-len(data) % 4)
    return hashlib.blake2b(padded, digest_size=DIGEST_DIGITS // 2).hexdigest()


def tells_identity(line: str) -> bool:
    """Return whether a line of a reference node's output is its identity in the graph."""
    return _PARTICIPANT.fullmatch(line) is not None


def collect_trusted_messages(record: SessionRecord) -> None:
    """Move the reports of reference nodes from their output to the record's fields for them."""
    for run in record.processes:
        if run.role == "reference":
            _collect(run, record)


def _collect(run: ProcessRun, record: SessionRecord) -> None:
    by_topic: dict[tuple[str, str], Published] = {}
    kept = []
    for line in run.output:
        if line.stream != "stdout":
            kept.append(line)
            continue
        participant = _PARTICIPANT.fullmatch(line.text)
        published = _PUBLISHED.fullmatch(line.text)
        if participant:
            record.trusted.append(Trusted(run.name, participant[1]))
        elif published:
            topic, topic_type, digests, recorded = published.groups()
            new = Published(run.name, topic, topic_type, "", bool(recorded))
            by_topic.setdefault((topic, topic_type), new).digests += digests.strip("-")
        else:
            kept.append(line)
    run.output = kept
    record.published += by_topic.values()
