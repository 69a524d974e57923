"""Environments of students' processes."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from confine.interpreters import OWN_INTERPRETER
from grader.live.sandbox import environment
from grader.live.sandbox.environment import (
    DISCOVERY_FILE,
    TRUSTED_FILE,
    absent_modules,
    student_environment,
)
from grader.live.sandbox.installation import wheels_of

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")


def test_what_a_program_left_at_home_does_not_run_in_the_next(tmp_path: Path) -> None:
    """A student's interpreter reads no files of its user's home.

    An interpreter outside of any virtual environment does.
    """
    python = Path(
        sys.base_prefix, "bin", f"python{sys.version_info.major}.{sys.version_info.minor}"
    )
    environment = student_environment(wheels_of(python), str(tmp_path), "/ws", "/inside", 0)
    own = Path(
        tmp_path,
        ".local/lib",
        f"python{sys.version_info.major}.{sys.version_info.minor}",
        "site-packages",
    )
    own.mkdir(parents=True)
    Path(own, "left.pth").write_text("import os; os.write(1, b'it runs')\n")
    run = subprocess.run([python, "-c", "pass"], env=environment, capture_output=True, check=True)
    assert run.stdout == b""


def test_the_grader_and_students_discover_each_other_alike() -> None:
    """The grader's profiles add the times of its readers and writers alone."""
    students, trusted = (
        re.sub(r"<!--.*?-->", "", file.read_text(), flags=re.DOTALL)
        for file in (DISCOVERY_FILE, TRUSTED_FILE)
    )
    without = re.sub(r" *<(data_\w+) .*?</\1>\n", "", trusted, flags=re.DOTALL)
    assert without == students
    profiles = ElementTree.fromstring(trusted.strip())[0]
    _transports, _participant, *endpoints = profiles
    assert [endpoint.tag.rpartition("}")[2] for endpoint in endpoints] == [
        "data_reader",
        "data_writer",
    ]
    for endpoint in endpoints:
        assert [setting.tag.rpartition("}")[2] for setting in endpoint] == ["times"]


def test_modules_of_each_program_are_there() -> None:
    """No interpreter says where `__main__` comes from, which left the other modules without an answer."""
    own = wheels_of(OWN_INTERPRETER)
    always = ["__future__", "__main__", "builtins", "sys"]
    assert absent_modules(own, [*always, "nobody_has_this"]) == ["nobody_has_this"]


def test_modules_that_nobody_has_need_no_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    """To start one took each grading 0.04 s of CPU time, as each launch file imports `launch`."""
    own = wheels_of(OWN_INTERPRETER)
    assert absent_modules(own, ["nobody_has_this", "numpy", "sys"]) == ["nobody_has_this"]
    monkeypatch.setattr(environment, "ask", lambda *_: pytest.fail("an interpreter was started"))
    assert absent_modules(own, ["nobody_has_this", "numpy"]) == ["nobody_has_this"]
