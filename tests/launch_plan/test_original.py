"""The stand-in beside the original: the real `launch` 3.4.3 and `launch_ros` 0.26.6 of Jazzy, evaluated natively."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))

from tests.launch_plan import test_conformance as conformance  # noqa: E402
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

pytestmark = [pytest.mark.slow, needs_the_original]

#: Cases of later patch releases of Jazzy; the copy, of 3.4.3, gives an error or another plan.
LATER_PATCHES = {
    "the folder is restored after an include",
    "an autostart is at the line of its node",
    "autostart configures and activates",
    "a lifecycle node in XML",
    "a part of a path may be a list",
    "a slash joins paths",
    "a slash behind a package's share folder",
    "a slash behind the folder of the file",
    "a pathlib path where text can stand",
    "an include by a pathlib path",
    "XML: boolean substitutions",
    "XML: an include with arguments by arg and by let",
    "LaunchIntrospector and the logging of launch can be imported",
}
#: Cases that the grader answers in its own way, so that a student is charged for no other's absence.
OWN_ANSWERS = {
    "the path of ros2, which is not here",
    "a launch from inside the file",
    "XML: an action of which it is not known since when it is there",
    "an anonymous name stays the same",
    "an anonymous name is another one after its scope",
}
COMPARED = [case for case in conformance.CASES if case.name not in LATER_PATCHES | OWN_ANSWERS]
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


# In parts, each in one test: an evaluation is quick, and to begin an interpreter is not.
@pytest.mark.parametrize("part", range(4))
def test_the_cases_are_as_in_the_original(part: int, tmp_path: Path) -> None:
    """Stand-in and original start the same processes with the same parameters, or both refuse the file."""
    cases = COMPARED[part::4]
    requests = []
    for number, case in enumerate(cases):
        root = tmp_path / f"case_{number}"
        file = str(conformance.write(case, root))
        requests.append({"file": file, "arguments": dict(case.arguments), "root": str(root)})
    plans = both(requests, conformance.make_prefix(tmp_path))
    found = {
        c.name: difference(*pair, lines=c.filename.endswith(".py"))
        for c, pair in zip(cases, plans, strict=True)
    }
    assert {name: text for name, text in found.items() if text} == {}


def test_the_fixtures_are_as_in_the_original(tmp_path: Path) -> None:
    """The launch file of each fixture has the same plan, or the same kind of outcome."""
    names = ("joint_publisher", "joint_subscriber", "robot_service")
    prefix = make_package(tmp_path / "prefix", "physical_ai_textbook", *names)
    requests = [
        {"file": str(ROOT / f), "arguments": {}, "root": str((ROOT / f).parent)} for f in FIXTURES
    ]
    plans = both(requests, prefix)
    found = {
        str(f): difference(*pair, lines=f.suffix == ".py")
        for f, pair in zip(FIXTURES, plans, strict=True)
    }
    assert len(found) > 20
    assert {name: text for name, text in found.items() if text} == {}


# The names that each module defines, exports, or holds as its sub-modules.
_NAMES = """
import importlib, json, pkgutil, types
found = {}
for top in ("launch", "launch_ros", "launch_xml", "launch_yaml"):
    below = pkgutil.walk_packages(importlib.import_module(top).__path__, top + ".")
    for title in [top, *(info.name for info in below if "conftest" not in info.name)]:
        module = importlib.import_module(title)
        found[title] = sorted(
            name
            for name, value in vars(module).items()
            if not name.startswith("_")
            and (
                getattr(value, "__module__", None) == title
                or (isinstance(value, types.ModuleType) and value.__name__ == title + "." + name)
                or name in getattr(module, "__all__", ())
            )
        )
print(json.dumps(found))
"""
# Prints the names that an import statement does not find.
_UNKNOWN = """
import json, sys
unknown = []
for title, names in json.load(sys.stdin).items():
    for name in names or ["__name__"]:
        try:
            exec(f"from {title} import {name}", {})
        except ImportError:
            unknown.append(f"{title}.{name}")
print(json.dumps(unknown))
"""
# Prints the names that do nothing, although a module of the stand-in defines them.
_IDLE = """
import json, sys
found = {}
for title, names in json.load(sys.stdin).items():
    for name in names:
        exec(f"from {title} import {name} as found_name", found)
        found[f"{title}.{name}"] = found.pop("found_name")
defined = {
    name for title, module in list(sys.modules.items()) if title.startswith("launch")
    for name, value in vars(module).items() if getattr(value, "__module__", None) == title
}
is_idle = lambda value: type(value).__name__ == "_Unevaluated"
print(json.dumps([n for n, value in found.items() if is_idle(value) and n.rpartition(".")[2] in defined]))
"""


def _ask(program: str, path: Path, surroundings: dict[str, str], given: str = "") -> Any:
    done = subprocess.run(
        [sys.executable, "-c", program],
        input=given,
        capture_output=True,
        text=True,
        env=surroundings | {"PYTHONPATH": str(path)},
        timeout=60,
        check=True,
    )
    return json.loads(done.stdout)


def test_every_public_name_of_the_original_can_be_imported(tmp_path: Path) -> None:
    """Each name that a module of the original defines or exports is known to the stand-in, in the same module."""
    names = _ask(_NAMES, ORIGINAL, original_environment(tmp_path))
    assert sum(map(len, names.values())) > 400
    assert _ask(_UNKNOWN, STANDIN, environment(tmp_path), json.dumps(names)) == []
    assert _ask(_IDLE, STANDIN, environment(tmp_path), json.dumps(names)) == []


def test_what_is_no_name_of_the_original_cannot_be_imported(tmp_path: Path) -> None:
    """An import of a name that no module of the original has fails, in a sub-module too."""
    wrong = {
        "launch.actions.timer_action": ["Timer"],
        "launch.actions": ["ForEach"],
        "launch.condition": ["When"],
    }
    expected = [f"{title}.{name}" for title, names in wrong.items() for name in names]
    assert _ask(_UNKNOWN, STANDIN, environment(tmp_path), json.dumps(wrong)) == expected
