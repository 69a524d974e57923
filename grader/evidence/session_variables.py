"""Variables for the domain, the middleware and the discovery of a program: each session has its own values.

The programs of a session run with the session's values, also if a launch file or their code asks for others.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator, Set
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from grader.evidence.text.syntax import code_of, normalise, tree_of
from grader.recording.session import SESSION_VARIABLE, ProcessRun
from launch_plan.plan import MalformedPlanError, Plan, Process

if TYPE_CHECKING:
    from grader.evidence.recorded import Recorded
    from grader.recording.submission import SubmissionRecord

DOMAIN = "ROS_DOMAIN_ID"
#: First characters of the names: ROS domain and discovery, security, RMW, and settings of DDS and Zenoh.
PREFIXES = (
    DOMAIN,
    "ROS_LOCALHOST_ONLY",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
    "ROS_SUPER_CLIENT",
    "ROS_SECURITY_",
    "RMW_",
    "FASTRTPS_",
    "FASTDDS_",
    "SKIP_DEFAULT_XML_FILE",
    "CYCLONEDDS_",
    "ZENOH_",
)
#: Values of ROS_DOMAIN_ID for the default domain.
_DEFAULT_DOMAIN = ("", "0")
#: Arguments that name a domain.
_KEYWORDS = ("domain_id", DOMAIN)
#: Longest text of a value that is quoted.
_QUOTED = 40


def leave_domain(place: str) -> str:
    """Return the remedy for a program that chooses its domain at a place, such as `talker.py, line 7`."""
    return f"Take the domain out of {place}: {DOMAIN} of the terminal decides which domain a program joins."


def is_sessions(name: str) -> bool:
    """Tell whether each session has its own value of a variable."""
    return name.startswith(PREFIXES)


@dataclass(frozen=True)
class Asked:
    """A value of a variable in a submission, with its place there."""

    variable: str
    value: str
    file: str | None = None
    line: int | None = None

    @property
    def is_other_domain(self) -> bool:
        """True for a ROS domain other than the default one; no program of the lab is there."""
        if self.variable != DOMAIN:
            return False
        return self.value.strip() not in _DEFAULT_DOMAIN

    @property
    def place(self) -> str:
        """The place in words, such as `talker.py, line 7`."""
        if self.file is None:
            return "The submission"
        if self.line is None:
            return self.file
        return f"{self.file}, line {self.line}"


def asked_in(
    recorded: Recorded, submission: SubmissionRecord, artifact: str | None = None
) -> list[Asked]:
    """Return the session's variables with other values in the programs of a session, each value once.

    Parameters
    ----------
    artifact
        Artifact of the programs; None for all programs, as for an artifact without a process of its own.
    """
    names = _names_of(recorded, artifact)
    found = []
    for asked in (*_by_programs(recorded, names), *_by_launch_file(recorded, names)):
        placed = _placed(asked, submission)
        if placed not in found:
            found.append(placed)
    return found


def _names_of(recorded: Recorded, artifact: str | None) -> set[str]:
    """Return the names of an artifact's processes, or of all student's processes if it has none."""
    runs: tuple[ProcessRun, ...] = ()
    if artifact is not None:
        runs = recorded.processes_of(artifact)
    if not runs:
        runs = recorded.students
    return {run.name for run in runs}


def _by_programs(recorded: Recorded, names: Set[str]) -> Iterator[Asked]:
    """Yield the values in the claims of some processes."""
    for claim in recorded.record.claims:
        if claim.kind != SESSION_VARIABLE:
            continue
        if claim.process in names:
            yield Asked(claim.name, str(claim.value), claim.file, claim.line)


def _by_launch_file(recorded: Recorded, names: Set[str]) -> Iterator[Asked]:
    """Yield the values in the launch plan for some processes."""
    for process in planned(recorded):
        if process.id not in names:
            continue
        for variable, value in process.env.items():
            if is_sessions(variable):
                yield Asked(variable, value, process.file)


def planned(recorded: Recorded) -> tuple[Process, ...]:
    """Return the processes of the session's launch plan; none without a readable plan."""
    if recorded.record.plan is None:
        return ()
    try:
        return Plan.from_plain(recorded.record.plan).processes
    except MalformedPlanError:
        return ()


def _placed(asked: Asked, submission: SubmissionRecord) -> Asked:
    """Return a value with the first line for it: in its own file, or else in another one."""
    texts = submission.texts
    others = sorted(texts.keys() - {asked.file})
    for path in (asked.file, *others):
        if path not in texts:
            continue
        line = _line_of(path, texts[path], asked.variable)
        if line is not None:
            return replace(asked, file=path, line=line)
    if asked.file in texts:
        return asked
    return replace(asked, file=None, line=None)


def _line_of(path: str, text: str, variable: str) -> int | None:
    """Return the first line of a text with a value for a variable; None without one."""
    if path.endswith(".py"):
        return _line_in_python(text, variable)
    if not path.endswith((".xml", ".yaml", ".yml", ".launch")):
        return None
    for number, line in enumerate(text.split("\n"), 1):
        if re.search(rf"^[^#]*\b{variable}\b", line):
            return number
    return None


def _line_in_python(text: str, variable: str) -> int | None:
    """Return the first line of Python code with a value for a variable; None without one."""
    tree = tree_of(normalise(text))
    if tree is None:
        return None
    return min((line for line, _ in set_in(tree, variable)), default=None)


def set_in(tree: ast.Module, variable: str) -> Iterator[tuple[int, str]]:
    """Yield line and value of each place with a value for a variable, in a program or a launch file."""
    for node in ast.walk(tree):
        for value in _values(node, variable):
            yield value.lineno, code_of(value).strip("'\"")[:_QUOTED]


def _values(node: ast.AST, variable: str) -> Iterator[ast.expr]:
    """Yield the values for a variable in a statement or a call; None is the default.

    Examples
    --------
    `os.environ["ROS_DOMAIN_ID"] = "30"`, `SetEnvironmentVariable("ROS_DOMAIN_ID", "30")`,
    `additional_env={"ROS_DOMAIN_ID": "30"}`, `rclpy.init(domain_id=30)`.
    """
    quoted = repr(variable)
    match node:
        case ast.Assign(targets=[ast.Subscript(slice=ast.Constant(value=name))], value=value):
            if name == variable:
                yield value
        case ast.Dict(keys=keys, values=values):
            for key, value in zip(keys, values, strict=True):
                if key is None:  # `**others`
                    continue
                if code_of(key) == quoted:
                    yield value
        case ast.Call(func=function, args=[name, value, *_]) if code_of(name) == quoted:
            if _sets(function):
                yield value
        case ast.Call(keywords=keywords):
            yield from _of_keywords(keywords, variable)


def _sets(function: ast.expr) -> bool:
    """Tell whether a function of two arguments sets a variable.

    `setdefault` sets none, because a session gives each program its values.
    """
    called = code_of(function).rpartition(".")[2]
    return called in ("putenv", "SetEnvironmentVariable")


def _of_keywords(keywords: Iterable[ast.keyword], variable: str) -> Iterator[ast.expr]:
    """Yield the values of a variable among the keywords of a call."""
    by_name = {keyword.arg: keyword.value for keyword in keywords}
    names: Iterable[str] = (variable,)
    if variable == DOMAIN:
        names = _KEYWORDS
    if "name" in by_name and code_of(by_name["name"]) == repr(variable):
        names = ("value",)
    for name in names:
        value = by_name.get(name)
        if value is None:
            continue
        if code_of(value) != "None":
            yield value
