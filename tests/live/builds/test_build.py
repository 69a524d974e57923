"""Packages of students built by colcon in a real sandbox, and the recorded outcomes."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import pytest

from confine.interpreters import OWN_INTERPRETER
from confine.isolation import Isolation
from grader.live.builds import build, colcon
from grader.live.builds.build import build_packages, can_build
from grader.live.sandbox.installation import wheels_of
from grader.live.sandbox.probing import probe_isolation
from grader.recording.submission import BuildFact
from tests.live.builds.reading import read
from tests.ros_packages import PACKAGE, SETUP, broken, write

pytestmark = pytest.mark.live

#: Time for a build, in s; more than a busy machine takes.
ENOUGH_S = 90.0


@pytest.fixture(scope="module")
def isolation() -> Isolation:
    """Give the isolation of this machine, where packages can be built."""
    found = probe_isolation(OWN_INTERPRETER)
    if not can_build(found):
        pytest.skip(f"not here: {colcon.lacking_builder() or 'namespaces'}")
    return found


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give an empty cache."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder / "grade/builds"


def built(folder: Path, isolation: Isolation, time_s: float = ENOUGH_S) -> list[BuildFact]:
    """Build the packages in a folder."""
    with tempfile.TemporaryDirectory() as prefixes:
        found = build_packages(folder, read(folder), isolation, time_s, Path(prefixes))
    assert found is not None
    return found


def test_a_package_is_installed_where_ros2_run_looks(
    tmp_path: Path, isolation: Isolation, cache: Path
) -> None:
    """A correct package has its executable, marker and manifest in the prefix, and its outcome is kept."""
    write(tmp_path / "ws", PACKAGE)
    (fact,) = built(tmp_path / "ws", isolation)
    assert fact.outcome == "built", fact.output
    assert "lib/lab/talker" in fact.installed
    assert "share/ament_index/resource_index/packages/lab" in fact.installed
    assert "share/lab/launch/lab.launch.py" in fact.installed
    assert not fact.without_interpreter
    assert len(list(cache.glob("*.json"))) == 1


def test_the_cache_answers_for_the_same_sources_alone(
    tmp_path: Path, isolation: Isolation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second build of the same sources runs nothing; a changed file is built again."""
    write(tmp_path / "ws", PACKAGE)
    first = built(tmp_path / "ws", isolation)

    def never(*_: object) -> colcon.Ran:
        raise RuntimeError("it was built again")

    monkeypatch.setattr(colcon, "run_colcon", never)
    assert built(tmp_path / "ws", isolation) == first
    write(tmp_path / "ws", {"lab/talker.py": "def main():\n    print('changed')\n"})
    with pytest.raises(RuntimeError, match="built again"):
        built(tmp_path / "ws", isolation)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("marker", "can't copy 'resource/lab'"),
        ("folder", "package directory 'labs' does not exist"),
        ("syntax", "SyntaxError"),
    ],
)
def test_a_broken_package_fails_with_the_words_of_the_build(
    name: str, words: str, tmp_path: Path, isolation: Isolation
) -> None:
    """The output of the build is recorded without the lines that tell of no problem."""
    write(tmp_path / "ws", broken(name))
    (fact,) = built(tmp_path / "ws", isolation)
    assert fact.outcome == "failed"
    assert words in fact.output
    assert "running egg_info" not in fact.output


def test_without_setup_cfg_executables_are_elsewhere(tmp_path: Path, isolation: Isolation) -> None:
    """A package without setup.cfg is built, and `ros2 run` does not find its executable."""
    write(tmp_path / "ws", broken("config"))
    (fact,) = built(tmp_path / "ws", isolation)
    assert fact.outcome == "built"
    assert "bin/talker" in fact.installed
    assert "lib/lab/talker" not in fact.installed


def test_a_package_that_colcon_skips(tmp_path: Path, isolation: Isolation) -> None:
    """A package beside COLCON_IGNORE is ignored, even with another one of its name."""
    write(tmp_path / "ws/a", PACKAGE)
    write(tmp_path / "ws/b", {**PACKAGE, "COLCON_IGNORE": ""})
    facts = built(tmp_path / "ws", isolation)
    assert [fact.outcome for fact in facts] == ["built", "ignored"]


def test_an_endless_build_is_ended_and_not_kept(
    tmp_path: Path, isolation: Isolation, cache: Path
) -> None:
    """A build beyond its time is undecided, and no cache remembers it."""
    endless = "import time\ntime.sleep(1000)\n" + SETUP
    write(tmp_path / "ws", {**PACKAGE, "setup.py": endless})
    (fact,) = built(tmp_path / "ws", isolation, time_s=3.0)
    assert fact.outcome == "not built"
    assert "time" in fact.reason
    assert not list(cache.glob("*.json"))


def test_bare_files_cost_nothing(tmp_path: Path, isolation: Isolation) -> None:
    """A submission without a package starts no build."""
    write(tmp_path / "ws", {"talker.py": "print()\n"})
    assert build_packages(tmp_path / "ws", read(tmp_path / "ws"), isolation, 1.0, tmp_path) is None


def test_a_package_in_c_without_its_tools_here_is_not_built(
    tmp_path: Path, isolation: Isolation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A machine without the headers for CMake names them, and blames nobody."""
    manifest = (
        "<package><name>lab</name><export><build_type>ament_cmake</build_type></export></package>"
    )
    write(tmp_path / "ws", {"package.xml": manifest, "CMakeLists.txt": "project(lab)\n"})
    monkeypatch.setattr(build, "_OPENSSL", tmp_path / "nowhere")
    (fact,) = built(tmp_path / "ws", isolation)
    assert fact.outcome == "not built"
    assert "lacks libssl-dev" in fact.reason


def test_a_package_is_built_with_the_graders_setuptools(
    tmp_path: Path, isolation: Isolation
) -> None:
    """An installation's own setuptools, perhaps for another Python, is not used."""
    broken = tmp_path / "opt/modules/setuptools"
    write(broken, {"__init__.py": "raise ImportError('made for another Python')\n"})
    wheels = wheels_of(OWN_INTERPRETER)
    paths = {**wheels.paths, "PYTHONPATH": (str(broken.parent), *wheels.modules)}
    ros = replace(wheels, paths=paths, prefix=tmp_path / "opt")
    write(tmp_path / "ws", PACKAGE)
    submission = read(tmp_path / "ws")
    prefixes = tmp_path / "prefixes"
    prefixes.mkdir()
    found = build_packages(tmp_path / "ws", submission, isolation, ENOUGH_S, prefixes, ros)
    assert found is not None
    assert found[0].outcome == "built", found[0].output
