"""What the grader's own processes report through their pipes, which no student's process can write to.

Students' processes can read and forge all that travels over DDS. So the grader's report who they are and what they
published by another way: the director in its messages, a reference node in lines on standard output:

    participant GID_PREFIX
    published TOPIC TYPE DIGESTS [recorded]

The last may come in several lines, in order; `-` stands for no messages, `recorded` for a node that waited for the
recorder's subscription before it published.
"""

from __future__ import annotations

import hashlib
import re

from grader.recording.session import Published, SessionRecord, Trusted

#: Hexadecimal digits of one message's digest. It must not be possible to make another message of the same digest
#: within the time of a session.
DIGEST_DIGITS = 12

_PARTICIPANT = re.compile(r"participant ([0-9a-f]{24})")
_PUBLISHED = re.compile(rf"published (/\S+) (\S+) (-|(?:[0-9a-f]{{{DIGEST_DIGITS}}})+)( recorded)?")


def digest(data: bytes) -> str:
    """Return the digest of a message's CDR, its header included.

    RTPS fills what it sends up to a multiple of four bytes, so that some messages arrive longer than they were.
    """
    return hashlib.blake2b(data + bytes(-len(data) % 4), digest_size=DIGEST_DIGITS // 2).hexdigest()


def collect_trusted_messages(record: SessionRecord) -> None:
    """Move what reference nodes have reported from their output to where the record keeps it."""
    for run in (run for run in record.processes if run.role == "reference"):
        by_topic: dict[tuple[str, str], Published] = {}
        output, run.output = run.output, []
        for line in output:
            if line.stream == "stdout" and (match := _PARTICIPANT.fullmatch(line.text)):
                record.trusted.append(Trusted(run.name, match[1]))
            elif line.stream == "stdout" and (match := _PUBLISHED.fullmatch(line.text)):
                new = Published(run.name, match[1], match[2], "", bool(match[4]))
                by_topic.setdefault((new.topic, new.type), new).digests += match[3].strip("-")
            else:
                run.output.append(line)
        record.published += by_topic.values()
