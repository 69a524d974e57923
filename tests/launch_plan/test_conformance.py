"""The stand-in for `launch` and `launch_ros` gives each launch file the plan that ROS 2 Jazzy would."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from launch_plan.plan import Plan

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))

from tests.launch_plan.case_files import CASES, Case  # noqa: E402
from tests.launch_plan.evaluations import INSIDE, environment, make_package, plans_of  # noqa: E402


def make_prefix(folder: Path) -> Path:
    """An ament prefix with the packages that the cases speak of."""
    prefix = make_package(
        folder / "prefix", "demo", "talker", "listener", "talker.py", "not_executable"
    )
    return make_package(prefix, "empty")


def write(case: Case, folder: Path) -> Path:
    """Write a case's launch file and its other files into a folder."""
    for name, text in {**case.files, case.filename: case.text}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder / case.filename


@pytest.fixture(scope="session")
def plans(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The plan of every case, by its name."""
    folder = tmp_path_factory.mktemp("launching")
    requests = []
    for number, case in enumerate(CASES):
        root = folder / f"case_{number}"
        requests.append(
            {"file": str(write(case, root)), "arguments": dict(case.arguments), "root": str(root)}
        )
    found = plans_of(requests, environment(make_prefix(folder)))
    return {case.name: plan for case, plan in zip(CASES, found, strict=True)}


def evaluate(file: Path, prefix: Path, **arguments: str) -> tuple[dict[str, Any], str]:
    """Return the plan of a file as the script gives it, and the file's own output."""
    read, write_end = os.pipe()
    request = {"file": str(file), "arguments": arguments, "root": str(file.parent)}
    done = subprocess.run(
        [sys.executable, str(INSIDE / "evaluate.py"), str(write_end)],
        input=json.dumps(request),
        capture_output=True,
        text=True,
        pass_fds=[write_end],
        env=environment(prefix),
        timeout=30,
        check=False,
    )
    os.close(write_end)
    with os.fdopen(read) as result:
        text = result.read()
    assert text, done.stderr
    return json.loads(text), done.stdout


def found(plan: Mapping[str, Any], path: str) -> Any:
    """Return the value at a path in a plan; `|` in a step is a full stop of the name itself."""
    if path.startswith("len "):
        return len(found(plan, path[4:]))
    if path.startswith("parameter "):
        _, process, name = path.split(" ")
        values = []
        for p in plan["processes"][int(process)]["parameters"]:
            if p.get("name") == name:
                values.append(p["value"])
        return values[-1] if values else f"no parameter {name}"
    if path.startswith("effective "):
        return Plan.from_plain(plan).processes[int(path[10:])].effective_parameters()
    value: Any = plan
    for step in path.split("."):
        if isinstance(value, list):
            value = value[int(step)]
        else:
            value = value[step.replace("|", ".")]
    return value


def mismatch(plan: Mapping[str, Any], path: str, expected: Any) -> str:
    """Say how a plan differs from the expected value at a path; empty if it does not differ."""
    where, _, way = path.partition(" ") if path.endswith((" has", " ends")) else (path, "", "")
    try:
        value = found(plan, where)
    except (KeyError, IndexError, TypeError) as error:
        return f"{path}: nothing there ({error!r})"
    if way == "has":
        same = expected in (
            json.dumps(value, ensure_ascii=False) if isinstance(value, dict) else value
        )
    elif way == "ends":
        same = str(value).endswith(expected)
    else:
        same = value == expected and isinstance(value, bool) == isinstance(expected, bool)
    if same:
        return ""
    return f"{path}: expected {expected!r}, found {value!r}"


def test_there_are_enough_cases() -> None:
    """At least 575 cases, each with a name of its own."""
    assert len(CASES) >= 575
    assert len({case.name for case in CASES}) == len(CASES)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_plan_is_as_documented(case: Case, plans: dict[str, Any]) -> None:
    """A launch file has the plan, or the problem, that its case expects."""
    plan = plans[case.name]
    wrong = []
    for path, expected in case.expect.items():
        if text := mismatch(plan, path, expected):
            wrong.append(text)
    assert not wrong, "\n".join(
        [*wrong, f"problem: {plan['problem']}", f"warnings: {plan['warnings']}"]
    )


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_plan_survives_the_round_trip(case: Case, plans: dict[str, Any]) -> None:
    """A plan read from plain data and written again says the same."""
    plan = Plan.from_plain(plans[case.name])
    assert Plan.from_plain(json.loads(json.dumps(plan.to_plain()))).to_plain() == plan.to_plain()


@pytest.mark.parametrize(
    "case", [c for c in CASES if c.expect["outcome"] == "error"], ids=lambda case: case.name
)
def test_a_problem_says_what_where_and_how(case: Case, plans: dict[str, Any]) -> None:
    """A problem names the student's file and has a message and a remedy that do not speak of the grader."""
    problem = plans[case.name]["problem"]
    assert problem["message"]
    assert problem["remedy"]
    assert not problem["file"].startswith("/")
    assert "standin" not in json.dumps(problem)


def test_the_script_writes_the_plan_apart_from_prints(tmp_path: Path) -> None:
    """The launch file's own output goes to standard output, and the plan to its own descriptor."""
    file = tmp_path / "x_launch.py"
    file.write_text(
        next(c.text for c in CASES if c.name == "what the file prints does not disturb")
    )
    plan, printed = evaluate(file, make_prefix(tmp_path))
    assert plan["outcome"] == "ok"
    assert printed == '{"outcome": 1}\n'


def test_the_neighbours_of_the_script_cannot_be_imported(tmp_path: Path) -> None:
    """A launch file that imports `plan` does not get the grader's module of that name."""
    file = tmp_path / "x_launch.py"
    file.write_text("import plan\n")
    result, _ = evaluate(file, make_prefix(tmp_path))
    assert result["problem"]["module"] == "plan"


def test_an_evaluation_is_quick(tmp_path: Path) -> None:
    """A file with ten nodes takes the CPU time of less than ten starts of Python; the best of three counts."""
    case = next(c for c in CASES if c.name == "each dict is a file, in order")
    nine = "*[talker(name=f'n{n}', parameters=[{'a': n}]) for n in range(9)], "
    ten = case.text.replace("talker(name='t'", f"{nine}talker(name='t'")
    file, prefix = write(replace(case, text=ten), tmp_path), make_prefix(tmp_path)
    took_s, starts_s = [], []
    for _ in range(3):
        before_s = cpu_of_children_s()
        plan, _printed = evaluate(file, prefix)
        took_s.append(cpu_of_children_s() - before_s)
        assert len(plan["processes"]) == 10
        before_s = cpu_of_children_s()
        subprocess.run([sys.executable, "-I", "-c", ""], check=True)
        starts_s.append(cpu_of_children_s() - before_s)
    assert min(took_s) < 10 * min(starts_s)


def cpu_of_children_s() -> float:
    """Return the CPU time of all ended children, in s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
