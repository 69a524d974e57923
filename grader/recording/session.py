"""`session.json`: all of a session that is not ROS traffic.

Times are integer nanoseconds of the system clock (CLOCK_REALTIME), the clock of DDS timestamps. Standard library only,
because the trusted processes in a sandbox import it too.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from grader.recording.record import read_record, write_record
from ros_bag.qos import Qos

SESSION_SCHEMA = "ros-lab-grader/session/v1"
SESSION_FILE = "session.json"

#: Name of the node that discovery gives an endpoint before the node is known.
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
#: First hexadecimal digits of a gid that identify the participant: endpoints that share them live in one process.
PARTICIPANT_DIGITS = 24
#: First hexadecimal digits of a gid that identify the process: all its participants share them.
PROCESS_DIGITS = 16
#: Part of the names of an action's topics and services.
OF_ACTION = "/_action/"
#: End of the name of the service that takes an action's goals.
_GOAL_SERVICE = "/_action/send_goal"
#: Topics of every node, or of the clock; a misspelled name of a student's never means one of them.
STANDARD_TOPICS = ("/rosout", "/parameter_events", "/clock")
#: Keys of a step; one of them names the awaited part of the graph.
AWAITED = ("node", "publisher", "subscription", "service", "action", "action_client")
#: Namespace of the grader's own nodes; their topics and endpoints are not part of a snapshot.
GRADER_NAMESPACE = "/_grader"
#: Name of the process of a step `link` (`grader.lab.steps.link`).
LINK = "link"


@dataclass
class OutputLine:
    """A line of a process's output; `t_ns` is the time at which the grader read it."""

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
    #: The system clock's time minus the monotonic clock's; it changes when the clock is set.
    clock_offset_ns: int
    #: Time that the host of a virtual machine took from its cores since boot, all cores together.
    stolen_ns: int = 0
    #: Time since boot in which a process waited for a core (pressure stall information), if it is readable.
    waiting_us: int | None = None
    #: Number of each core -> idle time since boot.
    idle_ns: dict[str, int] = field(default_factory=dict)
    #: CPU time of the student's processes in the session so far, with those that no process saw or waited for.
    students_ns: int | None = None


@dataclass(eq=False)
class ProcessRun:
    """One process, from start to exit; two processes with equal contents are not equal."""

    #: Name, unique in the session: the artifact's, or the one of the launched node's process.
    name: str
    #: "student", "reference" or "grader".
    role: str
    argv: list[str]
    #: The rubric's name of the file that runs, if it has one.
    artifact: str | None = None
    started_ns: int = 0
    exited_ns: int | None = None
    interrupted_ns: int | None = None
    #: Exit status; negative for the signal that ended it; None if the wait for it was given up.
    exit_status: int | None = None
    #: "itself", "interrupt" (SIGINT was sent first), "terminate" or "kill" (it did not stop), or "limit".
    ended_by: str = "itself"
    output: list[OutputLine] = field(default_factory=list)
    output_dropped_bytes: int = 0
    #: Samples over time: CPU time used, and time ready to run but without a core, of all threads together.
    usage: list[Usage] = field(default_factory=list)
    #: The limit that it hit, with or without being ended for it: "memory", "processes", "disk", "files"
    #: (their number) or "output". Only the grader's own have "computing": the loss of real-time scheduling.
    limit: str | None = None
    #: The core to which it is held.
    core: int | None = None
    #: Time since which it is held to the core.
    held_ns: int | None = None
    #: Delays by the machine: [begin of a span, its length, delay within it, standstill of the core in the delay], in ns;
    #: earlier versions left the last out. None if it was not watched.
    disturbed: list[list[int]] | None = None
    #: Frames of a compiled program that crashed, the innermost first: written by its process, never evidence for points.
    crash: list[StackFrame] = field(default_factory=list)

    @property
    def ended_unasked(self) -> bool:
        """True if it ended before the grader interrupted it, or killed it at the end of the session."""
        if self.ended_by == "kill":
            return False
        return self.exited_ns is not None and self.interrupted_ns is None


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
        """Servers of actions, each identified by its service that takes goals."""
        return _actions_of(self.services)

    @property
    def action_clients(self) -> list[ServiceEndpoint]:
        """Clients of actions, each identified by its client of that service."""
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
    """One step of the session, as it was carried out."""

    #: The step's key in the rubric, e.g. "wait_for".
    kind: str
    #: The step's value in the rubric.
    parameters: dict[str, Any]
    #: The step's own label in the rubric; checks refer to the step by it.
    label: str | None = None
    started_ns: int = 0
    ended_ns: int = 0
    #: "done", "timeout" (the student's side did not come in time), "cancelled" (the student's processes had
    #: ended before it could be done) or "failed".
    outcome: str = "done"
    #: The step's findings, which depend on its kind.
    result: dict[str, Any] = field(default_factory=dict)


#: Kind of a claim about a use of ROS 2 that only a newer one knows, and that was made to work.
NEWER_IDIOM = "newer_idiom"
#: Kind of a claim about another value of a session's variable, such as ROS_DOMAIN_ID.
SESSION_VARIABLE = "session_variable"
#: Name among the versions of a session: the installation of ROS of students' programs, if it is not the grader's.
STUDENTS_ROS = "students' ROS"


@dataclass
class Claim:
    """A note of the tap in a student's process: a claim by student code, never evidence of behaviour."""

    process: str
    #: "publisher", "subscription", "service", "client", "action", "action_client", "timer", "parameter", "node",
    #: NEWER_IDIOM, or SESSION_VARIABLE.
    kind: str
    #: As given in the call (not expanded); period in seconds for a timer.
    name: str
    node: str = ""
    type: str = ""
    #: Path relative to the submission's root, or absolute if it is outside.
    file: str = ""
    line: int = 0
    qos: Qos | None = None
    value: Any = None


@dataclass
class StackFrame:
    """A line of code that a thread was executing."""

    #: Path relative to the submission's root, or absolute if it is outside.
    file: str
    line: int
    function: str


@dataclass
class Stack:
    """Stacks of a program when the grader asked for them: written by the student's process, never evidence for points."""

    process: str
    #: Time of the question; stacks with the same one show the program twice, a moment apart.
    asked_ns: int
    #: Frames of each thread, the innermost first.
    threads: list[list[StackFrame]] = field(default_factory=list)
    #: False if only main threads were asked for.
    is_whole: bool = True


def asked_for(endpoint: Endpoint, claims: Iterable[Claim]) -> Claim | None:
    """Return the claim of an endpoint, in any namespace; of several claims one of the endpoint's own node."""
    first = None
    for claim in claims:
        if claim.kind != endpoint.kind:
            continue
        if _plain(claim.name) != _plain(endpoint.topic):
            continue
        if _plain(claim.node) == _plain(endpoint.node):
            return claim
        if first is None:
            first = claim
    return first


def _plain(name: str) -> str:
    return name.rsplit("/", 1)[-1]


def completed(seen: Qos, claim: Claim | None) -> Qos:
    """Return a profile from discovery with the requested history and depth, which discovery does not announce."""
    if claim is None or claim.qos is None:
        return seen
    if seen.history == "unknown":
        seen = replace(seen, history=claim.qos.history)
    if not seen.depth:
        seen = replace(seen, depth=claim.qos.depth)
    return seen


@dataclass
class Trusted:
    """A process of the grader with endpoints in the graph, as it reported through its pipe."""

    #: Its name in the session.
    process: str
    #: First digits of the gids of all its endpoints: those of its participant, or of its process.
    gid_prefix: str


@dataclass
class Published:
    """The messages of a grader process on a topic, as it reported through its pipe."""

    #: Its name in the session.
    process: str
    topic: str
    type: str
    #: `digest` of each message's CDR, one after another: the n-th digest, counted from 1, belongs to the message
    #: with the publication sequence number n.
    digests: str
    #: True if it published nothing before the recorder subscribed; then every message must have been recorded.
    recorded: bool = False


@dataclass
class RecordingGap:
    """Messages that the recorder left out: a topic of one type, or all its messages from some time on."""

    topic: str
    type: str
    #: Time from which messages were left out.
    t_ns: int
    #: Number of messages recorded until then.
    messages: int
    #: Bytes of messages recorded until then.
    size_bytes: int
    #: The reason, as a clause.
    reason: str
    #: True for a limit of the recording, in bytes or in topics; else the topic cannot be recorded at all.
    limit: bool


@dataclass
class SessionRecord:
    """All of one session but its bag."""

    session: str
    schema: str = SESSION_SCHEMA
    seed: int = 0
    #: 1 for the first recording, more if an earlier one left something undecided.
    attempt: int = 1
    #: True if an earlier recording of this session shows a disturbance of the grader's own processes.
    disturbed_before: bool = False
    #: Number of recordings of the session, if this one was kept of several; see `times_recorded`.
    attempts: int = 0
    started_ns: int = 0
    ended_ns: int = 0
    #: False during the session, and if the grader was stopped before its end.
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
    #: Name in the rubric -> the student's name, if a near miss was found and used.
    names: dict[str, str] = field(default_factory=dict)
    claims: list[Claim] = field(default_factory=list)
    #: Stacks of programs that did not answer, or that were about to be ended.
    stacks: list[Stack] = field(default_factory=list)
    #: The plan of a launch file, see `launch_plan.plan`.
    plan: dict[str, Any] | None = None
    #: The grader's own processes in the graph. All other endpoints there are the student's.
    trusted: list[Trusted] = field(default_factory=list)
    #: All that the grader's own processes published.
    published: list[Published] = field(default_factory=list)
    #: Messages that the recorder left out; `grader.evidence.gaps` attributes them.
    unrecorded: list[RecordingGap] = field(default_factory=list)

    @property
    def times_recorded(self) -> int:
        """Known number of recordings of the session."""
        return max(self.attempt, self.attempts)


def write_session(folder: Path, record: SessionRecord) -> None:
    """Write `session.json`."""
    write_record(folder / SESSION_FILE, record)


def read_session(folder: Path) -> SessionRecord:
    """Read `session.json`; raises as `read_record` does."""
    return read_record(folder / SESSION_FILE, SessionRecord, SESSION_SCHEMA)
