"""Recordings made by hand, for tests of judging: without ROS, and with known numbers.

They are written to disk and read back as real ones are.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel
from rosbags.typesys import Stores, get_typestore

from grader.checks.base import Context
from grader.checks.registry import check_given, check_named
from grader.evidence.recorded import Recorded
from grader.lab import lab_code
from grader.lab.lab_code import is_own
from grader.lab.references import definition_in
from grader.recording.session import (
    Claim,
    Endpoint,
    GraphSnapshot,
    MachineSample,
    OutputLine,
    ProcessRun,
    ServiceEndpoint,
    SessionRecord,
    StepRun,
    Usage,
    write_session,
)
from grader.recording.submission import ArtifactFact, FileFact, SubmissionRecord
from grader.result import Finding
from ros_bag.definitions import MessageDefinition
from ros_bag.qos import Qos
from ros_bag.writing import BagWriter
from tests.ros_bag.sample_messages import DEFINITIONS as DEFINITIONS
from tests.ros_bag.sample_messages import FLOATS as FLOATS
from tests.ros_bag.sample_messages import RELIABLE as RELIABLE
from tests.ros_bag.sample_messages import TEXT as TEXT
from tests.ros_bag.sample_messages import floats as floats

ROOT = Path(__file__).resolve().parents[1]
START_NS = 1_800_000_000_000_000_000
BEST_EFFORT = replace(RELIABLE, reliability="best_effort")


def at(time_s: float) -> int:
    """Give a time of the system clock, in ns, by seconds since the session's start."""
    return START_NS + round(time_s * 1e9)


def text(value: str) -> bytes:
    """Give the CDR of a String."""
    data = value.encode() + b"\0"
    return struct.pack("<BBHI", 0, 1, 0, len(data)) + data


_ZERO = {"string": "", "wstring": "", "bool": False, "float32": 0.0, "float64": 0.0}


def _message(store: Any, described: Any, value: Any = None) -> Any:
    """Make a message, or a part of one, of its type as `rosbags` describes it."""
    kind, what = described
    if kind == 1:
        if value is None:
            return _ZERO.get(what[0] if isinstance(what, tuple) else what, 0)
        return value
    if kind == 2:
        fields, given = store.fielddefs[what][1], value or {}
        return store.types[what](
            **{name: _message(store, part, given.get(name)) for name, part in fields}
        )
    element, length = what
    listed = []
    for each in value if value is not None else [None] * length * (kind == 3):
        listed.append(_message(store, element, each))
    primitive = element[1][0] if element[0] == 1 else "string"
    if primitive in ("string", "wstring"):
        return listed
    return np.array(listed, dtype=primitive)


class Session:
    """One session in the making.

    Parameters
    ----------
    folder : Path
        Where it is written.
    """

    def __init__(self, folder: Path, name: str = "experiment") -> None:
        self.folder = folder / name
        self.record = SessionRecord(name, started_ns=START_NS, ended_ns=at(30.0), complete=True)
        self.record.graph.append(GraphSnapshot(at(1.0)))
        self._writer = BagWriter(self.folder, name)
        self._gids = 0

    @property
    def graph(self) -> GraphSnapshot:
        """The only snapshot."""
        return self.record.graph[0]

    def messages(
        self,
        topic: str,
        rows: Sequence[Sequence[float]],
        times_s: Iterable[float],
        *,
        sequence: Iterable[int] | None = None,
        latency_s: float = 0.0002,
        type_hash: str = "",
    ) -> Session:
        """Record messages of numbers, published at the times given."""
        channel = self._writer.add_channel(
            topic, FLOATS, type_hash, DEFINITIONS[FLOATS], [RELIABLE]
        )
        if sequence is not None:
            numbers = sequence
        else:
            numbers = range(1, len(rows) + 1)
        for row, time_s, number in zip(rows, times_s, numbers, strict=True):
            self._writer.write(
                channel,
                floats(row),
                received_ns=at(time_s + latency_s),
                source_ns=at(time_s),
                sequence=number,
            )
        return self

    def texts(self, topic: str, texts: Sequence[str], times_s: Iterable[float]) -> Session:
        """Record messages of text."""
        channel = self._writer.add_channel(topic, TEXT, "", DEFINITIONS[TEXT], [RELIABLE])
        for number, (value, time_s) in enumerate(zip(texts, times_s, strict=True), 1):
            self._writer.write(
                channel, text(value), received_ns=at(time_s), source_ns=at(time_s), sequence=number
            )
        return self

    def raw(
        self,
        topic: str,
        kind: str,
        definition: str,
        messages: Sequence[bytes],
        times_s: Iterable[float],
    ) -> Session:
        """Record messages of another type by their CDR."""
        channel = self._writer.add_channel(
            topic, kind, "", MessageDefinition("ros2msg", definition), [RELIABLE]
        )
        for number, (data, time_s) in enumerate(zip(messages, times_s, strict=True), 1):
            self._writer.write(
                channel, data, received_ns=at(time_s), source_ns=at(time_s), sequence=number
            )
        return self

    def typed(
        self,
        topic: str,
        kind: str,
        messages: Sequence[Mapping[str, Any]],
        times_s: Iterable[float],
        lag_s: float = 0.0,
    ) -> Session:
        """Record messages of any ROS type by their fields, received a time after their publication.

        Fields left out are 0, empty or false; numbers of an array are a list.
        """
        store = get_typestore(Stores.ROS2_JAZZY)
        definition = MessageDefinition("ros2msg", store.generate_msgdef(kind, ros_version=2)[0])
        channel = self._writer.add_channel(topic, kind, "", definition, [RELIABLE])
        for number, (fields, time_s) in enumerate(zip(messages, times_s, strict=True), 1):
            data = bytes(store.serialize_cdr(_message(store, (2, kind), fields), kind))
            received_ns = at(time_s + lag_s)
            self._writer.write(
                channel, data, received_ns=received_ns, source_ns=at(time_s), sequence=number
            )
        return self

    def endpoint(
        self,
        kind: str,
        topic: str,
        node: str = "/student",
        topic_type: str = FLOATS,
        qos: Qos = RELIABLE,
    ) -> Session:
        """Put a publisher or a subscription into the graph, and its node."""
        self._gids += 1
        self.graph.endpoints.append(
            Endpoint(kind, topic, topic_type, "", node, f"{self._gids:032x}", qos)
        )
        return self.node(node)

    def node(self, name: str) -> Session:
        """Put a node into the graph."""
        if name not in self.graph.nodes:
            self.graph.nodes.append(name)
        return self

    def service(
        self, name: str, node: str = "/student", kind: str = "std_srvs/srv/SetBool"
    ) -> Session:
        """Put a service into the graph."""
        self.graph.services.append(ServiceEndpoint(name, kind, node))
        return self.node(node)

    def process(
        self, name: str = "it", lines: Iterable[str | tuple[float, str]] = (), **facts: Any
    ) -> Session:
        """Add a student's process that wrote lines; each may have its time in s."""
        timed = [line if isinstance(line, tuple) else (2.0, line) for line in lines]
        output = [OutputLine(at(time_s), "stdout", said) for time_s, said in timed]
        run = ProcessRun(
            name, "student", ["python", name], artifact=name, started_ns=at(0.1), output=output
        )
        run.interrupted_ns, run.exited_ns, run.exit_status, run.ended_by = (
            at(20.0),
            at(20.1),
            0,
            "interrupt",
        )
        for key, value in facts.items():
            setattr(run, key, value)
        self.record.processes.append(run)
        return self

    def delayed(self, name: str, delay_s: float, until_s: float, cpu_s: float = 0.0) -> Session:
        """Let the machine have delayed a process for a time, evenly from 0 to `until_s`."""
        run = next(p for p in self.record.processes if p.name == name)
        shares = [n / (2 * until_s) for n in range(round(2 * until_s) + 1)]
        run.usage = [
            Usage(at(s * until_s), round(s * cpu_s * 1e9), round(s * delay_s * 1e9)) for s in shares
        ]
        return self

    def disturbed(self, name: str, *delays_s: tuple[float, float]) -> Session:
        """Let a process have been watched, and the machine have delayed it at some times for so long."""
        run = next(p for p in self.record.processes if p.name == name)
        run.disturbed = [
            [at(start_s), round(delay_s * 1e9), round(delay_s * 1e9)]
            for start_s, delay_s in delays_s
        ]
        return self

    def clock(self, ahead_s: Mapping[float, float]) -> Session:
        """Let the system's clock be ahead of the monotonic one by some seconds, as sampled at some times."""
        self.record.machine = [
            MachineSample(at(t), round(ahead * 1e9)) for t, ahead in ahead_s.items()
        ]
        return self

    def step(self, kind: str, label: str, outcome: str = "done", **result: Any) -> Session:
        """Add a step by its result; `parameters` are taken out of it."""
        parameters = result.pop("parameters", {})
        self.record.steps.append(
            StepRun(kind, parameters, label, at(1.0), at(2.0), outcome, result)
        )
        return self

    def window(self, start_s: float, end_s: float, label: str = "window") -> Session:
        """Add the step that observed a span of time."""
        return self.step("observe", label, opened_ns=at(start_s), closed_ns=at(end_s))

    def claim(self, kind: str, name: str, line: int = 7, qos: Qos | None = None) -> Session:
        """Add the tap's note about a call."""
        self.record.claims.append(Claim("it", kind, name, file="it.py", line=line, qos=qos))
        return self

    def called(self, name: str) -> Session:
        """Note the name that the student used: `wanted=used`."""
        wanted, _, used = name.partition("=")
        self.record.names[wanted] = used
        return self

    def recorded(self) -> Recorded:
        """Write all to disk and open it."""
        self._writer.close()
        write_session(self.folder, self.record)
        return Recorded.open(self.folder)


def submission(files: Mapping[str, str] | None = None, **artifacts: str | None) -> SubmissionRecord:
    """Give the record of a submission: texts by path, and artifacts by name with their path."""
    record = SubmissionRecord("ann")
    for path, content in (files or {"it.py": ""}).items():
        record.files.append(FileFact(path, len(content), ""))
        record.texts[path] = content
    for name, place in (artifacts or {"it": "it.py"}).items():
        record.artifacts.append(
            ArtifactFact(name, f"{name}.py", place, "name" if place else "missing")
        )
    return record


def judged(
    check: str,
    parameters: Mapping[str, Any],
    session: Session | Recorded | None,
    record: SubmissionRecord | None = None,
    *,
    findings: Mapping[str, Finding] | None = None,
    others: Mapping[str, Recorded] | None = None,
    reference_nodes: Iterable[str] = (),
) -> Finding:
    """Let a check judge a session: one of the registry, or one of Lab 09-01's own, "file.py:function"."""
    recorded: Recorded | None
    if isinstance(session, Session):
        recorded = session.recorded()
    else:
        recorded = session
    if recorded is not None:
        sessions = {recorded.record.session: recorded}
    else:
        sessions = {}
    context = Context(
        submission=record if record is not None else submission(),
        recorded=recorded,
        sessions={**sessions, **(others or {})},
        findings=findings or {},
        reference_nodes=frozenset(reference_nodes),
        lab_folder=ROOT,
    )
    p = given(check, parameters)
    return check_given(check, p).judge(context, p)


def given(check: str, parameters: Mapping[str, Any]) -> BaseModel:
    """Return the parameters of a check, validated as for a rubric."""
    if not is_own(check):
        return check_named(check).parameters.model_validate(dict(parameters))
    return lab_code.given(definition_in(ROOT, check), dict(parameters))


def evenly(rate_hz: float, duration_s: float, start_s: float = 1.0) -> list[float]:
    """Give the times of messages at a rate."""
    return [start_s + n / rate_hz for n in range(round(rate_hz * duration_s) + 1)]
