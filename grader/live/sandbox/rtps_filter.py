"""The filter that keeps packets in the grader's name, and those that would hang it, from the grader's own sockets.

Every program in a sandbox can write to every UDP socket there. The grader's own sockets are marked. The filter drops
packets without the mark that bear the name of a reference node, or that hold a GAP of more numbers than any session
has, because Fast DDS 2.14 goes through all of them (CVE-2025-64438). `grader.evidence.integrity` sees the packets that
get past it.

References
----------
DDSI-RTPS 2.5, sections 8.3.5 and 9.4; socket(7): SO_MARK, SO_ATTACH_FILTER; pidfd_getfd(2).
"""

from __future__ import annotations

import struct
from collections.abc import Collection

from confine.packet_filter import MARK, PacketFilter
from confine.seccomp import step

# Classic BPF. Loads: a word at an offset, a byte, half or word beyond X, the packet's length; then arithmetic and jumps.
_WORD, _BYTE_AT_X, _HALF_AT_X, _WORD_AT_X, _LENGTH, _STORED_TO_X = (
    0x20, 0x50, 0x48, 0x40, 0x80, 0x61,
)  # fmt: skip
_ADD, _ADD_X, _SUBTRACT, _SHIFT_LEFT, _OR_X, _SET_X, _TO_X, _STORE, _STORE_X = (
    0x04, 0x0C, 0x14, 0x64, 0x4C, 0x01, 0x07, 0x02, 0x03,
)  # fmt: skip
_JUMP, _EQUAL, _AT_LEAST, _AT_LEAST_X, _ANY_BIT, _RETURN = 0x05, 0x15, 0x35, 0x3D, 0x45, 0x06
_MARK_OF_PACKET = 0xFFFFF000 + 20

#: Behind the header of UDP, RTPS has four letters, version and vendor, and then the sender's prefix.
_PREFIX, _FIRST_PART = 16, 28
_GAP, _INFO_SOURCE = 0x08, 0x0C
#: Number of parts of a packet to examine: older kernels keep 20 KiB for a socket's filter and other settings.
_MOST_PARTS = 24

_DROP, _PASS = step(_RETURN, 0), step(_RETURN, 0xFFFFFFFF)


def filter_program(prefixes: Collection[bytes]) -> bytes:
    """Return the filter for sockets of the grader's, where participants with these prefixes of 12 bytes are its own."""
    steps = [step(_WORD, _MARK_OF_PACKET), step(_EQUAL, MARK, 0, 1), _PASS]
    steps += [step(_LENGTH), step(_AT_LEAST, _FIRST_PART, 1, 0), _PASS]
    for prefix in prefixes:
        for place, word in enumerate(struct.unpack(">III", prefix)):
            steps += [step(_WORD, _PREFIX + 4 * place), step(_EQUAL, word, 0, 5 - 2 * place)]
        steps.append(_DROP)
    return b"".join(
        [*steps, step(_SET_X, _FIRST_PART), *_look_at_part(bool(prefixes)) * _MOST_PARTS, _PASS]
    )


def _look_at_part(named: bool) -> list[bytes]:
    """Return steps that look at the part of a packet that begins at X, and set X to the next."""
    source = [step(_EQUAL, _INFO_SOURCE, 0, 1), _DROP] if named else []
    gap = _unless_shorter(28)
    for high in (12, 20):  # of the first number, and of the one after the last
        gap += [step(_WORD_AT_X, high), step(_EQUAL, 0, 1, 0), _DROP]
    gap += [
        step(_BYTE_AT_X, 1),
        step(_ANY_BIT, 1, 0, 2),
        step(_BYTE_AT_X, 27),
        step(_EQUAL, 0, 3, 2),
    ]
    gap += [step(_BYTE_AT_X, 24), step(_EQUAL, 0, 1, 0), _DROP]
    length = [step(_BYTE_AT_X, 1), step(_ANY_BIT, 1, 0, 8)]
    length += [
        step(_BYTE_AT_X, 3),
        step(_SHIFT_LEFT, 8),
        step(_STORE, 0),
        step(_STORE_X, 1),
        step(_BYTE_AT_X, 2),
    ]
    length += [step(_STORED_TO_X, 0), step(_OR_X), step(_JUMP, 2)]
    length += [step(_STORE_X, 1), step(_HALF_AT_X, 2)]
    length += [step(_STORED_TO_X, 1), step(_ADD_X), step(_ADD, 4), step(_TO_X)]
    return [
        *_unless_shorter(4),
        step(_BYTE_AT_X, 0),
        *source,
        step(_EQUAL, _GAP, 0, len(gap)),
        *gap,
        *length,
    ]


def _unless_shorter(size: int) -> list[bytes]:
    """Return steps that let a packet pass which ends before so many bytes from X."""
    return [step(_LENGTH), step(_SUBTRACT, size), step(_AT_LEAST_X, 0, 1, 0), _PASS]


def rtps_filter() -> PacketFilter:
    """Return the filter of one sandbox's sockets; the names that it protects are prefixes of participants."""
    return PacketFilter(filter_program)
