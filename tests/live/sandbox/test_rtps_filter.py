"""The filter of the grader's own sockets, tried with sockets and packets as they are."""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Iterator

import pytest

from grader.live.sandbox.rtps_filter import rtps_filter

OURS, THEIRS = bytes(range(1, 13)), bytes(range(41, 53))
WRITER = b"\0\0\1\3"
HEAD = b"RTPS\2\3\1\x0f"


def part(kind: int, body: bytes, order: str = "<") -> bytes:
    """Give a part of a packet, in an order of bytes."""
    return struct.pack(f"{order}BBH", kind, order == "<", len(body)) + body


def gap(first: int, beyond: int, order: str = "<") -> bytes:
    """Give the part that declares messages irrelevant."""
    numbers = struct.pack(
        f"{order}iIiII", first >> 32, first % 2**32, beyond >> 32, beyond % 2**32, 0
    )
    return part(0x08, bytes(4) + WRITER + numbers, order)


TIME, DATA = part(0x09, bytes(8)), part(0x15, bytes(40))
OTHER_SOURCE = part(0x0C, bytes(8) + OURS)


@pytest.fixture
def sockets() -> Iterator[tuple[socket.socket, socket.socket]]:
    """Give a socket of a process of the grader's, which is this one, and one that was never marked."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
        ours.bind(("127.0.0.1", 0))
        ours.settimeout(0.2)
        guard = rtps_filter()
        guard.protect(os.getpid(), OURS.hex())
        guard.arm()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as theirs:
            yield ours, theirs


def arrives(ours: socket.socket, sender: socket.socket, packet: bytes) -> bool:
    """Say if a packet reaches the grader's socket."""
    sender.sendto(packet, ours.getsockname())
    try:
        return ours.recv(65536) == packet
    except TimeoutError:
        return False


@pytest.mark.parametrize(
    ("packet", "passes"),
    [
        (HEAD + THEIRS + TIME + DATA, True),
        (HEAD + THEIRS + TIME + gap(1, 70_000), True),
        (HEAD + THEIRS + TIME + gap(1, 70_000, ">"), True),
        (HEAD + THEIRS + TIME + DATA * 40, True),
        (HEAD + THEIRS[:4], True),
        (HEAD + THEIRS + gap(1, 9)[:20], True),
        (HEAD + THEIRS + gap(1, 2**40), False),
        (HEAD + THEIRS + TIME + DATA + gap(1, 2**30, ">"), False),
        (HEAD + THEIRS + gap(-(2**40), 9), False),
    ],
)
def test_what_a_gap_may_span(
    sockets: tuple[socket.socket, socket.socket], packet: bytes, passes: bool
) -> None:
    """No more numbers than a session can have, wherever it stands in the packet, in either order of bytes."""
    assert arrives(*sockets, packet) == passes


@pytest.mark.skipif(
    os.geteuid() != 0, reason="sockets are marked by root only, or in a network of one's own"
)
@pytest.mark.parametrize("packet", [HEAD + OURS + DATA, HEAD + THEIRS + TIME + OTHER_SOURCE + DATA])
def test_a_name_of_the_graders_comes_from_the_grader_only(
    sockets: tuple[socket.socket, socket.socket], packet: bytes
) -> None:
    """Only the grader's own sockets send packets with the grader's name or a part of it."""
    ours, theirs = sockets
    assert not arrives(ours, theirs, packet)
    assert arrives(ours, ours, packet)


@pytest.mark.parametrize("is_early", [True, False])
def test_sockets_are_filtered_as_soon_as_the_filter_is_armed(*, is_early: bool) -> None:
    """Sockets that were known before are filtered by then, and later ones at once."""
    guard = rtps_filter()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
        ours.bind(("127.0.0.1", 0))
        ours.settimeout(0.2)

        def passes(packet: bytes) -> bool:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unmarked:
                return arrives(ours, unmarked, packet)

        endless = HEAD + THEIRS + gap(1, 2**40)
        if is_early:
            guard.protect(os.getpid())
            assert passes(endless)
        guard.arm()
        if not is_early:
            assert passes(endless)
            guard.protect(os.getpid())
        assert not passes(endless)
        assert passes(HEAD + THEIRS + DATA)
