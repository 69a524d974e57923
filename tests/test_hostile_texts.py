"""Each reader of students' texts ends, with a bounded and fair answer, for any text."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest

from grader.judging.judge import Recordings, judge, open_recordings
from grader.judging.judgement import report_page
from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric
from grader.live.session.stage import stage
from grader.recording.submission import FileFact, SubmissionRecord
from grader.result import Outcome
from grader.submission.packages.cmake_script import programs_of
from grader.submission.packages.colcon import find_packages
from tests.hostile_texts import TEXTS
from tests.thorough import part

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[1]
PYTHON = "<package><name>p</name><export><build_type>ament_python</build_type></export></package>"
CMAKE = "<package><name>p</name><export><build_type>ament_cmake</build_type></export></package>"
PLACES = {
    "package.xml": {},
    "setup.py": {"package.xml": PYTHON},
    "setup.cfg": {"package.xml": PYTHON},
    "CMakeLists.txt": {"package.xml": CMAKE},
}
#: Texts that this commit tries.
CHOSEN = part(list(TEXTS), 3)
#: A package with as many files as are extracted, deep in folders.
FILES = ["/".join([f"d{n % 20}", *["e"] * 15, f"f{n}.py"]) for n in range(500)]


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


@pytest.fixture(scope="module")
def solution(rubric: Rubric) -> Recordings:
    """Give the recordings of the solution."""
    return open_recordings(ROOT / "tests/recordings/solution", rubric)


@contextmanager
def calls_limited(most: int) -> Iterator[None]:
    """Fail when more functions of Python are called than this: the work is counted, whatever the machine does."""
    count = 0

    def on_event(frame: FrameType, event: str, argument: object) -> None:
        nonlocal count
        count += event == "call"
        if count > most:
            sys.setprofile(None)
            pytest.fail(f"more than {most} calls")

    sys.setprofile(on_event)
    try:
        yield
    finally:
        sys.setprofile(None)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("text", CHOSEN)
def test_packages_of_any_text(place: str, text: str, rubric: Rubric, tmp_path: Path) -> None:
    """A package is found for any text in its files, and can be installed; its problems are named briefly."""
    texts = {**PLACES[place], place: TEXTS[text]}
    with calls_limited(2_000_000):
        (package,) = find_packages(texts, [*texts, *FILES])
    assert len(package.name) <= 100
    assert all(len(problem) <= 150_000 for problem in package.problems)
    for path in texts:
        (tmp_path / "handed_in" / path).parent.mkdir(exist_ok=True)
        (tmp_path / "handed_in" / path).write_text(TEXTS[text], encoding="utf-8", errors="replace")
    record = SubmissionRecord(
        "ann", files=[FileFact(path, 1, "") for path in texts], texts=texts, packages=[package]
    )
    stage(tmp_path / "handed_in", record, rubric, tmp_path / "ws", sys.executable)
    assert (tmp_path / "ws" / "install/share" / package.name).is_dir()


@pytest.mark.parametrize("text", CHOSEN)
def test_judging_any_text(text: str, solution: Recordings, rubric: Rubric) -> None:
    """No check breaks on a source or README of any text, and other judgements do not change.

    The checks of the other sessions read no text if all went well, and their arithmetic takes most
    of the time. Only a README, a source and a launch file have readers of their own.
    """
    submission = solution.submission
    texts = {}
    for path in submission.texts:
        if "publisher" not in path and "service" not in path:
            texts[path] = TEXTS[text]
    assert len(texts) == 4
    changed = dataclasses.replace(
        solution,
        submission=dataclasses.replace(submission, texts=texts, sessions=["launch", "qos"]),
    )
    result = judge(changed, rubric)
    findings = {}
    for criterion in result.criteria:
        for check in criterion.checks:
            findings[check.id] = check
    assert not [name for name, finding in findings.items() if finding.outcome is Outcome.ERROR]
    assert findings["qos.traffic"].outcome is Outcome.PASSED
    report_page(result, changed, rubric).encode()


def test_commands_that_are_not_closed_are_looked_at_once() -> None:
    """Text that is no command does not hide the real commands."""
    command = "install(DIRECTORY d0 DESTINATION lib/p)\n"
    found = {"lib/p/d0/a": "d0/a"}
    assert list(programs_of("install(" * 10_000 + command, "p", ["d0/a"])) == [found]
    many = list(programs_of(command * 1000, "p", ["d0/a"]))
    assert many[:10] == [found] * 10
    assert many[-1] is None


def test_packages_within_each_other_are_installed_soon(rubric: Rubric, tmp_path: Path) -> None:
    """Each file is read once, however many packages within each other have it for each of their executables."""
    folders = ["p/" * depth for depth in range(10)]
    texts = {
        f"{folder}{name}": PYTHON for folder in folders for name in ("package.xml", "setup.py")
    }
    texts |= {f"{folders[-1]}f{n}.py": "def main():\n    pass\n" for n in range(50)}
    record = SubmissionRecord("ann", files=[FileFact(path, 1, "") for path in texts], texts=texts)
    for folder in folders:
        texts[f"{folder}setup.py"] = "setup(entry_points=f())"
    record.packages = find_packages(texts, list(texts))
    assert {len(package.executables) for package in record.packages} == {100}
    with calls_limited(300_000):
        stage(tmp_path / "handed_in", record, rubric, tmp_path / "ws", sys.executable)
    assert (tmp_path / "ws" / "install/lib/p/f49.py").is_file()
