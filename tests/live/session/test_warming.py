"""Modules and models are loaded before the processes of sessions are forked."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from grader.lab.steps import STEPS
from grader.live.session.warming import build_models, import_for

MAIN = """
import wave
import beside
import no_such_module

def play():
    from std_msgs.msg import Empty, String
"""


def test_imports_of_a_program_and_of_its_modules_are_found(tmp_path: Path) -> None:
    """Imports within functions and in modules beside the program count; the lab's own code is not run."""
    (tmp_path / "main.py").write_text(MAIN, encoding="utf-8")
    beside = "raise SystemExit('run')\nfrom std_srvs.srv import SetBool\nimport main\n"
    (tmp_path / "beside.py").write_text(beside, encoding="utf-8")
    loaded = f"""
import sys
from pathlib import Path
from grader.live.session.warming import import_for
print(import_for([Path({str(tmp_path / "main.py")!r})]), "wave" in sys.modules, "beside" in sys.modules)
"""
    run = subprocess.run(
        [sys.executable, "-c", loaded], capture_output=True, text=True, check=True, timeout=60
    )
    names = ["std_msgs/msg/Empty", "std_msgs/msg/String", "std_srvs/srv/SetBool"]
    assert run.stdout.split("] ")[1].split() == ["True", "False"]
    assert sorted(run.stdout.split("]")[0].strip("[").replace("'", "").split(", ")) == names


@pytest.mark.parametrize("text", ["def (", "\0", "import"])
def test_a_program_that_is_not_python_is_passed_over(tmp_path: Path, text: str) -> None:
    """The node itself reports the error."""
    (tmp_path / "main.py").write_text(text, encoding="utf-8")
    assert import_for([tmp_path / "main.py", tmp_path / "missing.py"]) == []


def test_models_of_all_steps_are_built() -> None:
    """No process of a session builds one."""
    build_models()
    assert all(model.__pydantic_complete__ for model in STEPS.values())
