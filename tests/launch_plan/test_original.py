"""The stand-in beside the original: the real `launch` 3.4.3 and `launch_ros` 0.26.6 of Jazzy, evaluated natively."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))

from launch_plan import jazzy  # noqa: E402
from tests.launch_plan import original_names  # noqa: E402
from tests.launch_plan import test_conformance as conformance  # noqa: E402
from tests.launch_plan.case_files import CASES, Case  # noqa: E402
from tests.launch_plan.evaluations import (  # noqa: E402
    ORIGINAL,
    STANDIN,
    environment,
    make_package,
    needs_the_original,
    original_environment,
    plans_of,
)
from tests.launch_plan.outline import outline  # noqa: E402
from tests.thorough import part  # noqa: E402

pytestmark = [pytest.mark.slow, needs_the_original]

COMPARED = [case for case in CASES if case.is_compared]
FIXTURES = sorted(
    path.relative_to(ROOT)
    for folder in ("fixtures", "submissions", "reference", "labs")
    for path in (ROOT / folder).rglob("*launch*")
    if path.suffix in (".py", ".xml", ".yaml", ".yml") and path.is_file()
)


def both(
    requests: list[dict[str, Any]], prefix: Path
) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """The plans of the stand-in and of the original."""
    ours = plans_of(requests, environment(prefix))
    theirs = plans_of(requests, original_environment(prefix), path=ORIGINAL, native=True)
    return list(zip(ours, theirs, strict=True))


def difference(ours: dict[str, Any], theirs: dict[str, Any], *, lines: bool) -> str:
    """Say how two plans of one file differ; empty if outcome and started processes are equal."""
    outcome, original = ours.get("outcome"), theirs.get("outcome")  # none where the evaluation died
    if outcome != original:
        return f"{outcome} ({ours.get('problem')}), originally {original} ({theirs.get('problem')})"
    if outcome != "ok":
        return ""
    found, expected = outline(ours, lines=lines), outline(theirs, lines=lines)
    return "; ".join(
        f"{key}: {found[key]}, originally {expected[key]}"
        for key in found
        if found[key] != expected[key]
    )


def _is_python(case: Case) -> bool:
    """Tell whether all launch files of a case are in Python, so that the original knows the lines."""
    return all(
        name.endswith(".py") or "launch" not in name for name in [case.filename, *case.files]
    )


# In quarters, each in one test: an evaluation is quick, and to begin an interpreter is not. Every run compares one.
@pytest.mark.parametrize("quarter", part(range(4), 4))
def test_the_cases_are_as_in_the_original(quarter: int, tmp_path: Path) -> None:
    """Stand-in and original start the same processes with the same parameters, or both refuse the file."""
    cases = COMPARED[quarter::4]
    requests = []
    for number, case in enumerate(cases):
        root = tmp_path / f"case_{number}"
        file = str(conformance.write(case, root))
        requests.append({"file": file, "arguments": dict(case.arguments), "root": str(root)})
    plans = both(requests, conformance.make_prefix(tmp_path))
    found = {}
    for c, pair in zip(cases, plans, strict=True):
        found[c.name] = difference(*pair, lines=_is_python(c))
    assert {name: text for name, text in found.items() if text} == {}


def test_the_fixtures_are_as_in_the_original(tmp_path: Path) -> None:
    """The launch file of each fixture has the same plan, or the same kind of outcome."""
    names = ("joint_publisher", "joint_subscriber", "robot_service")
    prefix = make_package(tmp_path / "prefix", "physical_ai_textbook", *names)
    requests = []
    for f in FIXTURES:
        requests.append({"file": str(ROOT / f), "arguments": {}, "root": str((ROOT / f).parent)})
    plans = both(requests, prefix)
    found = {
        str(f): difference(*pair, lines=f.suffix == ".py")
        for f, pair in zip(FIXTURES, plans, strict=True)
    }
    assert len(found) > 20
    assert {name: text for name, text in found.items() if text} == {}


# The names among some that an import from each module finds, those that its `*` brings, and those in its namespace.
_OFFERED = """
import importlib, json, sys
asked = json.load(sys.stdin)
found = {"imported": {}, "starred": {}, "listed": {}}
for title, names in asked.items():
    found["imported"][title] = []
    for name in names:
        try:
            exec(f"from {title} import {name}", {})
        except ImportError:
            continue
        found["imported"][title].append(name)
    brought = {}
    try:
        exec(f"from {title} import *", brought)
    except ImportError:
        continue
    except AttributeError:
        brought = {"its list is wrong": None}
    found["starred"][title] = sorted(name for name in brought if not name.startswith("__"))
    there = vars(sys.modules[title])
    found["listed"][title] = sorted(name for name in there if not name.startswith("_"))
print(json.dumps(found))
"""
# Names of modules that do nothing, although a module of the stand-in defines them.
_IDLE = """
import json, sys
from launch import _catalogue
found = {}
for title, names in json.load(sys.stdin).items():
    for name in names:
        exec(f"from {title} import {name} as found_name", found)
        found[f"{title}.{name}"] = found.pop("found_name")
defined = {
    name for title, module in _catalogue._implemented.items()
    for name, value in vars(module).items() if getattr(value, "__module__", None) == title
}
is_idle = lambda value: type(value).__name__ == "_Unevaluated"
print(json.dumps([n for n, value in found.items() if is_idle(value) and n.rpartition(".")[2] in defined]))
"""
#: Modules with a missing name in their list of exports, so that an import of `*` fails.
WRONG_LISTS = {"launch_ros.utilities"}
#: A module with the names of another one of Python, which the stand-in does not have.
HANDLERS = "launch.logging.handlers"


def _ask(program: str, path: Path, surroundings: dict[str, str], given: str = "") -> Any:
    done = subprocess.run(
        [sys.executable, *program_arguments(program)],
        input=given,
        capture_output=True,
        text=True,
        env=surroundings | {"PYTHONPATH": str(path)},
        timeout=60,
        check=True,
    )
    return json.loads(done.stdout)


def program_arguments(program: str) -> list[str]:
    """Return the words behind `python` for a file with its arguments, or for a text."""
    if program.startswith("/"):
        return program.split()
    return ["-c", program]


@pytest.fixture(scope="module")
def public_names(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, list[str]]]:
    """Return the names in all modules of the original, by section of `jazzy_modules.ini`."""
    surroundings = original_environment(tmp_path_factory.mktemp("names"))
    found: dict[str, dict[str, list[str]]]
    found = _ask(f"{Path(original_names.__file__)} --json", ORIGINAL, surroundings)
    return found


def test_the_names_of_the_original_are_listed(
    public_names: dict[str, dict[str, list[str]]],
) -> None:
    """`jazzy_modules.ini` has the names in all modules of the original."""
    listed = (ROOT / "launch_plan/jazzy_modules.ini").read_text()
    assert original_names.as_text(public_names) == listed


def test_each_module_offers_the_names_of_the_original(
    public_names: dict[str, dict[str, list[str]]], tmp_path: Path
) -> None:
    """Any name is found in a module of the stand-in exactly if the original has it there."""
    titles = [title for title in public_names["names"] if title != HANDLERS]
    known = {title.rpartition(".")[2] for title in titles}
    for section in ("names", "foreign"):
        for names in public_names[section].values():
            known |= set(names)
    inner = _names_in_the_stand_in()
    asked = json.dumps(dict.fromkeys(titles, sorted(known | inner)))
    theirs = _ask(_OFFERED, ORIGINAL, original_environment(tmp_path), asked)
    ours = _ask(_OFFERED, STANDIN, environment(tmp_path), asked)
    patches = jazzy._words("patches")
    differing = {}
    for title in titles:
        later = {*patches.get(title, ()), *jazzy.SUBMODULES.get(title, ())}
        found = set(ours["imported"][title]) - later
        expected = set(theirs["imported"][title]) - later
        if found != expected:
            differing[title] = sorted(found ^ expected)
        elif title not in WRONG_LISTS:
            brought = set(ours["starred"][title]) ^ set(theirs["starred"][title])
            if brought - later:
                differing[f"{title} *"] = sorted(brought - later)
        assert set(ours["listed"][title]) <= {*theirs["listed"][title], *later}, title
    assert differing == {}


def _names_in_the_stand_in() -> set[str]:
    """Return all names at the top of modules of the stand-in, those that it imports for itself included."""
    names: set[str] = set()
    for path in STANDIN.rglob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                names |= {(alias.asname or alias.name).split(".")[0] for alias in node.names}
            elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                names.add(node.name)
    return {name for name in names if not name.startswith("_") and name != "*"}


def test_names_that_the_stand_in_evaluates_are_its_own(
    public_names: dict[str, dict[str, list[str]]], tmp_path: Path
) -> None:
    """No name does nothing where a module of the stand-in defines it."""
    assert sum(map(len, public_names["names"].values())) > 400
    asked = json.dumps(public_names["names"])
    assert _ask(_IDLE, STANDIN, environment(tmp_path), asked) == []
