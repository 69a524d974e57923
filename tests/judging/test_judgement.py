"""Preparation of a process for the judgements of its forks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from grader.evidence.oracle import compiled, load_file
from grader.judging.judgement import prepare
from grader.judging.rubrics import read_rubric
from tests.counted import calls_of

SOLUTION = Path(__file__).resolve().parents[1] / "recordings/solution"


def test_a_process_is_prepared_once_for_a_rubric() -> None:
    """A worker of a class is a fork of a prepared process, and prepares nothing again."""
    prepare(read_rubric(None))
    again = read_rubric(None)
    assert calls_of(lambda: prepare(again)) < 100


def test_a_lab_is_compiled_before_its_functions_are_needed() -> None:
    """A worker of a class compiles no file of the lab; no file is executed in the process that it is a fork of."""
    rubric = read_rubric(None)
    prepare(rubric)
    before = compiled.cache_info().misses
    for function in {*rubric.functions_of_figures, *(spec.check for spec in rubric.checks())}:
        file = function.partition(":")[0]
        if file.endswith(".py"):
            load_file(rubric.folder, file)
    assert compiled.cache_info().misses == before


_JUDGE = """\
import sys
from pathlib import Path
from grader.judging.judgement import judge_recordings, load
from grader.judging.rubrics import read_rubric
from grader.lab.overrides import Overrides

rubric = read_rubric(None)
load(rubric)
before = set(sys.modules)
judge_recordings(Path(sys.argv[1]), rubric, Overrides())
print(*sys.modules.keys() - before)
"""


def test_a_judgement_imports_no_module_after_loading() -> None:
    """Judging after the sessions takes no time for imports, except of the lab's own checks."""
    told = subprocess.run(
        [sys.executable, "-I", "-c", _JUDGE, str(SOLUTION)],
        capture_output=True,
        text=True,
        check=True,
    )
    imported = [name for name in told.stdout.split() if name.startswith("grader.")]
    # The lab's checks are executed in the process that judges, and import their interface there.
    assert imported == ["grader.own_checks"]
