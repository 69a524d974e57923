"""Checks of a launch file: by its plan, and by the recorded run."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grader.checks.base import failed, passed
from grader.recording.session import Claim
from grader.recording.submission import BuildFact, PackageFact
from grader.result import Finding, Location, Outcome
from launch_plan.format import SCHEMA
from tests.synthetic import FLOATS, Session, at, evenly, judged, submission

LOADS = {"artifact": "it", "step": "plan"}
ARGUMENTS = {
    "step": "plan",
    "arguments": [{"name": "sim", "default": "true"}, {"name": "rate", "default": "100.0"}],
}
NODES: dict[str, Any] = {
    "step": "plan",
    "nodes": [
        {"node": "/talker", "artifact": "it", "executable": "talk", "charged_by": "talk.publishes"},
        {
            "node": "/listener",
            "artifact": "it",
            "executable": "listen",
            "charged_by": "listen.receives",
        },
    ],
}
PARAMETERS: dict[str, Any] = {
    "step": "plan",
    "other_step": "other",
    "parameters": [
        {
            "node": "/talker",
            "executable": "talk",
            "step": "read",
            "name": "rate",
            "value": 100.0,
            "other": 50.0,
        },
    ],
}
TOGETHER: dict[str, dict[str, Any]] = {
    "commands": {
        "topic": "/commands",
        "alone_session": "alone",
        "charged_by": "publishes",
        "window": "window",
    },
    "follows": {
        "topic": "/states",
        "command": "/commands",
        "field": "data",
        "index": 0,
        "subject": "the arm",
        "charged_by": "motion",
    },
    "answers": {"step": "enable", "charged_by": "enables"},
}
FAILED = failed("", "", "by its own fault")


def entry(executable: str, name: str | None, **more: Any) -> dict[str, Any]:
    """Give a process of a plan."""
    return {
        "id": f"{executable}-1",
        "path": "/x",
        "executable": executable,
        "name": name,
        "kind": "node",
        **more,
    }


def planned(session: Session, label: str = "plan", worked_around: Any = (), **plan: Any) -> Session:
    """Add the step that evaluated a launch file."""
    whole = {"schema": SCHEMA, "outcome": "error" if "problem" in plan else "ok", **plan}
    return session.step("plan", label, plan=whole, mended=list(worked_around))


# -- it loads --------------------------------------------------------------------------------------


def test_a_file_without_an_error_loads(tmp_path: Path) -> None:
    """A plan without a problem passes, and warnings are noted."""
    warnings = [{"kind": "k", "message": "odd", "file": "it.py", "line": 3}]
    finding = judged("launch_loads", LOADS, planned(Session(tmp_path), warnings=warnings))
    assert finding.outcome is Outcome.PASSED
    assert finding.notes == ("odd (it.py:3)",)


def test_output_that_only_goes_to_the_log_is_advised_of(tmp_path: Path) -> None:
    """Nodes without output='screen' are named with their lines, which costs nothing."""
    processes = [
        entry("talk", "talker", output="log", file="it.py", line=7),
        entry("listen", None, output="screen"),
        entry("rviz2", "rviz", output="log", absent="not here"),
    ]
    finding = judged("launch_loads", LOADS, planned(Session(tmp_path), processes=processes))
    assert finding.outcome is Outcome.PASSED
    (note,) = finding.notes
    assert note.startswith("What talker prints goes into a log file")
    assert "(it.py:7)" in note


def test_an_error_fails_with_its_line(tmp_path: Path) -> None:
    """The message, the line and the remedy are told."""
    problem = {
        "kind": "syntax",
        "message": "invalid syntax",
        "file": "it.py",
        "line": 4,
        "remedy": "Close it.",
    }
    finding = judged("launch_loads", LOADS, planned(Session(tmp_path), problem=problem))
    assert finding.outcome is Outcome.FAILED
    assert finding.reason == "Invalid syntax. (it.py, line 4)"
    assert finding.hint == "Close it."


def test_what_we_cannot_evaluate_is_undecided(tmp_path: Path) -> None:
    """A launch file that needs a missing module costs nothing, and no retry would decide it."""
    problem = {"kind": "module", "message": "needs xacro", "module": "xacro"}
    session = planned(Session(tmp_path), outcome="not_assessable", problem=problem)
    finding = judged("launch_loads", LOADS, session)
    assert (finding.outcome, finding.retry) == (Outcome.INCONCLUSIVE, False)


def test_a_file_in_newer_syntax_is_undecided(tmp_path: Path) -> None:
    """Syntax newer than the grader's Python is left to a person; a syntax mistake is not."""
    problem = {
        "kind": "syntax_error",
        "message": "syntax error: invalid syntax",
        "file": "it.py",
        "line": 1,
    }
    for name, text, outcome in (
        ("a", "type X = int\n", Outcome.INCONCLUSIVE),
        ("b", "x = (\n", Outcome.FAILED),
    ):
        session = planned(Session(tmp_path, name), problem=problem)
        assert (
            judged("launch_loads", LOADS, session, submission({"it.py": text})).outcome is outcome
        )


REPAIRED = {
    "kind": "unknown_keyword",
    "message": "'exec'",
    "file": "it.py",
    "line": 5,
    "remedy": "Write 'executable='.",
    "repair": "'exec=' was read as 'executable='",
}


def test_a_repaired_mistake_loses_the_loading_and_leaves_a_share_of_the_rest(
    tmp_path: Path,
) -> None:
    """The reason names the repair, and `where` its line.

    The rest counts for a share of its points.
    """
    finding = judged(
        "launch_loads",
        {**LOADS, "repaired_rest": 0.6},
        planned(Session(tmp_path), worked_around=[REPAIRED]),
    )
    assert (finding.outcome, finding.passes_on) == (Outcome.FAILED, Decimal("0.6"))
    assert "`ros2 launch` stops there" in finding.reason
    assert "it was repaired on a copy: 'exec=' was read as 'executable='." in finding.reason
    assert (finding.hint, finding.where[0].line) == ("Write 'executable='.", 5)


@pytest.mark.parametrize(
    ("shared", "credit"), [({}, "0.6"), ({"share/arm/launch/it.py": "arm/it.py"}, "1"), (None, "1")]
)
def test_a_file_that_its_package_does_not_install_costs_a_part(
    tmp_path: Path, shared: dict[str, str] | None, credit: str
) -> None:
    """The launch file is found by its path instead of the package's name.

    If the installation is not known for sure, nothing is lost.
    """
    record = submission({"arm/it.py": ""}, it="arm/it.py")
    record.packages = [PackageFact("arm", "arm", "ament_python", shared=shared)]
    finding = judged(
        "launch_loads", {**LOADS, "not_installed_costs": 0.4}, planned(Session(tmp_path)), record
    )
    assert finding.credit == Decimal(credit)
    assert [w.file for w in finding.where] == (["arm/setup.py"] if credit != "1" else [None])


def test_what_is_declared_until_a_file_stops_counts(tmp_path: Path) -> None:
    """An unrepaired mistake leaves a share for arguments seen before it.

    Without any, none is left.
    """
    problem = {"kind": "invalid_choice", "message": "no choice"}
    seen = planned(
        Session(tmp_path, "a"), problem=problem, arguments=[{"name": "rate", "default": "100.0"}]
    )
    assert judged("launch_loads", LOADS, seen).passes_on == Decimal("0.75")
    assert (
        "is not declared until the file stops" in judged("launch_arguments", ARGUMENTS, seen).reason
    )
    assert (
        judged("launch_loads", LOADS, planned(Session(tmp_path, "b"), problem=problem)).passes_on
        is None
    )


@pytest.mark.parametrize(
    ("kind", "message", "remedy", "outcome"),
    [
        ("unknown_executable", "no executable 'talk'", "", Outcome.PASSED),
        ("unknown_executable", "no executable 'tlak'", "", Outcome.FAILED),
        ("unknown_package", "package 'mine' not found", "Write it right.", Outcome.PASSED),
        ("unknown_package", "package 'lba' not found", "Did you mean 'lab'?", Outcome.FAILED),
    ],
)
def test_what_lacks_by_no_mistake_of_the_file_costs_nothing(
    tmp_path: Path, kind: str, message: str, remedy: str, outcome: Outcome
) -> None:
    """A file that was not handed in, and the name of a package that was not, are noted."""
    worked_around = [
        {"kind": kind, "message": message, "file": "it.py", "line": 5, "remedy": remedy}
    ]
    handed_in = submission({"it.py": ""}, it="it.py", talk=None)
    finding = judged(
        "launch_loads", LOADS, planned(Session(tmp_path), worked_around=worked_around), handed_in
    )
    assert (finding.outcome, bool(finding.notes)) == (outcome, outcome is Outcome.PASSED)


@pytest.mark.parametrize(
    ("build", "words"),
    [
        ({"outcome": "failed", "output": "error: package directory 'x' does not exist"}, "'x'"),
        ({"outcome": "built", "installed": ["bin/talk"]}, "setup.cfg"),
        ({"outcome": "built", "without_interpreter": ["lib/arm/talk"]}, "Exec format error"),
        ({"outcome": "built", "installed": ["lib/arm/talk"]}, ""),
        ({"outcome": "not built", "reason": "no tool"}, ""),
    ],
)
def test_a_package_that_ros2_launch_refuses_is_charged_once(
    tmp_path: Path, build: dict[str, Any], words: str
) -> None:
    """The launch file is judged by an installation as it was meant, for a part of the points of the rest."""
    record = submission({"arm/it.py": ""}, it="arm/it.py")
    record.packages = [PackageFact("arm", "arm", "ament_python")]
    record.builds = [BuildFact("arm", "arm", **build)]
    processes = [{**entry("talk", "talker"), "package": "arm"}]
    finding = judged("launch_loads", LOADS, planned(Session(tmp_path), processes=processes), record)
    assert (finding.outcome is Outcome.FAILED) == bool(words)
    assert words in finding.reason
    if words:
        assert finding.passes_on == Decimal("0.9")
        assert finding.causes == ("build of arm",)
        assert finding.hint


@pytest.mark.parametrize(
    ("name", "outcome"), [("talk", Outcome.INCONCLUSIVE), ("tlak", Outcome.FAILED)]
)
def test_a_compiled_program_that_is_not_built_here_costs_nothing(
    tmp_path: Path, name: str, outcome: Outcome
) -> None:
    """A launch file that starts a program in C++ is left to a person; a misspelt name is a mistake still."""
    record = submission(
        {"arm/it.py": "", "arm/CMakeLists.txt": "add_executable(talk a.cpp)"}, it="arm/it.py"
    )
    record.packages = [PackageFact("arm", "arm", "ament_cmake")]
    noted = [
        {"kind": "unknown_executable", "message": f"Executable '{name}' not found in package 'arm'"}
    ]
    session = planned(Session(tmp_path), worked_around=noted)
    finding = judged("launch_loads", LOADS, session, record)
    assert (finding.outcome, finding.retry) == (outcome, outcome is Outcome.FAILED)


@pytest.mark.parametrize(
    ("outcome", "expected"), [("timeout", Outcome.INCONCLUSIVE), ("failed", Outcome.FAILED)]
)
def test_an_evaluation_that_the_machine_delayed_is_undecided(
    tmp_path: Path, outcome: str, expected: Outcome
) -> None:
    """A launch file is at fault only if it was busy by itself until its time was over."""
    problem = {"kind": "too_slow", "message": "the launch file was still busy after 10 s"}
    session = planned(Session(tmp_path), problem=problem)
    session.record.steps[-1].outcome = outcome
    assert judged("launch_loads", LOADS, session).outcome is expected


def test_without_a_plan_nothing_is_decided(tmp_path: Path) -> None:
    """A plan that is not there or is none is the grader's fault; a missing file is not."""
    unevaluated = judged("launch_loads", LOADS, Session(tmp_path / "a"))
    assert (unevaluated.outcome, unevaluated.retry) == (Outcome.INCONCLUSIVE, True)
    broken = Session(tmp_path / "b").step("plan", "plan", plan={"schema": "other"})
    assert judged("launch_loads", LOADS, broken).outcome is Outcome.INCONCLUSIVE
    assert (
        judged("launch_loads", LOADS, Session(tmp_path / "c"), submission(it=None)).outcome
        is Outcome.FAILED
    )


# -- arguments -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("defaults", "credit", "words"),
    [
        ({"sim": "true", "rate": "100.0"}, "1", ""),
        ({"sim": "True", "rate": "100"}, "1", ""),
        ({"sim": "false", "rate": "100.0"}, "0.75", "'false'; 'true' is asked for"),
        ({"sim": None, "rate": "100.0"}, "0.75", "no default"),
        ({"use": "true", "rate": "100.0"}, "0.5", "sim is not declared; declared are use"),
        ({}, "0", "rate is not declared"),
    ],
)
def test_each_argument_is_a_part(
    tmp_path: Path, defaults: dict[str, str | None], credit: str, words: str
) -> None:
    """An argument that is missing loses its part, another default half of it; spelling is no matter."""
    listed = [{"name": name, "default": default} for name, default in defaults.items()]
    finding = judged("launch_arguments", ARGUMENTS, planned(Session(tmp_path), arguments=listed))
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


def test_the_first_declaration_of_an_argument_counts(tmp_path: Path) -> None:
    """An included file may declare the arguments again, without defaults."""
    listed: list[dict[str, str | None]] = [
        {"name": "sim", "default": "true"},
        {"name": "rate", "default": "100.0"},
        {"name": "sim", "default": None},
        {"name": "rate", "default": None},
    ]
    session = planned(Session(tmp_path), arguments=listed)
    assert judged("launch_arguments", ARGUMENTS, session).outcome is Outcome.PASSED


@pytest.mark.parametrize(("other", "credit"), [("50.0", "1"), ("100.0", "0.25")])
def test_arguments_that_change_nothing_keep_little(tmp_path: Path, other: str, credit: str) -> None:
    """With other values of all arguments, the file starts something else, or the same."""
    wanted: Any = ARGUMENTS["arguments"]
    listed = [{"name": each["name"], "default": each["default"]} for each in wanted]
    session = planned(Session(tmp_path), arguments=listed, processes=[entry("talk", "100.0")])
    session = planned(session, "other", arguments=listed, processes=[entry("talk", other)])
    finding = judged("launch_arguments", {**ARGUMENTS, "other_step": "other"}, session)
    assert finding.credit == Decimal(credit)
    assert ("has no effect" in finding.reason) == (credit != "1")


def test_an_argument_that_was_assumed_is_not_charged_again(tmp_path: Path) -> None:
    """An undeclared argument keeps the file from loading, and costs points there only."""
    worked_around = [
        {
            "kind": "undefined_configuration",
            "message": "'sim' does not exist",
            "file": "it.py",
            "line": 9,
        }
    ]
    session = planned(
        Session(tmp_path),
        worked_around=worked_around,
        arguments=[{"name": "rate", "default": "100.0"}],
    )
    assert judged("launch_arguments", ARGUMENTS, session).outcome is Outcome.PASSED


# -- nodes -----------------------------------------------------------------------------------------


def nodes(session: Session, record: Any = None, **findings: Finding) -> Finding:
    """Judge the nodes of a launch file."""
    named = {name.replace("_", "."): finding for name, finding in findings.items()}
    return judged("launch_nodes", NODES, session, record, findings=named)


BOTH = [entry("talk", "talker"), entry("listen", "listener")]


def test_nodes_that_are_up_pass(tmp_path: Path) -> None:
    """Both nodes in the graph earn all."""
    session = planned(Session(tmp_path), processes=BOTH).node("/talker").node("/listener")
    assert nodes(session).outcome is Outcome.PASSED


def test_a_node_that_is_not_started_costs_its_part(tmp_path: Path) -> None:
    """A node without an entry in the launch file is named."""
    session = planned(Session(tmp_path), processes=BOTH[:1]).node("/talker")
    finding = nodes(session)
    assert finding.credit == Decimal("0.5")
    assert "starts listen as /listener" in finding.reason


def test_a_node_that_other_arguments_leave_out_costs_a_share(tmp_path: Path) -> None:
    """The node runs with the default arguments alone."""
    wanted = {**NODES, "other_step": "other", "optional_costs": 0.4}
    session = planned(Session(tmp_path), processes=BOTH).node("/talker").node("/listener")
    finding = judged("launch_nodes", wanted, planned(session, "other", processes=BOTH[:1]))
    assert finding.credit == Decimal("0.6")
    assert finding.reason == "With other arguments the file does not start /listener."
    session = planned(Session(tmp_path), processes=BOTH).node("/talker").node("/listener")
    whole = judged("launch_nodes", wanted, planned(session, "other", processes=BOTH))
    assert whole.outcome is Outcome.PASSED


def test_a_node_under_another_name_costs_half_its_part(tmp_path: Path) -> None:
    """The name that the launch file gives is told, with its line."""
    other = [BOTH[0], entry("listen", "hearer", file="it.py", line=20)]
    finding = nodes(planned(Session(tmp_path), processes=other).node("/talker").node("/hearer"))
    assert finding.credit == Decimal("0.75")
    assert re.search(r"runs under the name /?hearer, not /?listener", finding.reason)
    assert finding.where[0].line == 20
    assert finding.hint == "Give the Node name='listener'."
    moved = entry("listen", "/arm/listener")
    finding = nodes(planned(Session(tmp_path), processes=[BOTH[0], moved]).node("/talker"))
    assert "Take the namespace out" in finding.hint


def test_a_node_at_fault_by_itself_is_not_charged_again(tmp_path: Path) -> None:
    """A fault charged by the node's own criterion is noted here and costs nothing more."""
    session = planned(Session(tmp_path), processes=BOTH).node("/talker")
    finding = nodes(session, listen_receives=FAILED)
    assert (finding.outcome, finding.credit) == (Outcome.EXCUSED, Decimal(1))
    assert finding.reason == (
        "listen was not started. This mistake is charged under 'listen.receives', and not again here."
    )
    assert nodes(session.recorded(), listen_receives=passed("", "")).credit == Decimal("0.5")  # type: ignore[arg-type]


def test_a_node_whose_file_is_missing_is_charged_elsewhere(tmp_path: Path) -> None:
    """Without the node's file the launch file loses nothing for it."""
    session = planned(Session(tmp_path), processes=BOTH)
    finding = nodes(session, submission(it=None))
    assert finding.outcome is Outcome.EXCUSED
    assert finding.reason.count("This mistake is charged") == 2


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (None, "listen was not started."),
        ({"exited_ns": None}, "ran, but no such node appeared"),
        (
            {"interrupted_ns": None, "ended_by": "itself", "exit_status": 3},
            "ended with status 3: 'oh'.",
        ),
    ],
)
def test_why_a_node_is_down_is_reported(
    tmp_path: Path, run: dict[str, Any] | None, words: str
) -> None:
    """A missing start, a process without its node and an ended process have different reasons."""
    session = planned(Session(tmp_path), processes=BOTH).node("/talker")
    if run is not None:
        session.process("listen-1", ["oh"], **run)
    assert words in nodes(session).reason


ENDED: dict[str, Any] = {
    "exited_ns": at(2.0),
    "interrupted_ns": None,
    "ended_by": "itself",
    "exit_status": 1,
}


def test_an_entry_point_that_leads_nowhere_is_shown_in_its_build_file(tmp_path: Path) -> None:
    """The node of `listen` cannot start, because setup.py names a function that its module lacks."""
    record = submission({"arm/arm/it.py": "def main():\n    pass\n"}, it="arm/arm/it.py")
    record.texts["arm/setup.py"] = "setup(\n  entry_points=['listen = arm.it:mian'])\n"
    executables = {"listen": "arm.it:mian"}
    record.packages = [PackageFact("arm", "arm", "ament_python", executables)]
    installed = ["lib/arm/listen", "lib/python3.12/site-packages/arm/it.py"]
    record.builds = [BuildFact("arm", "arm", "built", installed=installed)]
    processes = [{**each, "package": "arm"} for each in BOTH]
    session = planned(Session(tmp_path), processes=processes).node("/talker")
    session.process("listen-1", ["AttributeError: ..."], **ENDED)
    finding = nodes(session, record)
    assert finding.outcome is Outcome.PARTIAL
    assert "arm/it.py has no function mian" in finding.reason
    assert finding.hint == "Write arm.it:main, or rename the function to mian."
    assert finding.where[-1] == Location(file="arm/setup.py", line=2)
    assert finding.causes == ("build of arm",)


MISSING = ["Traceback (most recent call last):", '  File "/ws/src/it.py", line 1, in <module>']
MISSING.append("ModuleNotFoundError: No module named 'matplotlib'")


@pytest.mark.parametrize(
    ("source", "up", "outcome"),
    [
        ("import matplotlib\n", ["/listener"], Outcome.INCONCLUSIVE),
        ("import matplotlib\n", [], Outcome.INCONCLUSIVE),
        ("raise SystemExit\n", ["/listener"], Outcome.PARTIAL),
    ],
)
def test_a_node_that_lacks_a_library_here_is_for_a_person(
    tmp_path: Path, source: str, up: list[str], outcome: Outcome
) -> None:
    """A node that needs a missing library is undecided until a person has decided.

    A node that only claims so earns nothing.
    """
    session = planned(
        Session(tmp_path), processes=[entry("talk", "talker"), entry("listen", "listener")]
    )
    session.process("talk-1", MISSING, artifact=None, **ENDED)
    for node in up:
        session.node(node)
    finding = nodes(session, submission({"it.py": source}))
    assert finding.outcome is outcome
    assert ("needs matplotlib" in finding.reason) == (outcome is Outcome.INCONCLUSIVE)


@pytest.mark.parametrize(
    ("source", "outcome"),
    [("import xacro\n", Outcome.INCONCLUSIVE), ("raise ImportError\n", Outcome.FAILED)],
)
def test_a_launch_file_lacks_only_what_it_imports(
    tmp_path: Path, source: str, outcome: Outcome
) -> None:
    """A missing module is believed if the launch file imports that module at that line."""
    problem = {
        "kind": "missing_module",
        "message": "m",
        "file": "it.py",
        "line": 1,
        "module": "xacro",
    }
    session = planned(Session(tmp_path), outcome="not_assessable", problem=problem)
    finding = judged(
        "launch_loads", {"artifact": "it", "step": "plan"}, session, submission({"it.py": source})
    )
    assert finding.outcome is outcome


def died_of(given: str, declared: str, value: str) -> dict[str, Any]:
    """Give a process that ended since a parameter has another type than declared."""
    said = f"Trying to set parameter 'limit' to '{value}' of type '{given}', expecting type '{declared}'"
    frame = '  File "/ws/src/it.py", line 9, in __init__'
    lines = ["Traceback (most recent call last):", frame]
    lines.append(f"rclpy.exceptions.InvalidParameterTypeException: {said}: limit")
    return {
        "lines": lines,
        "exited_ns": at(2.0),
        "interrupted_ns": None,
        "ended_by": "itself",
        "exit_status": 1,
    }


def test_a_parameter_of_another_type_shows_both_places(tmp_path: Path) -> None:
    """The launch file may give the wrong type, or the node declare it: both lines are shown."""
    session = planned(
        Session(tmp_path), processes=[entry("talk", "talker", file="launch.py", line=4)]
    )
    session.process("talk-1", artifact=None, **died_of("STRING", "DOUBLE", "1.5"))
    finding = nodes(session.node("/listener"))
    assert [str(where) for where in finding.where] == ["launch.py:4", "it.py:9"]
    assert "quotation marks" in finding.hint


@pytest.mark.parametrize(("charged", "credit"), [(FAILED, "1"), (passed("", ""), "0.5")])
def test_rubrics_of_earlier_versions_name_a_check_for_wrong_types(
    tmp_path: Path, charged: Finding, credit: str
) -> None:
    """A wrong type is not charged to the launch file if the named check took points."""
    wanted = {
        "step": "plan",
        "nodes": [{**NODES["nodes"][0], "types_charged_by": "types"}, NODES["nodes"][1]],
    }
    session = planned(Session(tmp_path), processes=BOTH)
    session.process("talk-1", artifact=None, **died_of("BOOL", "STRING", "True"))
    finding = judged("launch_nodes", wanted, session.node("/listener"), findings={"types": charged})
    assert finding.credit == Decimal(credit)


def test_a_node_that_was_there_for_a_moment_is_down(tmp_path: Path) -> None:
    """A node that ends with an error, as one with a parameter of a wrong type, does not count by its first moment."""
    said = [
        "rclpy.exceptions.InvalidParameterTypeException: Trying to set parameter 'rate' to '5' of type 'INTEGER'"
    ]
    session = planned(Session(tmp_path), processes=BOTH).node("/talker").node("/listener")
    session.process("listen-1", said, interrupted_ns=None, exit_status=1)
    finding = nodes(session)
    assert finding.credit == Decimal("0.5")
    assert "InvalidParameterType" in finding.reason


def test_a_node_that_the_session_ends_is_not_down(tmp_path: Path) -> None:
    """At the end of steps without an interrupt the grader kills running programs, at no cost."""
    session = planned(Session(tmp_path), processes=BOTH).node("/talker").node("/listener")
    session.process("listen-1", interrupted_ns=None, exit_status=-9, ended_by="kill")
    assert nodes(session).credit == Decimal(1)


def test_a_node_that_does_not_run_costs_what_the_rubric_says(tmp_path: Path) -> None:
    """A missing node may cost more than its part, because the others cannot work with it."""
    session = planned(Session(tmp_path), processes=BOTH[:1]).node("/talker")
    assert judged("launch_nodes", NODES, session).credit == Decimal("0.5")
    assert judged("launch_nodes", {**NODES, "down_costs": 0.8}, session).credit == Decimal("0.2")


def test_a_plan_with_a_problem_starts_nothing(tmp_path: Path) -> None:
    """A file that cannot be evaluated to its end starts no node at all."""
    problem = {"kind": "k", "message": "broken", "file": "it.py", "line": 2}
    finding = nodes(planned(Session(tmp_path), problem=problem))
    assert finding.outcome is Outcome.FAILED
    assert finding.measured == "nothing was started"


# -- parameters ------------------------------------------------------------------------------------


def parameter(folder: Path, planned_value: Any, other_value: Any, running: Any = None) -> Finding:
    """Judge one parameter by the plans' values and the running node's."""
    session = Session(folder)
    for label, value in (("plan", planned_value), ("other", other_value)):
        given = [] if value is None else [{"name": "rate", "value": value}]
        planned(session, label, processes=[entry("talk", "talker", parameters=given)])
    if running is not None:
        session.step(
            "get_parameters",
            "read",
            values={"rate": {"type": "double", "value": running}},
            declared=["rate"],
        )
    return judged("launch_parameters", PARAMETERS, session)


@pytest.mark.parametrize(
    ("values", "credit", "words"),
    [
        ((100.0, 50.0, 100.0), "1", ""),
        ((100.0, 50.0), "1", ""),
        ((100, 50, None), "1", ""),
        ((100.0, 100.0, 100.0), "0.5", "not wired to its launch argument"),
        ((100.0, "50.0.0", 100.0), "0.5", "not as it should: with another argument it is '50.0.0'"),
        ((30.0, 50.0, 30.0), "0", "is 30.0, not 100.0"),
        ((None, None, 100.0), "0", "the node's own default"),
        ((None, None), "0", "gives talker no rate"),
    ],
)
def test_a_parameter_reaches_the_node_and_follows_its_argument(
    tmp_path: Path, values: tuple[Any, ...], credit: str, words: str
) -> None:
    """Half is for the value, half for the wire to the argument; the node's own default is not the launch file's."""
    finding = parameter(tmp_path, *values)
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


@pytest.mark.parametrize(
    ("read", "ended", "words"),
    [
        (
            {"values": {}, "declared": []},
            False,
            "the node does not declare it, so it has no effect",
        ),
        (None, True, "the node had ended"),
        (None, False, "not read from the node"),
    ],
)
def test_an_unread_value_is_of_the_launch_file(
    tmp_path: Path, read: dict[str, Any] | None, ended: bool, words: str
) -> None:
    """The measured text gives the reason."""
    session = Session(tmp_path)
    for label, value in (("plan", 100.0), ("other", 50.0)):
        given = [{"name": "rate", "value": value}]
        planned(session, label, processes=[entry("talk", "talker", parameters=given)])
    if read is not None:
        session.step("get_parameters", "read", **read)
    if ended:
        session.process("talk-1", artifact=None, interrupted_ns=None, exit_status=1)
    finding = judged("launch_parameters", PARAMETERS, session)
    assert finding.measured == f"talker.rate = 100.0 by the launch file ({words})"


@pytest.mark.parametrize(("default", "credit"), [("50.0", "1"), ("70.0", "0")])
def test_a_wrong_default_is_charged_with_the_arguments(
    tmp_path: Path, default: str, credit: str
) -> None:
    """A parameter that has its argument's default is as it should be, whatever that default is."""
    wanted = {**PARAMETERS, "parameters": [{**PARAMETERS["parameters"][0], "argument": "rate"}]}
    arguments = [{"name": "rate", "default": default}]
    process = entry("talk", "talker", parameters=[{"name": "rate", "value": 50.0}])
    session = Session(tmp_path)
    for label in ("plan", "other"):
        planned(session, label, processes=[process], arguments=arguments)
    assert judged("launch_parameters", wanted, session).credit == Decimal(credit)


@pytest.mark.parametrize(("declared", "credit"), [("rate", "0.5"), ("frequency", "1")])
def test_a_parameter_cannot_follow_an_argument_of_another_name(
    tmp_path: Path, declared: str, credit: str
) -> None:
    """An argument that is not declared under its name is charged with the arguments, and not as a loose wire again."""
    wanted = {**PARAMETERS, "parameters": [{**PARAMETERS["parameters"][0], "argument": "rate"}]}
    process = entry("talk", "talker", parameters=[{"name": "rate", "value": 100.0}])
    session = Session(tmp_path)
    for label in ("plan", "other"):
        planned(
            session, label, processes=[process], arguments=[{"name": declared, "default": "100.0"}]
        )
    assert judged("launch_parameters", wanted, session).credit == Decimal(credit)


def test_a_parameter_left_out_for_its_argument_is_not_charged_again(tmp_path: Path) -> None:
    """The check of the loading charges an argument without a value."""
    for names, credit in ((["rate"], "1"), (["speed"], "0")):
        session = Session(tmp_path)
        for label in ("plan", "other"):
            plan = {"schema": SCHEMA, "outcome": "ok", "processes": [entry("talk", "talker")]}
            session.step("plan", label, plan=plan, mended=[], left_out={"talk-1": names})
        assert judged("launch_parameters", PARAMETERS, session).credit == Decimal(credit)


def test_a_parameter_weighs_as_the_rubric_says(tmp_path: Path) -> None:
    """One of weight 3 beside one of weight 1 is three quarters."""
    first = {**PARAMETERS["parameters"][0], "weight": 3}
    second = {**PARAMETERS["parameters"][0], "name": "gain", "value": 1.0, "other": 1.0}
    talk = entry("talk", "talker", parameters=[{"name": "gain", "value": 1.0}])
    session = planned(planned(Session(tmp_path), processes=[talk]), "other", processes=[talk])
    finding = judged("launch_parameters", {**PARAMETERS, "parameters": [first, second]}, session)
    assert finding.credit == Decimal("0.25")


def test_parameters_of_nodes_that_are_not_started_are_not_reached(tmp_path: Path) -> None:
    """A node without an entry is charged with the nodes."""
    session = planned(planned(Session(tmp_path)), "other")
    assert judged("launch_parameters", PARAMETERS, session).outcome is Outcome.NOT_REACHED


def test_a_parameter_is_pointed_at_where_the_launch_file_gives_it(tmp_path: Path) -> None:
    """The line of the parameter, or of the node, is the place of the finding."""
    text = "ld = [\n    Node(\n        name='talker',\n        parameters=[{\n            'rate': 30.0}])]\n"
    session = Session(tmp_path)
    given = [{"name": "rate", "value": 30.0}]
    for label in ("plan", "other"):
        planned(
            session,
            label,
            processes=[entry("talk", "talker", parameters=given, file="a.py", line=2)],
        )
    finding = judged("launch_parameters", PARAMETERS, session, submission({"a.py": text}))
    assert [(w.file, w.line) for w in finding.where] == [("a.py", 5)]


def test_a_parameter_file_for_the_name_in_the_code_counts(tmp_path: Path) -> None:
    """A launch file that leaves the node's name to its code gives a file for that name."""
    session = Session(tmp_path)
    for label, value in (("plan", 100.0), ("other", 50.0)):
        content = {"talker": {"ros__parameters": {"rate": value}}}
        planned(
            session,
            label,
            processes=[entry("talk", None, parameters=[{"file": "p.yaml", "content": content}])],
        )
    assert judged("launch_parameters", PARAMETERS, session).outcome is Outcome.PASSED


# -- all together ----------------------------------------------------------------------------------


def together(
    folder: Path, rate_hz: float = 100, follows: bool = True, answers: bool = True
) -> Session:
    """Make a session with all nodes running."""
    times = evenly(rate_hz, 3.0)
    command = np.sin(np.array(times))
    session = Session(folder).window(0.9, 4.1)
    session.messages("/commands", [[x] for x in command.tolist()], times)
    session.messages("/states", [[x if follows else 0.0] for x in command.tolist()], times)
    response = {"success": True} if answers else None
    return session.step(
        "call", "enable", calls=[{"started_ns": at(1.0), "ended_ns": at(1.1), "response": response}]
    )


def alone(folder: Path, rate_hz: float = 100) -> Any:
    """Make the session of the publisher alone."""
    times = evenly(rate_hz, 3.0)
    session = Session(folder, "alone").messages("/commands", [[0.0]] * len(times), times)
    return session.window(0.9, 4.1).recorded()


@pytest.mark.parametrize(
    ("how", "credit", "words"),
    [
        ({}, 1.0, ""),
        ({"rate_hz": 40}, 0.833, "Commands come at 40.0 Hz"),
        ({"follows": False}, 0.667, "does not follow"),
        ({"answers": False}, 0.667, "does not answer"),
    ],
)
def test_each_of_three_parts_counts(
    tmp_path: Path, how: dict[str, Any], credit: float, words: str
) -> None:
    """Commands, the arm and the service are a third each."""
    session = together(tmp_path, **how)
    finding = judged("launch_together", TOGETHER, session, others={"alone": alone(tmp_path)})
    assert float(finding.credit) == pytest.approx(credit, abs=0.01)
    assert words in finding.reason


@pytest.mark.parametrize(
    ("launched", "by_hand", "credit"),
    [("/arm/states", "/states", 0), ("/states", "/mine", 1), ("/mine", "/mine", 1)],
)
@pytest.mark.parametrize("kind", ["subscription", "service"])
def test_endpoints_that_the_launch_file_moves_away_meet_nobody(
    tmp_path: Path, kind: str, launched: str, by_hand: str, credit: int
) -> None:
    """A node must stay where it is alone, or come where the lab wants it."""
    both = []
    for folder, name, used in (("a", "test", launched), ("b", "alone", by_hand)):
        session = planned(Session(tmp_path / folder, name), processes=[BOTH[1]])
        session.record.plan = session.record.steps[-1].result["plan"]
        session.called(f"/states={by_hand}")
        if kind == "service":
            session.service(used, node="/listener")
        else:
            session.endpoint(kind, used, node="/listener")
        both.append(session)
    stays: dict[str, Any] = {"node": "/listener", "artifact": "it", "alone_session": "alone"}
    stays[f"{kind}s"] = ["/states"]
    wanted = {"answers": TOGETHER["answers"], "stays": [stays]}
    answered = {"started_ns": at(1.0), "ended_ns": at(1.1), "response": {"success": True}}
    session = both[0].step("call", "enable", calls=[answered])
    finding = judged("launch_together", wanted, session, others={"alone": both[1].recorded()})
    assert finding.credit == credit
    assert ("not on /states, and alone it is" in finding.reason) == (not credit)


@pytest.mark.parametrize(
    ("launched", "by_hand", "credit"),
    [("/arm/commands", "/commands", 0), ("/x", "/x", 1), ("/commands", "/x", 1)],
)
def test_commands_that_the_launch_file_moves_away_reach_nobody(
    tmp_path: Path, launched: str, by_hand: str, credit: int
) -> None:
    """A namespace that moves the commands costs all; another name of the program's own costs nothing here."""
    times = evenly(100, 3.0)
    rows = [[x] for x in np.sin(times).tolist()]
    both = []
    for folder, name, used in (("a", "test", launched), ("b", "alone", by_hand)):
        session = Session(tmp_path / folder, name).called(f"/commands={used}")
        both.append(session.messages(used, rows, times).window(0.9, 4.1))
    wanted = {"commands": TOGETHER["commands"]}
    others = {"alone": both[1].recorded()}
    finding = judged("launch_together", wanted, both[0], others=others)
    assert finding.credit == credit
    assert ("namespace" in finding.reason) == (not credit)
    assert "Commands come at" not in finding.reason
    assert ("begin the name in the program with '/'" in finding.hint) == (not credit)


@pytest.mark.parametrize(("gain", "credit"), [(1.0, 1), (0.6, 1), (0.3, 0)])
def test_any_field_may_follow_another(tmp_path: Path, gain: float, credit: int) -> None:
    """A robot's speed follows its command in a message of another type.

    Parts that the rubric leaves out do not count.
    """
    times = evenly(50, 3.0)
    speeds = [{"linear": {"x": 0.5 * math.sin(t), "y": 0.2}} for t in times]
    moved = []
    for s in speeds:
        moved.append(
            {"twist": {"twist": {"linear": {k: gain * v for k, v in s["linear"].items()}}}}
        )
    session = Session(tmp_path).typed("/cmd_vel", "geometry_msgs/msg/Twist", speeds, times)
    session.typed("/odom", "nav_msgs/msg/Odometry", moved, times)
    follows = {
        "topic": "/odom",
        "field": "twist.twist.linear",
        "commanded": {"topic": "/cmd_vel", "field": "linear"},
        "unit": "m/s",
        "charged_by": "motion",
    }
    finding = judged("launch_together", {"follows": follows}, session)
    assert finding.credit == credit
    assert finding.expected == "the simulation follows"
    assert finding.measured.startswith("the simulation is off by ")


def test_a_rate_that_the_machine_may_have_lowered_is_undecided(tmp_path: Path) -> None:
    """Fewer commands are not charged where a node or the arm had no core for as long as that takes."""
    others = {"alone": alone(tmp_path / "alone")}
    busy = together(tmp_path / "a", rate_hz=60).process("talk").delayed("talk", 1.6, 5.0)
    assert judged("launch_together", TOGETHER, busy, others=others).outcome is Outcome.INCONCLUSIVE
    calm = together(tmp_path / "b", rate_hz=60).process("talk").delayed("talk", 0.2, 5.0)
    assert judged("launch_together", TOGETHER, calm, others=others).outcome is Outcome.PARTIAL


def test_the_rate_is_compared_with_the_rate_alone(tmp_path: Path) -> None:
    """A publisher that is slow by itself is not charged again."""
    session = together(tmp_path, rate_hz=40)
    finding = judged("launch_together", TOGETHER, session, others={"alone": alone(tmp_path, 40)})
    assert finding.outcome is Outcome.PASSED


def test_what_is_charged_elsewhere_is_left_out(tmp_path: Path) -> None:
    """If each node fails by its own fault, nothing is left to judge."""
    charged = {"publishes": FAILED, "motion": FAILED, "enables": FAILED}
    finding = judged("launch_together", TOGETHER, Session(tmp_path), findings=charged)
    assert finding.outcome is Outcome.NOT_REACHED
    session = together(tmp_path / "still", follows=False)
    finding = judged("launch_together", TOGETHER, session, findings=charged)
    assert (finding.outcome, finding.credit) == (Outcome.EXCUSED, Decimal(1))
    assert "charged under 'motion'" in finding.reason


def test_what_a_node_would_do_that_is_not_up_is_left_out(tmp_path: Path) -> None:
    """A node that never came up is charged with the nodes, and not here again."""
    with_nodes = {
        "commands": {**TOGETHER["commands"], "node": "/talker"},
        "follows": {**TOGETHER["follows"], "node": "/talker"},
        "answers": {**TOGETHER["answers"], "node": "/server"},
    }
    answering = together(tmp_path / "a", rate_hz=1).node("/server")
    finding = judged(
        "launch_together", with_nodes, answering, others={"alone": alone(tmp_path / "a")}
    )
    assert finding.outcome is Outcome.PASSED
    assert finding.measured.startswith("the service answers; not judged without its node: ")
    silent = together(tmp_path / "b", answers=False).node("/server")
    assert (
        judged(
            "launch_together", with_nodes, silent, others={"alone": alone(tmp_path / "b")}
        ).credit
        == 0
    )
    nobody = judged("launch_together", with_nodes, Session(tmp_path / "c"))
    assert nobody.outcome is Outcome.NOT_REACHED


def test_a_node_that_died_is_not_charged_for_its_silence(tmp_path: Path) -> None:
    """A node that ended by itself is charged with the nodes, even if it was seen for a moment."""
    plan = {
        "schema": SCHEMA,
        "outcome": "ok",
        "processes": [entry("talk", "talker"), entry("serve", "server")],
    }
    with_nodes = {part: {**TOGETHER[part], "node": "/talker"} for part in ("commands", "follows")}
    session = together(tmp_path, rate_hz=1).node("/server").node("/talker")
    session.record.plan = plan
    session.process("talk-1", [], interrupted_ns=None, exit_status=1)
    finding = judged(
        "launch_together", {**TOGETHER, **with_nodes}, session, others={"alone": alone(tmp_path)}
    )
    assert finding.outcome is Outcome.PASSED
    assert finding.measured.startswith("the service answers; not judged without its node: ")


@pytest.mark.parametrize(("publish_rate", "credit"), [(40.0, 1.0), (100.0, 0.833), (None, 0.833)])
def test_a_rate_that_the_launch_file_gives_the_node_is_kept(
    tmp_path: Path, publish_rate: float | None, credit: float
) -> None:
    """Which rate the launch file gives is charged with its arguments and parameters, and not as a slow node again."""
    commands = {**TOGETHER["commands"], "rate_step": "read", "rate_parameter": "publish_rate"}
    if publish_rate is None:
        values = {}
    else:
        values = {"publish_rate": {"type": "double", "value": publish_rate}}
    session = together(tmp_path, rate_hz=40).step("get_parameters", "read", values=values)
    wanted = {**TOGETHER, "commands": commands}
    finding = judged("launch_together", wanted, session, others={"alone": alone(tmp_path)})
    assert float(finding.credit) == pytest.approx(credit, abs=0.001)


@pytest.mark.parametrize(
    ("asked", "credit"), [(FLOATS, 0.667), ("std_msgs/msg/Float32MultiArray", 1.0)]
)
def test_an_arm_that_cannot_hear_commands_of_another_type_need_not_follow(
    tmp_path: Path, asked: str, credit: float
) -> None:
    """Another type than the lab's is charged where it is published, and not as an arm that stands still again."""
    session = together(tmp_path, follows=False).endpoint("subscription", "/commands", "/arm", asked)
    others = {"alone": alone(tmp_path)}
    finding = judged("launch_together", TOGETHER, session, others=others, reference_nodes=["/arm"])
    assert float(finding.credit) == pytest.approx(credit, abs=0.001)


@pytest.mark.parametrize(
    ("made", "outcome"), [("/talker", Outcome.INCONCLUSIVE), ("/talk", Outcome.PARTIAL)]
)
def test_a_node_that_was_made_and_never_seen_is_undecided(
    tmp_path: Path, made: str, outcome: Outcome
) -> None:
    """The node's program says that it made the node, so the discovery may have failed.

    Another name, or the third recording, is charged.
    """
    session = planned(Session(tmp_path), processes=BOTH).node("/listener").process("talk-1")
    session.record.claims.append(Claim("talk-1", "publisher", "/commands", node=made, file="it.py"))
    finding = nodes(session)
    assert finding.outcome is outcome
    assert (finding.settled or finding).outcome is Outcome.PARTIAL


@pytest.mark.parametrize(
    ("delay_s", "outcome"), [(2.5, Outcome.INCONCLUSIVE), (0.1, Outcome.PARTIAL)]
)
def test_an_arm_that_had_no_core_may_not_have_followed_for_that(
    tmp_path: Path, delay_s: float, outcome: Outcome
) -> None:
    """The reference nodes need a core as well."""
    session = (
        together(tmp_path, follows=False)
        .process("arm", role="reference")
        .delayed("arm", delay_s, 5.0)
    )
    assert (
        judged("launch_together", TOGETHER, session, others={"alone": alone(tmp_path)}).outcome
        is outcome
    )


def test_a_rate_by_a_clock_that_was_set_is_compared_with_none(tmp_path: Path) -> None:
    """The publisher's rate alone is unknown if the clock was set meanwhile."""
    times = evenly(100, 3.0)
    for name, step_s, outcome in (("set", 0.5, Outcome.PASSED), ("even", 0.0, Outcome.PARTIAL)):
        other = (
            Session(tmp_path / name, "alone")
            .messages("/commands", [[0.0]] * len(times), times)
            .window(0.9, 4.1)
        )
        others = {"alone": other.clock({1.0: 0.0, 2.0: step_s}).recorded()}
        session = together(tmp_path / name, rate_hz=60)
        assert judged("launch_together", TOGETHER, session, others=others).outcome is outcome


# -- a node that ends by itself --------------------------------------------------------------------

CRASHED = [
    "Traceback (most recent call last):",
    '  File "/ws/src/it.py", line 9, in tick',
    "ZeroDivisionError: by zero",
]
FELL: dict[str, Any] = {"interrupted_ns": None, "ended_by": "itself", "exit_status": 1}


@pytest.mark.parametrize(
    ("alone_line", "charged", "credit"),
    [(9, True, "1"), (12, True, "0.5"), (9, False, "0.5"), (None, True, "0.5")],
    ids=["the same end, charged", "another end", "charged nowhere", "it went on alone"],
)
def test_the_same_end_as_alone_is_charged_once(
    tmp_path: Path, alone_line: int | None, charged: bool, credit: str
) -> None:
    """A node that ends of the same line as in its own session costs nothing more, if a check there charged it."""
    alone = Session(tmp_path, "alone")
    if alone_line:
        lines = [CRASHED[0], CRASHED[1].replace("9", str(alone_line)), CRASHED[2]]
    else:
        lines = []
    alone.process("it", lines, **(FELL if alone_line else {}))
    session = planned(Session(tmp_path), processes=BOTH).node("/talker").node("/listener")
    session.process("talk-1", CRASHED, artifact=None, **FELL)
    if charged:
        rate = failed(
            "", "", "", where=[Location(file="it.py", line=alone_line), Location(session="alone")]
        )
    else:
        rate = passed("", "")
    findings = {"talk.rate": rate, "talk.publishes": passed("", "")}
    finding = judged(
        "launch_nodes", NODES, session, findings=findings, others={"alone": alone.recorded()}
    )
    assert finding.credit == Decimal(credit)
    assert ("charged under 'talk.rate'" in finding.reason) == (credit == "1")


def two_programs(talker: str = "", listener: str = "") -> Any:
    """Give a submission with a file for each node, and nodes that start them."""
    record = submission(
        {"talk.py": talker, "listen.py": listener}, talk="talk.py", listen="listen.py"
    )
    wanted = [{**each, "artifact": each["executable"]} for each in NODES["nodes"]]
    return record, {**NODES, "nodes": wanted}


def test_another_program_under_the_name_of_a_node_earns_nothing(tmp_path: Path) -> None:
    """A node's name in the graph proves nothing of its program, which the executable tells."""
    record, wanted = two_programs()
    twice = [BOTH[0], {**entry("talk", "listener", file="talk.py", line=9), "id": "talk-2"}]
    session = planned(Session(tmp_path), processes=twice).node("/talker").node("/listener")
    finding = judged("launch_nodes", wanted, session, record)
    assert finding.credit == Decimal("0.5")
    assert finding.reason == "/listener runs talk.py, not listen.py."
    assert finding.hint == "Give this Node the executable of listen.py: executable='listen'."
    assert finding.where[0].line == 9
    both = two_programs(talker='name = "listener"')[0]
    assert judged("launch_nodes", wanted, session.recorded(), both).outcome is Outcome.PASSED


def test_an_unnamed_node_that_ended_is_found_by_its_source(tmp_path: Path) -> None:
    """Without a name in the launch file, the file that names the node is the one that runs it."""
    record, wanted = two_programs(talker="super().__init__('talker')")
    unnamed = [entry("talk", None), BOTH[1]]
    session = planned(Session(tmp_path), processes=unnamed).node("/talker").node("/listener")
    session.process("talk-1", CRASHED, artifact=None, exited_ns=at(1.6), **FELL)
    finding = judged("launch_nodes", wanted, session, record)
    assert finding.measured == "/talker (ended), /listener"


def test_a_node_with_another_fault_alone_is_not_said_to_have_the_same(tmp_path: Path) -> None:
    """The fault of the launch file costs nothing beside it, and the sentence keeps the two apart."""
    alone = Session(tmp_path, "alone")
    alone.process("it", [CRASHED[0], CRASHED[1].replace("9", "12"), CRASHED[2]], **FELL)
    session = planned(Session(tmp_path), processes=BOTH).node("/talker").node("/listener")
    session.process("talk-1", CRASHED, artifact=None, **FELL)
    findings = {"talk.publishes": FAILED}
    finding = judged(
        "launch_nodes", NODES, session, findings=findings, others={"alone": alone.recorded()}
    )
    assert (finding.outcome, finding.credit) == (Outcome.EXCUSED, Decimal(1))
    assert "by another fault, which is charged under 'talk.publishes'" in finding.reason
    assert "This mistake" not in finding.reason


def test_an_end_is_charged_by_the_check_that_points_at_its_line(tmp_path: Path) -> None:
    """An earlier check of the same session can have another cause."""
    alone = Session(tmp_path, "alone")
    alone.process("it", CRASHED, **FELL)
    session = planned(Session(tmp_path), processes=BOTH).node("/talker").node("/listener")
    session.process("talk-1", CRASHED, artifact=None, **FELL)
    other = failed("", "", "", where=[Location(session="alone")])
    here = failed("", "", "", where=[Location(file="it.py", line=9), Location(session="alone")])
    findings = {"talk.mean": other, "talk.survives": here}
    finding = judged(
        "launch_nodes", NODES, session, findings=findings, others={"alone": alone.recorded()}
    )
    assert "charged under 'talk.survives'" in finding.reason


def test_a_parameter_of_a_node_that_other_arguments_leave_out_is_not_charged(
    tmp_path: Path,
) -> None:
    """The check of the nodes charges it; a plan with a problem leaves nothing to judge by."""
    session = planned(
        Session(tmp_path),
        processes=[entry("talk", "talker", parameters=[{"name": "rate", "value": 100.0}])],
    )
    planned(session, "other", processes=[])
    finding = judged("launch_parameters", PARAMETERS, session)
    assert finding.outcome is Outcome.PASSED


def test_nodes_that_did_not_stay_are_shown_so(tmp_path: Path) -> None:
    """The measurement shows a node that ended apart from a node that stayed."""
    session = planned(Session(tmp_path), processes=BOTH).node("/talker").node("/listener")
    finding = nodes(session.process("talk-1", CRASHED, artifact=None, exited_ns=at(1.6), **FELL))
    assert finding.expected == "/talker, /listener"
    assert finding.measured == "/talker (ended), /listener"


def test_a_parameter_that_is_not_wired_is_measured_otherwise_than_expected(tmp_path: Path) -> None:
    """A finding that loses points never shows the same text under Expected and Measured."""
    finding = parameter(tmp_path, 100.0, 100.0)
    assert finding.outcome is Outcome.PARTIAL
    assert finding.measured != finding.expected


# -- several nodes in one process ------------------------------------------------------------------

TOGETHER_IN = {
    **{part: {**TOGETHER[part], "node": "/talker"} for part in ("commands", "follows")},
    "answers": {**TOGETHER["answers"], "node": "/listener"},
}


def in_one_process(folder: Path, ends: bool = False) -> Session:
    """Make a session with both nodes in one process without a name in the launch file."""
    session = (
        planned(together(folder), processes=[entry("arm", None)]).node("/talker").node("/listener")
    )
    session.record.plan = session.record.steps[-1].result["plan"]
    if ends:
        return session.process("arm-1", CRASHED, artifact=None, **FELL)
    return session.process("arm-1")


def test_parameters_of_a_process_reach_all_its_nodes(tmp_path: Path) -> None:
    """Parameters of a process without a name apply to each of its nodes."""
    session = Session(tmp_path).node("/talker")
    for label, rate in (("plan", 100.0), ("other", 50.0)):
        planned(
            session,
            label,
            processes=[entry("arm", None, parameters=[{"name": "rate", "value": rate}])],
        )
    assert judged("launch_parameters", PARAMETERS, session).outcome is Outcome.PASSED


def test_the_fault_of_one_node_is_the_end_of_others_in_its_process(tmp_path: Path) -> None:
    """The fault costs points at its own node, and nowhere else."""
    session = in_one_process(tmp_path, ends=True)
    finding = nodes(session, listen_receives=FAILED)
    assert (finding.outcome, finding.credit) == (Outcome.EXCUSED, Decimal(1))
    finding = judged("launch_together", TOGETHER_IN, session, findings={"enables": FAILED})
    assert finding.credit == Decimal(1)
    assert nodes(session.recorded(), listen_receives=passed("", "")).outcome is Outcome.FAILED  # type: ignore[arg-type]


def test_what_a_node_keeps_others_of_its_process_from_is_charged_once(tmp_path: Path) -> None:
    """A callback that never returns holds up the timers of its executor too."""
    session = in_one_process(tmp_path)
    session.record.steps = [step for step in session.record.steps if step.label != "enable"]
    assert judged("launch_together", TOGETHER_IN, session).outcome is Outcome.PARTIAL
    assert (
        judged("launch_together", TOGETHER_IN, session, findings={"motion": FAILED}).outcome
        is Outcome.EXCUSED
    )


@pytest.mark.parametrize(
    ("charged", "alone_ends", "credit"),
    [(FAILED, False, "1"), (passed("", ""), False, "0.5"), (FAILED, True, "0.5")],
    ids=["what it hears is charged", "what it hears is right", "it ends alone too"],
)
def test_an_exception_by_what_a_node_hears_is_charged_with_that(
    tmp_path: Path, charged: Finding, alone_ends: bool, credit: str
) -> None:
    """Six numbers for seven joints cost their points once, though a subscriber to them ends by them."""
    alone = Session(tmp_path, "alone").process("it", CRASHED, **(FELL if alone_ends else {}))
    session = planned(Session(tmp_path), processes=BOTH).node("/talker").node("/listener")
    session.process("listen-1", CRASHED, artifact=None, **FELL)
    wanted = {
        **NODES,
        "nodes": [NODES["nodes"][0], {**NODES["nodes"][1], "hears_charged_by": "talk.values"}],
    }
    findings = {
        "talk.values": charged,
        "talk.publishes": passed("", ""),
        "listen.receives": passed("", ""),
    }
    finding = judged(
        "launch_nodes", wanted, session, findings=findings, others={"alone": alone.recorded()}
    )
    assert finding.credit == Decimal(credit)
