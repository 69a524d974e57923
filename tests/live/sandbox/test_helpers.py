"""Helper processes start in `/`, and take nothing from the working folder or from most variables."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

from grader.live.sandbox.environment import find_native_launch
from grader.live.sandbox.helpers import (
    absolute_entries,
    find_tool,
    helper_environment,
    python,
    run_helper,
)
from tests.launch_plan.evaluations import ORIGINAL, needs_the_original

pytestmark = pytest.mark.live

_TELL = "import json, os, sys; print(json.dumps([os.getcwd(), sys.path, dict(os.environ)]))"


def test_a_helper_knows_neither_the_folder_nor_the_variables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its folder is `/`, its path that of its installation, and of the variables it has those of the list."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "json.py").write_text("raise SystemExit('imported')\n", encoding="utf-8")
    for name in ("PYTHONPATH", "LD_LIBRARY_PATH", "ROS_DOMAIN_ID", "GIT_DIR", "HOME"):
        monkeypatch.setenv(name, str(tmp_path) if name != "HOME" else "home")
    monkeypatch.setenv("WANTED", "yes")
    environment = helper_environment(["WANTED"])
    done = run_helper(python(sys.executable, "-c", _TELL), environment=environment)
    folder, path, variables = json.loads(done.stdout)
    assert folder == "/"
    assert not {"", ".", str(tmp_path)} & set(path)
    assert str(tmp_path) not in variables.get("LD_LIBRARY_PATH", "").split(":")
    assert not {"PYTHONPATH", "ROS_DOMAIN_ID", "GIT_DIR", "HOME"} & variables.keys()
    assert variables["WANTED"] == "yes"


def test_entries_that_lead_to_the_working_folder_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Relative ones, empty ones, the folder itself by any name, and what lies below a submission."""
    handed_in, here = tmp_path / "handed", tmp_path / "here"
    for folder in (handed_in / "bin", here):
        folder.mkdir(parents=True)
    (tmp_path / "link").symlink_to(here)
    monkeypatch.chdir(here)
    (here / "tool").touch(mode=0o755)
    entries = [
        "",
        ".",
        "../here",
        str(here),
        str(tmp_path / "link"),
        f"{handed_in}/bin",
        "/usr/bin",
    ]
    monkeypatch.setenv("PATH", os.pathsep.join(entries))
    assert absolute_entries("PATH", [handed_in]) == ["/usr/bin"]
    assert find_tool("tool") is None
    assert find_tool("env") == "/usr/bin/env"
    (here / "tool").unlink()
    here.rmdir()
    assert "/usr/bin" in absolute_entries("PATH")


@needs_the_original
def test_the_real_launch_is_found_without_the_modules_of_a_submission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A workspace that was built in the submission and sourced is on the path, and nothing of it is imported."""
    modules = tmp_path / "install/lib"
    modules.mkdir(parents=True)
    mark = tmp_path / "mark"
    for name in ("launch", "json", "typing", "yaml"):
        (modules / f"{name}.py").write_text(f"open({str(mark)!r}, 'w')\n", encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", f"{modules}:{ORIGINAL}")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}/install:{ORIGINAL / 'prefix'}")
    found = find_native_launch(Path(sys.executable), "native", [tmp_path])
    assert found is not None
    assert not mark.exists()
    assert str(modules) not in found.python_path
    assert found.prefixes == [str(ORIGINAL / "prefix")]
