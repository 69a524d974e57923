"""Preparation of a process for the judgements of its forks."""

from __future__ import annotations

from grader.evidence.oracle import compiled, load_file
from grader.judging.judgement import prepare
from grader.judging.rubrics import read_rubric
from tests.counted import calls_of


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
