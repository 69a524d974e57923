"""Preparation of a process for the judgements of its forks."""

from __future__ import annotations

from grader.judging.judgement import prepare
from grader.judging.rubrics import read_rubric
from tests.counted import calls_of


def test_a_process_is_prepared_once_for_a_rubric() -> None:
    """A worker of a class is a fork of a prepared process, and prepares nothing again."""
    prepare(read_rubric(None))
    again = read_rubric(None)
    assert calls_of(lambda: prepare(again)) < 100
