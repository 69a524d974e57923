"""Plans are values: read from untrusted plain data, and asked for their processes."""

from __future__ import annotations

import json
import math
from dataclasses import fields
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from launch_plan.format import SCHEMA
from launch_plan.plan import MalformedPlanError, Parameter, Plan, Process
from tests.counted import calls_of

WORDS = [
    "id",
    "path",
    "name",
    "value",
    "type",
    "file",
    "content",
    "after_s",
    "on_exit_of",
    "package",
    "parameters",
]


def plain(**more: Any) -> dict[str, Any]:
    """A plan as plain data."""
    return {"schema": SCHEMA, "outcome": "ok", **more}


def test_a_minimal_plan_is_read() -> None:
    """A plan with nothing but its schema and outcome has no processes."""
    plan = Plan.from_plain(plain())
    assert plan.outcome == "ok"
    assert plan.processes == ()


def test_a_plan_is_ready_for_json() -> None:
    """The plain data of `to_plain` survive JSON and give the same plan."""
    process = {
        "id": "a-1",
        "path": "/a",
        "argv": ["-x"],
        "remappings": [["a", "b"]],
        "when": {"after_s": 1.0},
    }
    plan = Plan.from_plain(plain(processes=[process], arguments=[{"name": "n", "choices": ["x"]}]))
    assert Plan.from_plain(json.loads(json.dumps(plan.to_plain()))) == plan
    assert plan.processes[0].remappings == (("a", "b"),)


def test_keys_of_a_later_version_are_ignored() -> None:
    """A key that is not known does no harm."""
    assert (
        Plan.from_plain(plain(later=1, problem={"kind": "k", "message": "m", "later": 2})).problem
        is not None
    )


@pytest.mark.parametrize(
    "data",
    [
        None,
        [],
        {},
        {"schema": "other", "outcome": "ok"},
        plain(outcome="fine"),
        plain(processes=1),
        plain(processes=[1]),
        plain(processes=[{}]),
        plain(processes=[{"id": "a", "path": "b", "remappings": [1]}]),
        plain(processes=[{"id": "a", "path": "b", "env": 1}]),
        plain(arguments=[{}]),
        plain(problem=1),
    ],
)
def test_what_is_no_plan_is_refused(data: Any) -> None:
    """Data that is not a plan raises one kind of error, whatever is wrong with it."""
    with pytest.raises(MalformedPlanError):
        Plan.from_plain(data)


def test_the_command_has_its_parameter_files_where_the_runner_put_them() -> None:
    """The placeholder in argv becomes the runner's folder, and the prefix comes first."""
    process = Process("a-1", "/a", prefix=("nice",), argv=("--params-file", "{parameters}/x.yaml"))
    assert process.command("/run") == ["nice", "/a", "--params-file", "/run/x.yaml"]


@pytest.mark.parametrize(
    ("namespace", "expected"), [(None, "/t"), ("/", "/t"), ("/n", "/n/t"), ("/n/m", "/n/m/t")]
)
def test_the_full_name_has_the_namespace(namespace: str | None, expected: str) -> None:
    """A node's full name is its namespace and its name, parted by one slash."""
    assert Process("a-1", "/a", name="t", namespace=namespace).full_name == expected


def test_the_first_rule_for_a_name_counts() -> None:
    """A rule among the launch file's own arguments comes before those that `launch` adds, and wins as in `rcl`."""
    words = (
        "--ros-args",
        "-r",
        "__node:=first",
        "-r",
        "__ns:=/x",
        "--ros-args",
        "-r",
        "__node:=t",
        "-r",
        "__ns:=/a",
    )
    process = Process("a-1", "/a", name="t", namespace="/a", argv=words)
    assert process.called == "first"
    assert process.full_name == "/x/first"


def test_a_rule_names_a_node_that_has_no_other_name() -> None:
    """A node that only the arguments name has that name, in the root where no namespace is given."""
    assert Process("a-1", "/a", argv=("--ros-args", "-r", "__node:=t")).full_name == "/t"
    assert Process("a-1", "/a", argv=("--ros-args",)).full_name is None


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ({"/**": {"ros__parameters": {"a": 1}}}, {"a": 1}),
        ({"t": {"ros__parameters": {"a": 1}}}, {"a": 1}),
        ({"/n": {"t": {"ros__parameters": {"a": 1}}}}, {}),
        ({"/*": {"ros__parameters": {"a": {"b": 1}}}}, {"a.b": 1}),
        ({"u": {"ros__parameters": {"a": 1}}}, {}),
        ({"t": {"ros__parameters": {"a": 2}}, "/**": {"ros__parameters": {"a": 1}}}, {"a": 1}),
        ({"/**": {"ros__parameters": {"a": 1}}, "t": {"ros__parameters": {"a": 2}}}, {"a": 2}),
        (None, {}),
    ],
)
def test_the_sections_of_a_file_that_match_count(content: Any, expected: dict[str, Any]) -> None:
    """Wildcards match, a later section overrides an earlier one, and other nodes' sections do not count."""
    process = Process("a-1", "/a", name="t", parameters=(Parameter(file="f", content=content),))
    assert process.effective_parameters() == expected


def test_the_last_value_counts() -> None:
    """A parameter given twice has the later value."""
    given = (Parameter("a", 1, "integer"), Parameter("a", 2, "integer"))
    assert Process("a-1", "/a", parameters=given).effective_parameters() == {"a": 2}


def process_with_parameters(section: str, namespace: str) -> Process:
    """A process of a node in a namespace, with a parameter file that has one section."""
    content = {section: {"ros__parameters": {"x": 1}}}
    return Process(
        "a-1",
        "/a",
        name="n",
        namespace=namespace,
        parameters=(Parameter(file="f", content=content),),
    )


@pytest.mark.parametrize(
    ("section", "namespace", "fits"),
    [
        ("/**", "/a/b", True),
        ("/**/n", "/a/b", True),
        ("/*/b/n", "/a/b", True),
        ("/**/**/b/**/n", "/a/b", True),
        ("/*/n", "/a/b", False),
        ("/**/c/n", "/a/b", False),
        ("/*/*/*/*", "/a/b", False),
    ],
)
def test_wildcards_stand_for_names(section: str, namespace: str, fits: bool) -> None:
    """One star stands for a name, two for any number of them, also for none."""
    assert process_with_parameters(section, namespace).effective_parameters() == (
        {"x": 1} if fits else {}
    )


def test_wildcards_are_tried_in_few_steps() -> None:
    """Forty wildcards and forty names have more ways to fit than there is time for, and all are ruled out soon."""
    process = process_with_parameters("/**" * 40 + "/nobody", "/a" * 40)
    assert calls_of(process.effective_parameters) < 100_000
    assert process.effective_parameters() == {}


def test_patterns_apply_in_the_order_of_their_first_appearance() -> None:
    """A repeated pattern keeps its place, and `t` is another pattern than `/t`, as measured with `rcl`."""
    files = [
        {"/t": {"a": 1, "b": 1}, "/**": {"a": 2}},
        {"/*": {"c": 4}, "t": {"b": 9, "c": 5}},
        {"/**": {"b": 7}},
    ]
    given = tuple(
        Parameter(
            file=str(n),
            content={pattern: {"ros__parameters": values} for pattern, values in file.items()},
        )
        for n, file in enumerate(files)
    )
    assert Process("a-1", "/a", name="t", parameters=given).effective_parameters() == {
        "a": 2,
        "b": 9,
        "c": 5,
    }


@pytest.mark.parametrize("value", [10**18, -(10**12), math.inf, [1.0, -math.inf]])
def test_a_parameter_may_have_any_number(value: Any) -> None:
    """Large integers and infinite doubles survive JSON, which is written without words of its own."""
    plan = Plan(
        "ok", processes=(Process("a-1", "/a", parameters=(Parameter("x", value, "double"),)),)
    )
    read = Plan.from_plain(json.loads(json.dumps(plan.to_plain(), allow_nan=False)))
    assert read.processes[0].effective_parameters() == {"x": value}


def nested(depth: int) -> Any:
    """Lists within lists."""
    value: Any = "x"
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize(
    "data",
    [
        plain(processes=[{"id": f"a-{n}", "path": "/a"} for n in range(401)]),
        plain(parameter_files={f"{n}.yaml": "" for n in range(2001)}),
        plain(logs=[{"message": "m", "when": {"after_s": nested(100)}}]),
        plain(arguments=[{"name": "a", "line": 10**400}]),
        plain(problem={"kind": "k", "message": "m", "line": -(10**12)}),
    ],
    ids=["processes", "files", "depth", "line", "negative line"],
)
def test_what_no_evaluation_gives_is_no_plan(data: dict[str, Any]) -> None:
    """More processes or files than an evaluation notes, deep nesting and absurd numbers were written by others."""
    with pytest.raises(MalformedPlanError):
        Plan.from_plain(data)


def process(**more: Any) -> dict[str, Any]:
    """Give a plan of one process, with some fields of it."""
    return plain(processes=[{"id": "arm-1", "path": "/ws/arm", **more}])


MALFORMED = {
    "a working folder that climbs": process(cwd="/ws/src/../../etc"),
    "a working folder that climbs in the end": process(cwd="/ws/.."),
    "a working folder that is relative": process(cwd="../etc"),
    "a working folder that is empty": process(cwd=""),
    "a working folder of no text": process(cwd=["/ws"]),
    "a working folder with a NUL": process(cwd="/ws\0/etc"),
    "an endless working folder": process(cwd="/ws" * 5000),
    "a program with a NUL": process(path="/ws/a\0b"),
    "a word with a NUL": process(argv=["a\0b"]),
    "a variable with a NUL": process(env={"A": "a\0b"}),
    "a variable's name with a NUL": process(env={"A\0": "a"}),
    "variables within each other": process(env={"A": {"B": "c"}}),
    "words of no list": process(argv="abc"),
    "words that are none": process(argv=[1]),
    "words within each other": process(prefix=[["a"]]),
    "an endless name": process(name="n" * 5000),
    "an id of no text": process(id=7),
    "a file above": process(parameter_files={"..": "a"}),
    "a file elsewhere": process(parameter_files={"../../x": "a"}),
    "a file somewhere": process(parameter_files={"/etc/x": "a"}),
    "a file with a NUL": plain(parameter_files={"x\0y": "a"}),
    "a file of an endless name": plain(parameter_files={"ä" * 200: "a"}),
    "a file without a name": plain(parameter_files={"": "a"}),
    "a moment that never comes": process(when={"after_s": float("nan")}),
    "a moment beyond all": process(when={"after_s": 1e300}),
    "a moment of no number": process(when={"after_s": "soon"}),
    "a process of no name": process(when={"on_exit_of": ["arm-1"]}),
    "a delay that is no number": process(respawn_delay_s=float("nan")),
    "a delay without end": process(respawn_delay_s=float("inf")),
}


@pytest.mark.parametrize("what", MALFORMED)
def test_what_could_not_be_started_is_no_plan(what: str) -> None:
    """Paths that lead elsewhere, names that no system takes and moments that are none were written by others."""
    with pytest.raises(MalformedPlanError):
        Plan.from_plain(MALFORMED[what])


@pytest.mark.parametrize("cwd", [None, "/", "/ws/src", "/ws/a..b/..c", "/tmp/x y"])
def test_an_honest_working_folder_is_kept(cwd: str | None) -> None:
    """Any whole path without steps upwards may be one; so may large parameters be."""
    plan = Plan.from_plain(
        process(cwd=cwd, parameters=[{"name": "stamp", "value": 1_700_000_000_000_000_000}])
    )
    assert plan.processes[0].cwd == cwd


json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats()
    | st.text(max_size=12)
    | st.just("../../etc"),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(WORDS) | st.text(max_size=4), inner)
    ),
    max_leaves=12,
)


@given(
    st.dictionaries(st.sampled_from([f.name for f in fields(Process)]), json_values), json_values
)
def test_what_is_read_can_be_kept_and_read_again(some: dict[str, Any], when: Any) -> None:
    """Whatever stands in a plan, it is refused in one way, or is the same plan after it was kept as JSON."""
    try:
        plan = Plan.from_plain(process(**{**some, "when": when}))
    except MalformedPlanError:
        return
    kept = json.dumps(plan.to_plain())
    assert json.dumps(Plan.from_plain(json.loads(kept)).to_plain()) == kept
