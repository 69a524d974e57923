"""The Python environment of students' programs."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from grader.errors import PlatformError
from grader.live.sandbox import students_python as of_students
from grader.live.sandbox.students_python import requirements_with, students_python

pytestmark = pytest.mark.live


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def test_the_libraries_are_those_of_jazzy_as_far_as_python_permits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A newer Python has no wheels of them; a lab adds its own."""
    monkeypatch.setattr("sys.version_info", (3, 12, 1))
    assert "numpy==1.26.4" in requirements_with()
    monkeypatch.setattr("sys.version_info", (3, 13, 0))
    assert requirements_with(["transforms3d"])[-3:] == ["numpy", "scipy", "transforms3d"]


def test_an_environment_is_made_once_for_the_same_requirements(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Other requirements have another one; its interpreter finds none of the grader's libraries."""
    installed = []
    monkeypatch.setattr(of_students, "_install", lambda *how: installed.append(how[-1]))
    first = students_python()
    assert students_python() == first
    assert students_python(["transforms3d"]) != first
    assert [requirements[-1] for requirements in installed] == ["scipy==1.11.4", "transforms3d"]
    look = "import importlib.util as u; print([n for n in ('jinja2', 'mcap', 'rosbags') if u.find_spec(n)])"
    found = subprocess.run(
        [str(first), "-I", "-c", look], capture_output=True, text=True, check=True
    )
    assert found.stdout == "[]\n"


def test_an_index_that_cannot_be_reached_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is left of an environment that could not be made."""
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple")
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)
    monkeypatch.setattr(of_students, "requirements_with", lambda own: ["no-such-package-here"])
    with pytest.raises(PlatformError, match="the package index cannot be reached") as raised:
        students_python()
    assert "--python lab" in raised.value.remedy
    assert not list((tmp_path / "grade/students-python").iterdir())
