"""Integrity: tampering with the grader's nodes and traffic, and honest sessions."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from grader.evidence.integrity import Tampering, tampering_in
from grader.evidence.recorded import Recorded
from grader.judging.rubrics import read_rubric
from grader.recording.session import (
    SESSION_FILE,
    UNKNOWN_NODE,
    Endpoint,
    GraphSnapshot,
    OutputLine,
    ProcessRun,
    Published,
    ServiceEndpoint,
    Trusted,
)
from grader.recording.trusted_channel import digest
from grader.result import Location, ViolationKind
from ros_bag.qos import Qos
from tests.synthetic import FLOATS, ROOT, Session, at, floats

KEPT = sorted(path.parent for path in (ROOT / "tests/recordings").glob(f"*/*/{SESSION_FILE}"))
ARM, STUDENT, PROBE = "0a" * 12, "0b" * 12, "0c" * 8
NODES = {"arm": "/simulated_arm", "plateaus": "/plateau_stimulus"}
STATES, COMMANDS, CLOCK = "/joint_states", "/joint_commands", "/clock"
CLOCK_TYPE = "rosgraph_msgs/msg/Clock"
LOG = "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n"
TIME = f"{'=' * 80}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"


def endpoint(
    node: str, participant: str, topic: str, kind: str = "publisher", number: int = 1
) -> Endpoint:
    """Give an endpoint of a node in the graph."""
    return Endpoint(kind, topic, FLOATS, "", node, f"{participant}{number:08x}")


def session(folder: Path, *, attempt: int = 1, arm_status: int = 0) -> Session:
    """Give a session as it goes with an honest student: the arm publishes states, the student commands."""
    made = Session(folder)
    record = made.record
    record.attempt = attempt
    arm = ProcessRun(
        "arm", "reference", [], started_ns=at(0.5), exited_ns=at(6.0), exit_status=arm_status
    )
    arm.interrupted_ns = at(5.9) if arm_status == 0 else None
    record.processes += [ProcessRun("director", "grader", []), arm]
    record.trusted += [Trusted("director", PROBE), Trusted("arm", ARM)]
    rows, times = [[0.1 * n] for n in range(5)], [1.0, 2.0, 3.0, 4.0, 4.5]
    record.published.append(
        Published("arm", STATES, FLOATS, "".join(digest(floats(row)) for row in rows))
    )
    made.messages(STATES, rows, times).messages(COMMANDS, rows, times)
    record.graph[:] = [
        GraphSnapshot(at(0.2)),
        GraphSnapshot(
            at(0.5),
            ["/joint_command_publisher", "/joint_state_subscriber"],
            [
                endpoint("/joint_command_publisher", STUDENT, COMMANDS),
                endpoint("/joint_state_subscriber", STUDENT, STATES, "subscription", 2),
                endpoint("/joint_command_publisher", STUDENT, "/parameter_events", number=3),
            ],
        ),
    ]
    whole = record.graph[-1]
    arms = [
        endpoint("/simulated_arm", ARM, STATES),
        endpoint("/simulated_arm", ARM, COMMANDS, "subscription", 2),
        endpoint("/simulated_arm", ARM, "/parameter_events", number=3),
    ]
    # An endpoint is often seen before the name of its node.
    unknown = [endpoint(f"_NAMESPACE_/{UNKNOWN_NODE}", ARM, STATES)]
    record.graph.append(GraphSnapshot(at(0.9), list(whole.nodes), whole.endpoints + unknown))
    record.graph.append(
        GraphSnapshot(at(1.0), [*whole.nodes, "/simulated_arm"], whole.endpoints + arms)
    )
    return made.step("wait_for", "commands", parameters={"publisher": COMMANDS})


def add(made: Session, *endpoints: Endpoint) -> Session:
    """Put endpoints into the last snapshot."""
    made.record.graph[-1].endpoints += endpoints
    return made


def taken(made: Session) -> tuple[Tampering, ...]:
    """Give the tampering in a session."""
    return tampering_in(made.recorded(), NODES)


def kinds(made: Session) -> list[ViolationKind]:
    """Give the kinds of all that was found."""
    return [tampering.violation.kind for tampering in taken(made)]


# -- honest ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("folder", KEPT, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_nothing_is_found_in_a_kept_recording(folder: Path) -> None:
    """No recording of an honest submission, right or wrong, holds anything; each knows the grader's own processes."""
    nodes = {name: spec.node for name, spec in read_rubric(None).reference.items()}
    recorded = Recorded.open(folder)
    assert tampering_in(recorded, nodes) == ()
    ran = {run.name for run in recorded.record.processes if run.role in ("reference", "grader")}
    assert {trusted.process for trusted in recorded.record.trusted} == ran
    assert not recorded.silent_references


def test_an_honest_session_holds_nothing(tmp_path: Path) -> None:
    """A student's node that publishes commands and hears states is no violation."""
    assert taken(session(tmp_path)) == ()


def test_the_students_own_topics_and_services_are_its_own(tmp_path: Path) -> None:
    """Two publishers of a topic, two nodes of a name and two servers of a service of one student touch nothing."""
    made = session(tmp_path).messages(COMMANDS, [[1.0]], [2.5])
    add(made, endpoint("/joint_command_publisher", "0d" * 12, COMMANDS))
    last = made.record.graph[-1]
    last.nodes.append("/joint_command_publisher")
    last.services += [
        ServiceEndpoint("/robot/enable", "std_srvs/srv/SetBool", node) for node in ("/a", "/b")
    ]
    last.clients.append(
        ServiceEndpoint("/a/set_parameters", "rcl_interfaces/srv/SetParameters", "/b")
    )
    assert taken(made) == ()


def test_nodes_that_come_back_touch_nothing(tmp_path: Path) -> None:
    """The endpoints of a dead process stay in the graph beside its second start's."""
    made = session(tmp_path)
    add(
        made,
        *(
            endpoint("/joint_state_subscriber", "0e" * 12, STATES, "subscription", n)
            for n in range(3)
        ),
    )
    assert taken(made) == ()


def test_a_silent_publisher_touches_nothing(tmp_path: Path) -> None:
    """A publisher on the arm's topic that never publishes, as a copied line leaves it, changes nothing."""
    assert (
        taken(
            add(session(tmp_path), endpoint("/joint_state_subscriber", STUDENT, STATES, number=9))
        )
        == ()
    )


def test_a_recording_that_was_reported_nothing_holds_nothing(tmp_path: Path) -> None:
    """Without reports through the pipes, as in older recordings, no endpoint can be attributed."""
    for name, keep in (("none", []), ("no arm", [Trusted("director", PROBE)])):
        made = session(tmp_path / name).messages(STATES, [[9.0]], [2.5])
        made.record.trusted[:] = keep
        add(made, endpoint("/simulated_arm", STUDENT, STATES, number=9))
        assert taken(made) == ()


# -- nodes -----------------------------------------------------------------------------------------


def test_a_second_node_of_a_reference_nodes_name(tmp_path: Path) -> None:
    """The impostor is told by its gids, which differ from the arm's, and both are shown."""
    (tampering,) = taken(
        add(session(tmp_path), endpoint("/simulated_arm", STUDENT, "/parameter_events", number=9))
    )
    violation = tampering.violation
    assert (violation.kind, violation.session) == (ViolationKind.IMPERSONATES_NODE, "experiment")
    assert violation.certain
    assert "/simulated_arm" in violation.text
    assert f"{STUDENT}00000009" in violation.evidence[0]
    assert ARM in violation.evidence[1]
    assert violation.where == Location(session="experiment", start_s=1.0, end_s=30.0)
    assert tampering.invalidated == {"/simulated_arm"}


def test_the_name_of_a_reference_node_that_does_not_run_here(tmp_path: Path) -> None:
    """Names of reference nodes belong to the grader in every session.

    A node of such a name is not judged as the student's.
    """
    (tampering,) = taken(
        add(session(tmp_path), endpoint("/plateau_stimulus", STUDENT, "/rosout", number=9))
    )
    assert tampering.violation.kind is ViolationKind.IMPERSONATES_NODE
    assert len(tampering.violation.evidence) == 1


def test_a_node_in_the_graders_namespace(tmp_path: Path) -> None:
    """Nodes there are the grader's; however many others there are, they are told together."""
    others = [endpoint(f"/_grader/{n}", STUDENT, "/rosout", number=n) for n in range(20)]
    (tampering,) = taken(add(session(tmp_path), *others))
    assert tampering.violation.kind is ViolationKind.IMPERSONATES_NODE
    assert "/_grader/0" in tampering.violation.evidence[0]
    assert tampering.violation.evidence[-1] == "and 15 more"


@pytest.mark.parametrize("offered", [False, True])
def test_a_client_that_sets_parameters_of_a_reference_node(tmp_path: Path, offered: bool) -> None:
    """The attempt is reported, and its failure if the node has no such service."""
    made = session(tmp_path)
    name, kind = "/simulated_arm/set_parameters", "rcl_interfaces/srv/SetParameters"
    made.record.graph[-1].clients.append(ServiceEndpoint(name, kind, "/student"))
    if offered:
        made.record.graph[-1].services.append(ServiceEndpoint(name, kind, "/simulated_arm"))
    (tampering,) = taken(made)
    assert tampering.violation.kind is ViolationKind.CHANGES_REFERENCE
    assert tampering.violation.evidence == (f"client of {name} in node /student",)
    assert ("nothing of it was changed" in tampering.violation.text) != offered
    assert not tampering.invalidated


def test_a_client_that_only_reads_parameters_touches_nothing(tmp_path: Path) -> None:
    """To look is free."""
    made = session(tmp_path)
    client = ServiceEndpoint(
        "/simulated_arm/get_parameters", "rcl_interfaces/srv/GetParameters", "/student"
    )
    made.record.graph[-1].clients.append(client)
    assert taken(made) == ()


def test_a_second_server_of_a_reference_nodes_service(tmp_path: Path) -> None:
    """Answers of that service can no longer be measured, because the answering node is unknown."""
    made = session(tmp_path)
    for node in ("/simulated_arm", "/student"):
        made.record.graph[-1].services.append(
            ServiceEndpoint("/arm/reset", "std_srvs/srv/Trigger", node)
        )
    (tampering,) = taken(made)
    assert tampering.violation.kind is ViolationKind.SECOND_SERVER
    assert tampering.violation.evidence == ("server of /arm/reset in node /student",)
    assert tampering.invalidated == {"/arm/reset"}


def test_a_service_that_the_steps_expect_is_the_students(tmp_path: Path) -> None:
    """The lab asks the student to offer the service, even if the grader does as well."""
    made = session(tmp_path).step("call", "reset", parameters={"service": "/arm/reset"})
    for node in ("/simulated_arm", "/student"):
        made.record.graph[-1].services.append(
            ServiceEndpoint("/arm/reset", "std_srvs/srv/Trigger", node)
        )
    assert taken(made) == ()


ENABLE = "/robot/enable"


def rivals(made: Session, programs: Sequence[str], participants: Sequence[str]) -> Session:
    """Let two nodes offer a service that the steps call, from programs and participants."""
    for node, participant in zip(("/one", "/two"), participants, strict=True):
        add(made, endpoint(node, participant, "/parameter_events", number=9))
        made.record.graph[-1].services.append(ServiceEndpoint(ENABLE, "std_srvs/srv/SetBool", node))
    for program in programs:
        made.record.processes.append(
            ProcessRun(program, "student", [program, "--ros-args"], started_ns=at(0.3))
        )
    return made.step("call", "enable", parameters={"service": ENABLE})


def test_two_servers_in_two_programs_of_the_student(tmp_path: Path) -> None:
    """The answering program is unknown; the report states it, and nothing fails."""
    made = rivals(session(tmp_path), ["service", "publisher"], ["0d" * 12, "0e" * 12])
    (tampering,) = taken(made)
    assert tampering.violation.kind is ViolationKind.SECOND_SERVER
    assert (
        "/one and /two of the submission both offer the service /robot/enable"
        in tampering.violation.text
    )
    assert not tampering.invalidated


def test_two_servers_in_one_process_touch_nothing(tmp_path: Path) -> None:
    """A program may be made of many nodes, whatever their participants."""
    participants = ["0d" * 8 + "00000000", "0d" * 8 + "01000000"]
    assert taken(rivals(session(tmp_path), ["service", "publisher"], participants)) == ()


def test_a_program_that_runs_twice_touches_nothing(tmp_path: Path) -> None:
    """The steps may start a program again under other names; the program may ignore the names."""
    assert taken(rivals(session(tmp_path), ["service", "service"], ["0d" * 12, "0e" * 12])) == ()


@pytest.mark.parametrize(("repeated", "certain"), [(False, False), (True, True)])
def test_a_process_of_the_graders_that_is_brought_down(
    tmp_path: Path, repeated: bool, certain: bool
) -> None:
    """The first time may be chance.

    The second time the submission's programs are the cause, and nothing is measured.
    """
    made = session(tmp_path, attempt=2, arm_status=-11)
    made.record.disturbed_before = repeated
    (tampering,) = taken(made)
    assert (tampering.violation.kind, tampering.violation.certain) == (
        ViolationKind.ENDS_REFERENCE,
        certain,
    )
    assert "/simulated_arm ended by signal 11" in tampering.violation.text
    assert "recording number 2" in tampering.violation.evidence[0]
    assert tampering.whole


@pytest.mark.parametrize(
    ("facts", "found"),
    [
        ({"exit_status": -6}, 1),
        ({"exit_status": 1, "output": [OutputLine(at(4.0), "stderr", "std::bad_alloc")]}, 1),
        ({"exit_status": -9, "ended_by": "kill"}, 1),
        ({"exit_status": -9}, 0),
        ({"exit_status": 1, "output": [OutputLine(at(4.0), "stderr", "KeyError: 'seed'")]}, 0),
    ],
)
def test_whose_doing_the_end_of_the_recorder_is(
    tmp_path: Path, facts: dict[str, Any], found: int
) -> None:
    """Crashes of native code and hangs come by packets; a kill by the system and a mistake of our own do not."""
    made = session(tmp_path)
    made.record.processes[0] = ProcessRun(
        "director", "grader", [], started_ns=at(0.1), exited_ns=at(4.0), **facts
    )
    assert kinds(made) == [ViolationKind.ENDS_REFERENCE] * found


@pytest.mark.parametrize(
    ("problem", "attempt", "recorder_s", "found"),
    [
        ("the session took longer than 90 s and was stopped", 3, 0.0, 1),
        ("recording stopped early: KeyError: 7", 2, 0.0, 1),
        ("the reference node arm did not become ready", 1, 0.0, 0),
        ("the recorder died: KeyError: 'seed'", 2, 9.0, 0),
    ],
)
def test_trouble_that_comes_again_is_named(
    tmp_path: Path, problem: str, attempt: int, recorder_s: float, found: int
) -> None:
    """Repeated trouble on an idle machine is reported to a person, and fails nothing by itself."""
    made = (
        session(tmp_path, attempt=attempt)
        .process("joint_publisher")
        .delayed("director", recorder_s, 20.0)
    )
    made.record.problems.append(problem)
    tampering = taken(made)
    assert [(t.violation.kind, t.violation.certain) for t in tampering] == [
        (ViolationKind.DISTURBS_RECORDING, False)
    ] * found
    assert [t.violation.evidence for t in tampering] == [(problem,)] * found


@pytest.mark.parametrize(("attempt", "found"), [(1, 0), (3, 1)])
def test_a_recording_that_is_cut_off_again_is_named(
    tmp_path: Path, attempt: int, found: int
) -> None:
    """The rest of a cut recording does not even tell the started programs."""
    made = session(tmp_path, attempt=attempt)
    made.record.complete, made.record.ended_ns = False, 0
    made.record.processes.clear()
    made.record.trusted.clear()
    assert [t.violation.evidence for t in taken(made)] == [("the recording was cut off",)] * found


# -- what was published and not recorded -----------------------------------------------------------


def published(
    made: Session, count: int, recorded: Iterable[int], durability: str = "transient_local"
) -> Session:
    """Let the plateaus have published so many messages on a topic of their own at 100 Hz, and some be recorded."""
    rows = [[0.25 * n] for n in range(count)]
    made.record.published.append(
        Published("arm", "/plan", FLOATS, "".join(digest(floats(row)) for row in rows))
    )
    offered = replace(
        endpoint("/simulated_arm", ARM, "/plan", number=7), qos=Qos("reliable", durability)
    )
    add(made, offered)
    kept = sorted(recorded)
    made.messages(
        "/plan",
        [rows[n] for n in kept],
        [1 + n / 100 for n in kept],
        sequence=[n + 1 for n in kept],
    )
    return made


@pytest.mark.parametrize("repeated", [False, True])
@pytest.mark.parametrize(
    "recorded", [range(150), range(950, 1100), [*range(400), *range(800, 1100)], []]
)
def test_messages_that_never_reached_the_recorder(
    tmp_path: Path, recorded: Sequence[int], repeated: bool
) -> None:
    """By whatever part is missing: the first, the last, some between, or all."""
    made = published(session(tmp_path), 1100, recorded)
    made.record.disturbed_before = repeated
    (tampering,) = taken(made)
    assert tampering.violation.kind is ViolationKind.DISTURBS_RECORDING
    assert (
        f"Of the 1100 messages that the grader published on /plan {len(recorded)} are"
        in tampering.violation.text
    )
    assert (tampering.violation.certain, tampering.invalidated) == (repeated, frozenset({"/plan"}))


def test_messages_in_the_place_of_the_graders(tmp_path: Path) -> None:
    """Foreign messages took the grader's sequence numbers.

    The recorder dropped the grader's own messages as repeats.
    """
    made = published(session(tmp_path), 300, range(100))
    made.messages(
        "/plan", [[7.0]] * 200, [2 + n / 100 for n in range(200)], sequence=range(101, 301)
    )
    assert kinds(made) == [ViolationKind.DISTURBS_RECORDING]


def test_a_few_messages_may_be_missing(tmp_path: Path) -> None:
    """Messages lost to a late match or to the shutdown change no verdict."""
    assert taken(published(session(tmp_path), 300, range(4, 290))) == ()


def test_who_keeps_no_message_may_begin_before_the_recorder_is_there(tmp_path: Path) -> None:
    """The first seconds of a volatile publisher are excused; of one that keeps messages and waits, they are not."""
    assert taken(published(session(tmp_path / "volatile"), 600, range(300, 600), "volatile")) == ()
    kept = published(session(tmp_path / "kept"), 600, range(300, 600))
    assert kinds(kept) == [ViolationKind.DISTURBS_RECORDING]


def test_who_is_gone_at_once_may_not_have_been_heard(tmp_path: Path) -> None:
    """In a session of one step, a reference node may publish before the recorder is matched."""
    made = published(session(tmp_path), 20, [])
    assert kinds(made) == [ViolationKind.DISTURBS_RECORDING]
    next(run for run in made.record.processes if run.name == "arm").exited_ns = at(1.0)
    assert taken(made) == ()


def test_what_a_late_machine_loses_is_nobodys_doing(tmp_path: Path) -> None:
    """The recorder had no core for seconds: that is tried again, and nobody is named."""
    made = published(session(tmp_path), 1100, range(150)).delayed(
        "director", delay_s=9.0, until_s=20.0
    )
    made.record.disturbed_before = True
    assert taken(made) == ()


# -- topics ----------------------------------------------------------------------------------------


def test_messages_on_a_reference_nodes_topic(tmp_path: Path) -> None:
    """Foreign messages are counted, and their publisher is named.

    The arm's messages remain usable.
    """
    made = session(tmp_path).messages(STATES, [[9.0], [9.1]], [1.5, 2.5])
    add(made, endpoint("/joint_state_subscriber", STUDENT, STATES, number=9))
    (tampering,) = taken(made)
    violation = tampering.violation
    assert violation.kind is ViolationKind.PUBLISHES_ON_REFERENCE_TOPIC
    assert violation.certain
    assert "(/joint_state_subscriber) published on /joint_states" in violation.text
    assert violation.evidence[0].startswith(
        "2 messages recorded on /joint_states from 1.5 to 2.5 s are none of the"
    )
    assert f"{STUDENT}00000009" in violation.evidence[1]
    assert violation.where == Location(session="experiment", topic=STATES, start_s=1.5, end_s=2.5)
    assert not tampering.invalidated


def test_messages_without_a_publisher_are_not_certain(tmp_path: Path) -> None:
    """The sender is not known."""
    (tampering,) = taken(session(tmp_path).messages(STATES, [[9.0]], [1.5]))
    assert not tampering.violation.certain
    assert "no publisher" in " ".join(tampering.violation.evidence)


def test_messages_that_cannot_be_distinguished_invalidate_the_topic(tmp_path: Path) -> None:
    """Without digests of the reference node, only repeated sequence numbers show two publishers."""
    made = session(tmp_path).messages(STATES, [[9.0]], [1.5])
    made.record.published.clear()
    add(made, endpoint("/joint_state_subscriber", STUDENT, STATES, number=9))
    (tampering,) = taken(made)
    assert tampering.violation.kind is ViolationKind.PUBLISHES_ON_REFERENCE_TOPIC
    assert tampering.violation.evidence[0].startswith("1 of 6 messages")
    assert tampering.invalidated == {STATES}


def test_a_flood_that_leaves_none_of_the_reference_nodes_messages_invalidates_the_topic(
    tmp_path: Path,
) -> None:
    """A topic with messages of others and none of the arm's cannot be measured."""
    made = session(tmp_path)
    made.record.published[0].digests = digest(floats([7.0]))
    tampering, disturbed = taken(add(made, endpoint("/student", STUDENT, STATES, number=9)))
    assert disturbed.violation.kind is ViolationKind.DISTURBS_RECORDING
    assert (
        tampering.violation.evidence[0]
        == "none of 5 messages recorded there is one of the grader's"
    )
    assert tampering.invalidated == {STATES}


def test_one_publisher_that_reported_nothing_invalidates_nothing(tmp_path: Path) -> None:
    """Sequence numbers of the reference node do not repeat, even beside another publisher."""
    made = session(tmp_path)
    made.record.published.clear()
    assert taken(add(made, endpoint("/joint_state_subscriber", STUDENT, STATES, number=9))) == ()


def test_a_second_clock_invalidates_what_is_paced_by_it(tmp_path: Path) -> None:
    """Time itself cannot be told apart afterwards: every topic of the session depends on it."""
    ticks = [struct.pack("<BBHiI", 0, 1, 0, n, 0) for n in range(4)]
    definition = f"builtin_interfaces/Time clock\n{TIME}"
    made = session(tmp_path).raw(CLOCK, CLOCK_TYPE, definition, ticks[:3], [1.0, 2.0, 3.0])
    made.record.published.append(
        Published("arm", CLOCK, CLOCK_TYPE, "".join(map(digest, ticks[:3])))
    )
    made.raw(CLOCK, CLOCK_TYPE, definition, ticks[3:], [1.5])
    add(
        made,
        endpoint("/student", STUDENT, CLOCK, number=9),
        endpoint("/simulated_arm", ARM, CLOCK, number=9),
    )
    (tampering,) = taken(made)
    assert tampering.violation.kind is ViolationKind.SPOOFS_CLOCK
    assert "(/student) published time on /clock" in tampering.violation.text
    assert {STATES, COMMANDS, CLOCK} <= tampering.invalidated


# -- logs ------------------------------------------------------------------------------------------


def log(name: str, text: str) -> bytes:
    """Give the CDR of a log message."""
    data = bytearray(struct.pack("<iIB", 1, 0, 20))
    for value in (name, text, "", ""):
        data += bytes(-len(data) % 4) + struct.pack("<I", len(value) + 1) + value.encode() + b"\0"
    data += bytes(-len(data) % 4) + struct.pack("<I", 7)
    return b"\x00\x01\x00\x00" + bytes(data)


def logged(made: Session, *names: str) -> Session:
    """Record log messages of some names."""
    messages: Sequence[bytes] = [log(name, "all is well") for name in names]
    return made.raw("/rosout", "rcl_interfaces/msg/Log", LOG + TIME, messages, [2.0] * len(names))


def test_log_messages_in_a_reference_nodes_name(tmp_path: Path) -> None:
    """The grader's nodes log nothing there, so that these were sent by another."""
    names = ("student", "simulated_arm", "_grader.probe_2", "_grader.probe", "simulated_arm")
    (tampering,) = taken(logged(session(tmp_path), *names))
    assert tampering.violation.kind is ViolationKind.FORGES_ROSOUT
    assert tampering.violation.evidence == (
        "1 messages in the name of /_grader/probe",
        "2 messages in the name of /simulated_arm",
    )
    assert tampering.violation.where.topic == "/rosout"


def test_what_a_node_of_the_same_name_logs_is_its_own(tmp_path: Path) -> None:
    """The name is stated already; that it also logs under it is no more."""
    made = add(session(tmp_path), endpoint("/simulated_arm", STUDENT, "/rosout", number=9))
    assert kinds(logged(made, "simulated_arm")) == [ViolationKind.IMPERSONATES_NODE]


def test_logs_that_speak_of_a_reference_node_are_free(tmp_path: Path) -> None:
    """A node's name in the text of a message is not the name of the sender."""
    made = session(tmp_path)
    message = log("student", "waiting for simulated_arm")
    made.raw("/rosout", "rcl_interfaces/msg/Log", LOG + TIME, [message], [2.0])
    assert taken(made) == ()


EVENT = (
    f"builtin_interfaces/Time stamp\nstring node\nParameter[] new_parameters\nParameter[] changed_parameters\n"
    f"Parameter[] deleted_parameters\n{TIME}{'=' * 80}\nMSG: rcl_interfaces/Parameter\nstring name\n"
)


@pytest.mark.parametrize(
    ("changed", "found"), [(0, []), (1, [ViolationKind.FORGES_PARAMETER_EVENTS])]
)
def test_events_of_changed_parameters_of_a_reference_node(
    tmp_path: Path, changed: int, found: list[ViolationKind]
) -> None:
    """Parameters declared at the start may be reported; none of a reference node's ever changes."""
    data = bytearray(struct.pack("<iI", 1, 0))
    data += struct.pack("<I", len("/simulated_arm") + 1) + b"/simulated_arm\0"
    data += bytes(-len(data) % 4) + struct.pack("<I", 0) + struct.pack("<I", changed)
    for _ in range(changed):
        data += struct.pack("<I", 2) + b"a\0"
    data += bytes(-len(data) % 4) + struct.pack("<I", 0)
    made = session(tmp_path)
    event = b"\x00\x01\x00\x00" + bytes(data)
    assert (
        kinds(
            made.raw(
                "/parameter_events", "rcl_interfaces/msg/ParameterEvent", EVENT, [event], [2.0]
            )
        )
        == found
    )
