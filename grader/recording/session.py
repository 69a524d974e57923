"""`session.json`: all of a session that is not ROS traffic.

Times are integer nanoseconds of the system clock (CLOCK_REALTIME), the clock of DDS timestamps.
The models are read by the judging half and written by the live half; neither ROS nor processes
are needed here. Standard library only, since the trusted processes in a cell import it too.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from grader.recording.record import read_record, write_record

SESSION_SCHEMA = "ros-lab-grader/session/v1"
SESSION_FILE = "session.json"

#: What discovery says of an endpoint whose node is not known yet.
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
#: Hexadecimal digits of a gid that tell the participant: endpoints that share them live in one process.
PARTICIPANT_DIGITS = 24
#: Those that tell the process: all its participants share them.
PROCESS_DIGITS = 16
#: Namespace of the grader's own nodes; their topics and endpoints are no part of a snapshot.
GRADER_NAMESPACE = "/_grader"


@dataclass
class OutputLine:
    """A line that a process wrote. `t_ns` is when the grader read it."""

    t_ns: int
    stream: str  # "stdout" or "stderr"
    text: str


@dataclass
class Usage:
    """CPU time and run-queue delay of a process since its start, in ns, as read at one time."""

    t_ns: int
    cpu_ns: int
    run_delay_ns: int


@dataclass
class MachineSample:
    """The machine at one time.

    Attributes
    ----------
    clock_offset_ns : int
        The system clock's reading less the monotonic clock's: it changes when the clock is set.
    stolen_ns : int
        Time that the host of a virtual machine took from its cores since boot, all cores together.
    waiting_us : int or None
        Time since boot in which some process waited for a core (pressure stall information), where it is readable.
    idle_ns : dict
        Number of each core -> time since boot in which nothing ran on it.
    students_ns : int or None
        CPU time that the student's processes of the session took so far, those included that nobody saw or waited for.
    """

    t_ns: int
    clock_offset_ns: int
    stolen_ns: int = 0
    waiting_us: int | None = None
    idle_ns: dict[str, int] = field(default_factory=dict)
    students_ns: int | None = None


@dataclass
class ProcessRun:
    """One process, from start to exit.

    Attributes
    ----------
    name : str
        Unique in the session: the artifact's name, or that of the launched node's process.
    role : str
        "student", "reference" or "grader".
    artifact : str or None
        The rubric's name of the file that runs, where there is one.
    exit_status : int or None
        Exit status; negative for the signal that ended it; None when it had to be given up.
    ended_by : str
        "itself", "interrupt" (SIGINT was sent first), "terminate" or "kill" (it did not stop), or "limit".
    limit : str or None
        The limit that it hit, whether it was ended for that or not: "memory", "processes", "disk", "files"
        (their number) or "output".
    usage : list of Usage
        Samples over time: CPU time used, and time ready to run but without a core, of all threads together.
    core, held_ns : int or None
        The core to which it is held, and since when.
    """

    name: str
    role: str
    argv: list[str]
    artifact: str | None = None
    started_ns: int = 0
    exited_ns: int | None = None
    interrupted_ns: int | None = None
    exit_status: int | None = None
    ended_by: str = "itself"
    output: list[OutputLine] = field(default_factory=list)
    output_dropped_bytes: int = 0
    usage: list[Usage] = field(default_factory=list)
    limit: str | None = None
    core: int | None = None
    held_ns: int | None = None


@dataclass
class Qos:
    """A QoS profile as rclpy spells its policies, in lower case ("reliable", "keep_last", ...).

    `history` is "unknown" and `depth` 0 where they come from discovery. Durations in ns, None for infinite.
    """

    reliability: str = "unknown"
    durability: str = "unknown"
    history: str = "unknown"
    depth: int = 0
    deadline_ns: int | None = None
    lifespan_ns: int | None = None
    liveliness: str = "unknown"
    liveliness_lease_ns: int | None = None


@dataclass
class Endpoint:
    """A publisher or a subscription in the graph."""

    kind: str  # "publisher" or "subscription"
    topic: str
    type: str
    type_hash: str
    node: str  # fully qualified
    gid: str
    qos: Qos = field(default_factory=Qos)


@dataclass
class ServiceOffer:
    """A service server in the graph, attributed to its node."""

    name: str
    type: str
    node: str  # fully qualified


@dataclass
class ServiceClient:
    """A client of a service in the graph, attributed to its node."""

    name: str
    type: str
    node: str  # fully qualified


@dataclass
class GraphSnapshot:
    """The ROS graph at one time, without the grader's own probe and recorder."""

    t_ns: int
    nodes: list[str] = field(default_factory=list)  # fully qualified, with duplicates
    endpoints: list[Endpoint] = field(default_factory=list)
    services: list[ServiceOffer] = field(default_factory=list)
    clients: list[ServiceClient] = field(default_factory=list)


@dataclass
class StepRun:
    """One step of the session as it went.

    Attributes
    ----------
    kind : str
        The step's key in the rubric, e.g. "wait_for".
    label : str or None
        The step's own label in the rubric, by which checks refer to it.
    parameters : dict
        The step's value in the rubric.
    outcome : str
        "done", "timeout" (the student's side did not come in time), "cancelled" (the student's processes
        had ended before it could be done) or "failed".
    result : dict
        What the step found; depends on its kind.
    """

    kind: str
    parameters: dict[str, Any]
    label: str | None = None
    started_ns: int = 0
    ended_ns: int = 0
    outcome: str = "done"
    result: dict[str, Any] = field(default_factory=dict)


@dataclass
class Claim:
    """What the tap noted in a student's process: a claim by student code, never evidence of behaviour.

    Attributes
    ----------
    kind : str
        "publisher", "subscription", "service", "client", "timer", "parameter", "node".
    name : str
        As given in the call (not expanded); period in seconds for a timer.
    file : str
        Path relative to the submission's root, or absolute where outside it.
    """

    process: str
    kind: str
    name: str
    node: str = ""
    type: str = ""
    file: str = ""
    line: int = 0
    qos: Qos | None = None
    value: Any = None


@dataclass
class Trusted:
    """A process of the grader's with endpoints in the graph, by what it told through its pipe.

    Attributes
    ----------
    process : str
        Its name in the session.
    gid_prefix : str
        First digits of the gids of all its endpoints: those of its participant, or of its process.
    """

    process: str
    gid_prefix: str


@dataclass
class Published:
    """What a process of the grader's published on a topic, as it told through its pipe.

    Attributes
    ----------
    process : str
        Its name in the session.
    digests : str
        `digest` of each message's CDR, one behind the other: that of the message with the publication sequence
        number n stands at place n, counted from 1.
    """

    process: str
    topic: str
    type: str
    digests: str


@dataclass
class Unrecorded:
    """Messages that the recorder left out: a topic of one type, or what came of it from some time on.

    Attributes
    ----------
    t_ns : int
        When it was left off.
    messages, size_bytes : int
        How many were recorded until then, and what they filled.
    reason : str
        Why, as a clause.
    limit : bool
        Whether it was for a limit of the recording, in bytes or in topics; else it cannot be recorded at all.
    """

    topic: str
    type: str
    t_ns: int
    messages: int
    size_bytes: int
    reason: str
    limit: bool


@dataclass
class SessionRecord:
    """All of one session but its bag.

    Attributes
    ----------
    complete : bool
        False while it runs, and if the grader was stopped in the midst of it.
    attempt : int
        1 for the first recording, more where an earlier one left something undecided.
    disturbed_before : bool
        Whether in an earlier recording of this session something was seen that disturbs the grader's own processes.
    attempts : int
        How often the session was recorded in all, where this recording was kept of several; see `times_recorded`.
    problems : list of str
        The grader's own troubles (a reference node that died, a bag that had to be recovered).
        They make findings inconclusive, never failed.
    names : dict
        Name in the rubric -> name that the student used, where a near miss was found and used.
    plan : dict or None
        The plan of a launch file, see `grader.live.launching`.
    trusted : list of Trusted
        The grader's own processes in the graph. All other endpoints there are the student's.
    published : list of Published
        All that the grader's own processes published.
    unrecorded : list of Unrecorded
        What the recorder left out. Whose doing that is, `grader.evidence.unrecorded` tells.
    """

    session: str
    schema: str = SESSION_SCHEMA
    seed: int = 0
    attempt: int = 1
    disturbed_before: bool = False
    attempts: int = 0
    started_ns: int = 0
    ended_ns: int = 0
    complete: bool = False
    isolation: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    processes: list[ProcessRun] = field(default_factory=list)
    machine: list[MachineSample] = field(default_factory=list)
    steps: list[StepRun] = field(default_factory=list)
    graph: list[GraphSnapshot] = field(default_factory=list)
    names: dict[str, str] = field(default_factory=dict)
    claims: list[Claim] = field(default_factory=list)
    plan: dict[str, Any] | None = None
    trusted: list[Trusted] = field(default_factory=list)
    published: list[Published] = field(default_factory=list)
    unrecorded: list[Unrecorded] = field(default_factory=list)

    @property
    def times_recorded(self) -> int:
        """How often the session was recorded, as far as is known."""
        return max(self.attempt, self.attempts)


def write_session(folder: Path, record: SessionRecord) -> None:
    """Write `session.json`."""
    write_record(folder / SESSION_FILE, record)


def read_session(folder: Path) -> SessionRecord:
    """Read `session.json`; `read_record` says what it raises."""
    return read_record(folder / SESSION_FILE, SessionRecord, SESSION_SCHEMA)
