"""Parameters that depend on an assumed argument are left to the node."""

from __future__ import annotations

from launch_plan.assumed import left_out, without_assumed_parameters
from launch_plan.plan import Parameter, Plan, Process

FILE = "/**:\n  ros__parameters:\n    a: {a}\n    b: 2\n"


def plan(value: str, *, alone: bool = False) -> Plan:
    """A plan with a file, a rule and a frame's name that depend on a value."""
    text = FILE.format(a=f"'{value}'")
    if alone:
        text = text.replace("    b: 2\n", "")
    process = Process(
        "talker-1",
        "/talker",
        argv=(
            *("--frame", value, "--ros-args", "--params-file", "{parameters}/talker_1.yaml"),
            *("-p", f"c:={value}", "-p", "d:=1", "-r", f"x:={value}"),
        ),
        parameters=(
            Parameter("a", value, "string"),
            Parameter("b", 2, "integer"),
            Parameter("c", value, "string", wildcard=True),
        ),
        parameter_files={"talker_1.yaml": text},
    )
    return Plan("ok", processes=(process,))


def test_parameters_that_depend_on_it_are_left_out() -> None:
    """The values of files and rules that differ are gone, and all else stays."""
    without = without_assumed_parameters(plan(""), plan("other"))
    assert left_out(plan(""), without) == {"talker-1": ["a", "c"]}
    (process,) = without.processes
    assert [parameter.name for parameter in process.parameters] == ["b"]
    assert process.parameter_files == {"talker_1.yaml": "/**:\n  ros__parameters:\n    b: 2\n"}
    assert process.argv == (
        *("--frame", "", "--ros-args", "--params-file", "{parameters}/talker_1.yaml"),
        *("-p", "d:=1", "-r", "x:="),
    )


def test_a_file_without_values_is_not_given() -> None:
    """`rcl` refuses a file without parameters."""
    without = without_assumed_parameters(plan("", alone=True), plan("other", alone=True))
    assert "--params-file" not in without.processes[0].argv


def test_a_process_that_the_twin_lacks_stays() -> None:
    """Nothing is known of a process that starts only with one of the values."""
    assert without_assumed_parameters(plan("1"), Plan("ok")) == plan("1")
