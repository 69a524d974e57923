"""Files of a lab that are executed before the judgements that call them."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

import pytest

from grader.evidence.oracle import load_file
from grader.judging.judgement import prepare
from grader.judging.lab_functions import execute_files
from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric
from tests.counted import calls_of

_RUBRIC = """\
lab: {id: own, title: Own, points: 2}
artifacts:
  it: {file: it.py}
sessions:
  experiment:
    steps:
      - start: {student: it}
criteria:
  - id: all
    title: All
    points: 2
    checks:
      - {id: first, points: 1, session: experiment, check: first.py:holds}
      - {id: second, points: 1, session: experiment, check: second.py:holds}
"""
_HOLDS = """\
from grader.own_checks import Context, Finding, passed

def holds(context: Context) -> Finding:
    return passed("", "")
"""


def _lab(folder: Path, beginning: str) -> Rubric:
    """Return the rubric of a lab with two files, of which the first has a beginning of its own."""
    (folder / "rubric.yaml").write_text(_RUBRIC)
    # The files of two tests have different names as modules.
    (folder / "first.py").write_text(f"# {folder}\n{beginning}\n{_HOLDS}")
    (folder / "second.py").write_text(f"# {folder}, second\n{_HOLDS}")
    return read_rubric(folder / "rubric.yaml")


def _executed(rubric: Rubric) -> set[str]:
    """Return the files of a lab that this process has executed."""
    found = set()
    for module in list(sys.modules.values()):
        file = Path(getattr(module, "__file__", None) or "/")
        if file.parent == rubric.folder.resolve():
            found.add(file.name)
    return found


def test_a_prepared_process_has_executed_the_files_that_judging_calls() -> None:
    """A worker of a class finds a file of its lab; it executes, compiles and imports nothing for it."""
    rubric = read_rubric(None)
    prepare(rubric)
    for function in {*rubric.functions_of_figures, *(spec.check for spec in rubric.checks())}:
        file = function.partition(":")[0]
        if file.endswith(".py"):
            assert calls_of(lambda file=file: load_file(rubric.folder, file)) < 150
    assert "rclpy" not in sys.modules


def test_both_files_of_a_lab_are_executed(tmp_path: Path) -> None:
    """The files of all checks are executed in this process."""
    rubric = _lab(tmp_path, "")
    execute_files(rubric)
    assert _executed(rubric) == {"first.py", "second.py"}


@pytest.mark.parametrize("beginning", ["1 / 0", "raise SystemExit", "import nothing_of_this_name"])
def test_a_file_with_a_mistake_is_left_to_the_judgement(tmp_path: Path, beginning: str) -> None:
    """A mistake in a file stops neither this process nor the other files."""
    rubric = _lab(tmp_path, beginning)
    execute_files(rubric)
    assert _executed(rubric) == {"second.py"}


@pytest.mark.parametrize(
    "beginning",
    [
        "import os; os._exit(0)",
        "import os, signal; os.kill(os.getpid(), signal.SIGKILL)",
        "import threading, time; threading.Thread(target=time.sleep, args=[9], daemon=True).start()",
        "everything = [bytearray(2**20) for _ in range(4096)]",
    ],
)
def test_a_file_that_harms_its_process_is_executed_in_no_prepared_one(
    tmp_path: Path, beginning: str
) -> None:
    """A fork executes all files first: this process loses neither itself nor its memory, and has no thread more."""
    rubric = _lab(tmp_path, beginning)
    threads = threading.active_count()
    execute_files(rubric)
    assert threading.active_count() == threads
    assert "first.py" not in _executed(rubric)


def test_printed_text_is_dropped(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Output of a file does not appear among the output of the process that is prepared."""
    rubric = _lab(tmp_path, "print('hello')")
    execute_files(rubric)
    assert capfd.readouterr().out == ""


def test_a_thread_executes_nothing(tmp_path: Path) -> None:
    """A process with other threads, such as a server, waits for no file of a lab."""
    rubric = _lab(tmp_path, "")
    preparing = threading.Thread(target=execute_files, args=[rubric])
    preparing.start()
    preparing.join(10)
    assert not _executed(rubric)
