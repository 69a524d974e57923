"""Reports of reference nodes through their pipes, and their removal from the output."""

from __future__ import annotations

import pytest

from grader.recording.session import OutputLine, ProcessRun, Published, SessionRecord, Trusted
from grader.recording.trusted_channel import DIGEST_DIGITS, collect_trusted_messages, digest

ARM = "010f7f01550007db00000000"
ONE, TWO = digest(b"\x00\x01\x00\x00one"), digest(b"\x00\x01\x00\x00two")


def record(*lines: str, role: str = "reference", stream: str = "stdout") -> SessionRecord:
    """Return the record of a session with one process that wrote lines, after its reports were collected."""
    run = ProcessRun("arm", role, [], output=[OutputLine(1, stream, line) for line in lines])
    taken = SessionRecord("launch", processes=[run])
    collect_trusted_messages(taken)
    return taken


def left(taken: SessionRecord) -> list[str]:
    """Give the lines that stayed in the output."""
    return [line.text for line in taken.processes[0].output]


def test_what_a_reference_node_tells_moves_to_the_record() -> None:
    """Its participant and its publications, joined by topic, are taken out of the output; the rest stays."""
    taken = record(
        f"participant {ARM}",
        "ready",
        f"published /joint_states std_msgs/msg/Float64MultiArray {ONE}",
        "published /clock rosgraph_msgs/msg/Clock - recorded",
        f"published /joint_states std_msgs/msg/Float64MultiArray {TWO}{ONE}",
    )
    assert taken.trusted == [Trusted("arm", ARM)]
    assert taken.published == [
        Published("arm", "/joint_states", "std_msgs/msg/Float64MultiArray", ONE + TWO + ONE),
        Published("arm", "/clock", "rosgraph_msgs/msg/Clock", "", recorded=True),
    ]
    assert left(taken) == ["ready"]


@pytest.mark.parametrize(
    ("role", "stream"), [("student", "stdout"), ("grader", "stdout"), ("reference", "stderr")]
)
def test_nobody_else_can_tell_anything(role: str, stream: str) -> None:
    """Lines of a student's process, and those on standard error, are output like any other."""
    lines = (f"participant {ARM}", f"published /a b/msg/C {ONE}")
    taken = record(*lines, role=role, stream=stream)
    assert (taken.trusted, taken.published, left(taken)) == ([], [], list(lines))


@pytest.mark.parametrize(
    "line",
    [
        "participant",
        f"participant {ARM}00",
        "published /a b/msg/C",
        f"published /a b/msg/C {ONE[:-1]}",
    ],
)
def test_a_line_that_is_cut_tells_nothing(line: str) -> None:
    """A line that is no complete report is ordinary output."""
    taken = record(line)
    assert (taken.trusted, taken.published, left(taken)) == ([], [], [line])


def test_a_digest_has_its_digits_and_depends_on_every_byte() -> None:
    """Digests can be cut apart by their length, and two messages have two."""
    assert len(ONE) == DIGEST_DIGITS
    assert len({digest(bytes([n])) for n in range(256)}) == 256


def test_what_rtps_adds_does_not_change_a_digest() -> None:
    """A message arrives with zeros up to a multiple of four bytes, and has the digest of the sent message."""
    assert digest(b"\x00\x01\x00\x00odd") == digest(b"\x00\x01\x00\x00odd\x00")
    assert digest(b"\x00\x01\x00\x00even") != digest(b"\x00\x01\x00\x00even\x00\x00\x00\x00")
