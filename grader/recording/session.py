"""`session.json`: all of a session that is not ROS traffic.

Times are integer nanoseconds of the system clock (CLOCK_REALTIME), the clock of DDS timestamps. Standard library only,
since the trusted processes in a sandbox import it too.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
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
#: What an action's topics and services have in their names, and how that ends which takes its goals.
OF_ACTION, _GOAL_SERVICE = "/_action/", "/_action/send_goal"
#: Topics that every node has, or that belong to the clock: a student's node means none of them by a name of its own.
STANDARD_TOPICS = ("/rosout", "/parameter_events", "/clock")
#: Keys of a step, one of which names what in the graph is waited for.
AWAITED = ("node", "publisher", "subscription", "service", "action", "action_client")
#: Namespace of the grader's own nodes; their topics and endpoints are no part of a snapshot.
GRADER_NAMESPACE = "/_grader"
#: Name of the process of a step `link` (`grader.lab.steps.link`).
LINK = "link"


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
    """The machine at one time."""

    t_ns: int
    #: The system clock's reading less the monotonic clock's: it changes when the clock is set.
    clock_offset_ns: int
    #: Time that the host of a virtual machine took from its cores since boot, all cores together.
    stolen_ns: int = 0
    #: Time since boot in which some process waited for a core (pressure stall information), where it is
    #: readable.
    waiting_us: int | None = None
    #: Number of each core -> time since boot in which nothing ran on it.
    idle_ns: dict[str, int] = field(default_factory=dict)
    #: CPU time that the student's processes of the session took so far, those included that nobody saw or
    #: waited for.
    students_ns: int | None = None


@dataclass(eq=False)
class ProcessRun:
    """One process, from start to exit; two with equal contents are two."""

    #: Unique in the session: the artifact's name, or that of the launched node's process.
    name: str
    #: "student", "reference" or "grader".
    role: str
    argv: list[str]
    #: The rubric's name of the file that runs, where there is one.
    artifact: str | None = None
    started_ns: int = 0
    exited_ns: int | None = None
    interrupted_ns: int | None = None
    #: Exit status; negative for the signal that ended it; None when it had to be given up.
    exit_status: int | None = None
    #: "itself", "interrupt" (SIGINT was sent first), "terminate" or "kill" (it did not stop), or "limit".
    ended_by: str = "itself"
    output: list[OutputLine] = field(default_factory=list)
    output_dropped_bytes: int = 0
    #: Samples over time: CPU time used, and time ready to run but without a core, of all threads together.
    usage: list[Usage] = field(default_factory=list)
    #: The limit that it hit, whether it was ended for that or not: "memory", "processes", "disk", "files"
    #: (their number) or "output". Only the grader's own have "computing": the loss of real-time scheduling.
    limit: str | None = None
    #: The core to which it is held, and since when.
    core: int | None = None
    held_ns: int | None = None
    #: When the machine delayed it: [begin of a time, its length, for how long within it], in ns. None
    #: where it was not watched.
    disturbed: list[list[int]] | None = None


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
class ServiceEndpoint:
    """A server of a service in the graph, or a client of one, attributed to its node."""

    name: str
    type: str
    node: str  # fully qualified


@dataclass
class GraphSnapshot:
    """The ROS graph at one time, without the grader's own probe and recorder."""

    t_ns: int
    nodes: list[str] = field(default_factory=list)  # fully qualified, with duplicates
    endpoints: list[Endpoint] = field(default_factory=list)
    services: list[ServiceEndpoint] = field(default_factory=list)
    clients: list[ServiceEndpoint] = field(default_factory=list)

    @property
    def actions(self) -> list[ServiceEndpoint]:
        """Servers of actions, each known by its service that takes goals."""
        return _actions_of(self.services)

    @property
    def action_clients(self) -> list[ServiceEndpoint]:
        """Clients of actions, each known by its client of that service."""
        return _actions_of(self.clients)


def _actions_of(endpoints: list[ServiceEndpoint]) -> list[ServiceEndpoint]:
    actions = []
    for endpoint in endpoints:
        if endpoint.name.endswith(_GOAL_SERVICE):
            name = endpoint.name.removesuffix(_GOAL_SERVICE)
            kind = endpoint.type.removesuffix("_SendGoal")
            actions.append(ServiceEndpoint(name, kind, endpoint.node))
    return actions


@dataclass
class StepRun:
    """One step of the session as it went."""

    #: The step's key in the rubric, e.g. "wait_for".
    kind: str
    #: The step's value in the rubric.
    parameters: dict[str, Any]
    #: The step's own label in the rubric, by which checks refer to it.
    label: str | None = None
    started_ns: int = 0
    ended_ns: int = 0
    #: "done", "timeout" (the student's side did not come in time), "cancelled" (the student's processes had
    #: ended before it could be done) or "failed".
    outcome: str = "done"
    #: What the step found; depends on its kind.
    result: dict[str, Any] = field(default_factory=dict)


@dataclass
class Claim:
    """What the tap noted in a student's process: a claim by student code, never evidence of behaviour."""

    process: str
    #: "publisher", "subscription", "service", "client", "action", "action_client", "timer", "parameter", "node".
    kind: str
    #: As given in the call (not expanded); period in seconds for a timer.
    name: str
    node: str = ""
    type: str = ""
    #: Path relative to the submission's root, or absolute where outside it.
    file: str = ""
    line: int = 0
    qos: Qos | None = None
    value: Any = None


def asked_for(endpoint: Endpoint, claims: Iterable[Claim]) -> Claim | None:
    """Return the claim of an endpoint, in any namespace; of several claims one of the endpoint's own node."""
    first = None
    for claim in claims:
        is_other = claim.kind != endpoint.kind or _plain(claim.name) != _plain(endpoint.topic)
        if is_other:
            continue
        if _plain(claim.node) == _plain(endpoint.node):
            return claim
        if first is None:
            first = claim
    return first


def _plain(name: str) -> str:
    return name.rsplit("/", 1)[-1]


def completed(seen: Qos, claim: Claim | None) -> Qos:
    """Return a profile from discovery with history and depth, which are not announced there, as they were asked for."""
    if claim is None or claim.qos is None:
        return seen
    if seen.history == "unknown":
        seen = replace(seen, history=claim.qos.history)
    if not seen.depth:
        seen = replace(seen, depth=claim.qos.depth)
    return seen


@dataclass
class Trusted:
    """A process of the grader's with endpoints in the graph, by what it told through its pipe."""

    #: Its name in the session.
    process: str
    #: First digits of the gids of all its endpoints: those of its participant, or of its process.
    gid_prefix: str


@dataclass
class Published:
    """What a process of the grader's published on a topic, as it told through its pipe."""

    #: Its name in the session.
    process: str
    topic: str
    type: str
    #: `digest` of each message's CDR, one behind the other: that of the message with the publication sequence
    #: number n stands at place n, counted from 1.
    digests: str
    #: Whether it published nothing before the recorder's subscription was there, so that the whole has to be recorded.
    recorded: bool = False


@dataclass
class RecordingGap:
    """Messages that the recorder left out: a topic of one type, or what came of it from some time on."""

    topic: str
    type: str
    #: When it was left off.
    t_ns: int
    #: How many were recorded until then, and what they filled.
    messages: int
    size_bytes: int
    #: Why, as a clause.
    reason: str
    #: Whether it was for a limit of the recording, in bytes or in topics; else it cannot be recorded at all.
    limit: bool


@dataclass
class SessionRecord:
    """All of one session but its bag."""

    session: str
    schema: str = SESSION_SCHEMA
    seed: int = 0
    #: 1 for the first recording, more where an earlier one left something undecided.
    attempt: int = 1
    #: Whether in an earlier recording of this session something was seen that disturbs the grader's own
    #: processes.
    disturbed_before: bool = False
    #: How often the session was recorded in all, where this recording was kept of several; see
    #: `times_recorded`.
    attempts: int = 0
    started_ns: int = 0
    ended_ns: int = 0
    #: False while it runs, and if the grader was stopped in the midst of it.
    complete: bool = False
    isolation: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    #: The grader's own troubles (a reference node that died, a bag that had to be recovered). They make
    #: findings inconclusive, never failed.
    problems: list[str] = field(default_factory=list)
    processes: list[ProcessRun] = field(default_factory=list)
    machine: list[MachineSample] = field(default_factory=list)
    steps: list[StepRun] = field(default_factory=list)
    graph: list[GraphSnapshot] = field(default_factory=list)
    #: Name in the rubric -> name that the student used, where a near miss was found and used.
    names: dict[str, str] = field(default_factory=dict)
    claims: list[Claim] = field(default_factory=list)
    #: The plan of a launch file, see `launch_plan.plan`.
    plan: dict[str, Any] | None = None
    #: The grader's own processes in the graph. All other endpoints there are the student's.
    trusted: list[Trusted] = field(default_factory=list)
    #: All that the grader's own processes published.
    published: list[Published] = field(default_factory=list)
    #: What the recorder left out. Whose doing that is, `grader.evidence.gaps` tells.
    unrecorded: list[RecordingGap] = field(default_factory=list)

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
