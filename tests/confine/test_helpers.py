"""Helper processes start in `/`, and take nothing from the working folder or from most variables."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

from confine.helpers import (
    absolute_entries,
    find_tool,
    helper_environment,
    python,
    run_helper,
)

pytestmark = pytest.mark.live

_TELL = "import json, os, sys; print(json.dumps([os.getcwd(), sys.path, dict(os.environ)]))"


def test_a_helper_knows_neither_the_folder_nor_the_variables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A helper has the folder `/`, the path of its installation, and the listed variables only."""
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
    """Relative and empty entries, the folder by any name and folders of submissions are dropped."""
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
