"""Modules and programs in the working folder, which may be a student's repository, are run by no helper process."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))

from tests.launch_plan.evaluations import ORIGINAL, needs_the_original  # noqa: E402
from tests.live.small_lab import TALKER, TEXT, make_lab, published  # noqa: E402

pytestmark = pytest.mark.live

GRADE = str(Path(sys.executable).with_name("grade"))
#: Modules of the standard library, of Python's start, of ROS and of the grader's libraries.
MODULES = "json typing re os random sitecustomize usercustomize rclpy numpy yaml launch launch_ros grader mcap"
#: Programs that the grader starts.
PROGRAMS = "bwrap setpriv prlimit env sh unshare taskset chmod rm git cc gcc c++ ld python3"
TRAP = "import os\nwith open({mark!r}, 'a') as file:\n    file.write(f'{{__file__}}\\n')\n"
STEPS: list[dict[str, Any]] = [
    {"start": {"student": "talker"}},
    {"wait_for": {"publisher": "/chatter", "type": TEXT, "timeout_s": 20}},
    {"observe": {"duration_s": 0.3, "first_message_on": "/chatter", "timeout_s": 20}},
]


def lay_traps(folder: Path, mark: Path) -> None:
    """Lay out modules, packages and programs that each leave a mark, beside a student's files."""
    trap = TRAP.format(mark=str(mark))
    for name in MODULES.split():
        (folder / f"{name}.py").write_text(trap, encoding="utf-8")
    for name in ("launch", "concurrent", "xml"):
        (folder / name).mkdir(exist_ok=True)
        (folder / name / "__init__.py").write_text(trap, encoding="utf-8")
    for name in PROGRAMS.split():
        (folder / name).write_text(f"#!/bin/sh\necho {name} >>{mark}\nexit 1\n", encoding="utf-8")
        (folder / name).chmod(0o755)


@pytest.fixture
def trapped(tmp_path: Path) -> Iterator[Path]:
    """Give a working folder full of traps that is a submission; afterwards none may have left a mark."""
    lab = make_lab(tmp_path, {"talker": TALKER}, {"only": STEPS}, checks=[published("/chatter")])
    (tmp_path / "solution").mkdir()
    shutil.copy(lab.submission / "talker.py", tmp_path / "solution")
    text = lab.rubric_file.read_text(encoding="utf-8")
    lab.rubric_file.write_text(text.replace("  id: T\n", "  id: T\n  solution: solution\n"))
    mark = tmp_path / "mark"
    lay_traps(lab.submission, mark)
    yield lab.submission
    assert not mark.exists(), mark.read_text(encoding="utf-8")


def run(trapped: Path, *words: str, native: bool = False) -> str:
    """Run the command in the working folder, with PATH leading there; returns its output."""
    variables = {"PATH": f":.:{trapped}:{os.environ['PATH']}", "HOME": str(trapped.parent)}
    if native:
        prefix = f"{ORIGINAL / 'prefix'}:{trapped}"
        variables |= {"PYTHONPATH": str(ORIGINAL), "AMENT_PREFIX_PATH": prefix}
    done = subprocess.run(
        [GRADE, *words],
        cwd=trapped,
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("launch", ["auto", pytest.param("native", marks=needs_the_original)])
def test_one_submission(trapped: Path, launch: str) -> None:
    """Probing, sessions, exports on the way and afterwards, judging again: none looks into the working folder."""
    lab = ["--lab", "../rubric.yaml"]
    given = ["--one", "-o", "../out", "--launch", launch, "--export", "junit=../junit.xml"]
    run(trapped, ".", *given, *lab, native=True)
    assert (trapped.parent / "junit.xml").is_file()
    run(trapped, "export", "../out/submission", "--to", "github-summary=../summary.md")
    run(trapped, "regrade", "../out/submission")
    run(trapped, "appeal", "../out/submission", "publishes")


def test_a_class(trapped: Path) -> None:
    """A class run, its forks, the class page and the search for copies do not look there either."""
    run(trapped, ".", "../solution", "-o", "../out", "--lab", "../rubric.yaml", "--launch", "auto")
    assert (trapped.parent / "out/grades.csv").is_file()
    run(trapped, "report", "../out")
    run(trapped, "similarity", "../out")


def test_a_lab(trapped: Path) -> None:
    """Neither do the examinations of a lab."""
    run(trapped, "rubric", "../rubric.yaml")
    run(trapped, "lab", "check", "..")
    run(trapped, "lab", "try", "..")


def test_the_machine(trapped: Path) -> None:
    """Neither does the examination of the machine."""
    run(trapped, "doctor")


#: Modules that may start processes: the one for helpers, those within a sandbox, where students' code runs too, and one
#: that `python -m launch_plan` alone uses.
STARTING_MODULES = {
    "confine/helpers.py",
    "confine/reduced.py",
    "grader/live/interfaces/inside/build_package.py",
    "launch_plan/evaluation.py",
    "launch_plan/inside/processes.py",
    "launch_plan/inside/standin/launch/substitutions/__init__.py",
}
STARTS = re.compile(
    r"subprocess\.(Popen|run|call|check_\w+|get\w+)|asyncio\.(subprocess\.)?create_subprocess_\w+"
    r"|os\.(system|popen|exec\w+|(posix_)?spawn\w+)|shutil\.which|pty\.\w+"
)


def starts_processes(path: Path) -> bool:
    """Tell whether a module uses a function that starts a process or looks for a program."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and STARTS.fullmatch(ast.unparse(node.func)):
            return True
    return False


def test_helpers_are_started_in_one_place() -> None:
    """No other module of the grader and of its labs starts a process or looks for a program by itself."""
    starting = set()
    for part in ("confine", "grader", "launch_plan", "ros_bag", "reference", "labs"):
        for path in (ROOT / part).rglob("*.py"):
            name = path.relative_to(ROOT).as_posix()
            if "/fixtures/" not in name and starts_processes(path):
                starting.add(name)
    assert starting == STARTING_MODULES
