"""Limits on processes: none above the hard limit is asked for, and one that is too low is named."""

from __future__ import annotations

import os
import pickle
import resource
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

import pytest

from confine import limits

T = TypeVar("T")

ROOT = Path(limits.__file__).parents[1]


def below(name: int, hard: int, work: Callable[[], T]) -> T:
    """Return the result of `work`, called in a process with a lowered hard limit."""
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            resource.setrlimit(name, (hard, hard))
            os.write(write, pickle.dumps(work()))
        finally:
            os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        answer: T = pickle.load(pipe)
    os.waitpid(pid, 0)
    return answer


@pytest.mark.parametrize(("hard", "wanted", "had"), [(0, 1, 0), (100, 1, 1), (100, 100, 100)])
def test_no_limit_is_above_the_hard_one(hard: int, wanted: int, had: int) -> None:
    """The lower of both can be had, for this process and for its children."""

    def work() -> tuple[int, dict[str, int], tuple[int, int]]:
        found = limits.attainable("core", wanted), limits.attainable_limits({"core": wanted})
        limits.set_limit("core", wanted)
        return (*found, resource.getrlimit(resource.RLIMIT_CORE))

    assert below(resource.RLIMIT_CORE, hard, work) == (had, {"core": had}, (had, had))


def test_a_soft_limit_can_be_raised_again() -> None:
    """A soft limit leaves the hard limit as it is, and `lift` undoes it."""

    def work() -> list[tuple[int, int]]:
        limits.set_soft_limit("nofile", 50)
        lowered = resource.getrlimit(resource.RLIMIT_NOFILE)
        limits.lift("nofile")
        return [lowered, resource.getrlimit(resource.RLIMIT_NOFILE)]

    assert below(resource.RLIMIT_NOFILE, 80, work) == [(50, 80), (80, 80)]


def test_soft_limits_are_raised_but_for_memory() -> None:
    """Only the hard limit on open files counts; memory stays limited as the grader limits itself."""

    def work() -> tuple[int, int]:
        limits.set_soft_limit("nofile", 50)
        limits.set_soft_limit("as", 2**31)
        limits.raise_soft_limits()
        files, memory = resource.RLIMIT_NOFILE, resource.RLIMIT_AS
        return resource.getrlimit(files)[0], resource.getrlimit(memory)[0]

    assert below(resource.RLIMIT_NOFILE, 900, work) == (900, 2**31)


@pytest.mark.parametrize(
    ("number", "hard", "problem", "name"),
    [
        (resource.RLIMIT_NOFILE, 100, "OSError: [Errno 24] Too many open files", "nofile"),
        (resource.RLIMIT_FSIZE, 100, "OSError: [Errno 27] File too large", "fsize"),
        (resource.RLIMIT_AS, 2**31, "MemoryError: ", "as"),
        (resource.RLIMIT_NPROC, 100, "RuntimeError: can't start new thread", "nproc"),
        (resource.RLIMIT_NOFILE, 100, "OSError: [Errno 28] No space left on device", None),
        (resource.RLIMIT_FSIZE, 2**40, "OSError: [Errno 27] File too large", None),
    ],
)
def test_the_limit_behind_an_error(number: int, hard: int, problem: str, name: str | None) -> None:
    """The limit named by the message is found, unless it is far above the usual value."""
    found = below(number, hard, partial(limits.limit_behind, problem))
    if name is None:
        assert found is None
    else:
        assert found is not None
        assert found.need.name == name
