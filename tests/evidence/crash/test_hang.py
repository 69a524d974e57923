"""The line at which a program hangs, from its stacks."""

from __future__ import annotations

import pytest

from grader.evidence.crash.hang import hang_of
from grader.recording.session import Stack, StackFrame

SOURCE = "import rclpy\n" * 10 + "    while True:\n" + "pass\n" * 10
FILES, TEXTS = ["node.py"], {"node.py": SOURCE}
#: Frames of a spinning node, the innermost first.
SPIN = ["/venv/rclpy/executors.py:spin_once", "/venv/rclpy/__init__.py:spin", "node.py:main"]
EXECUTE = "/venv/rclpy/executors.py:_execute"
CALLBACK = [EXECUTE, *SPIN]


def frames(*texts: str) -> list[StackFrame]:
    """Make frames of texts such as `node.py:main`; the submission's stand in line 11."""
    found = []
    for text in texts:
        file, _, function = text.rpartition(":")
        found.append(StackFrame(file, 11 if file == "node.py" else 500, function))
    return found


def looks(*threads: list[StackFrame], is_whole: bool = True) -> list[Stack]:
    """Make the two stacks of one question."""
    return [Stack("node", 1, list(threads), is_whole) for _ in range(2)]


@pytest.mark.parametrize(
    ("inner", "kind", "words"),
    [
        (
            ["/venv/rclpy/__init__.py:spin_until_future_complete", "node.py:on_request"],
            "nested-spin",
            "on_request (line 11) calls spin_until_future_complete() while the node spins already",
        ),
        (
            ["/lib/threading.py:wait", "/venv/rclpy/client.py:call", "node.py:on_request"],
            "call-in-callback",
            "waits in call(), so that the executor, which would bring the answer,",
        ),
        (
            ["/venv/rclpy/client.py:wait_for_service", "node.py:on_request"],
            "waits-for-other",
            "still waits in wait_for_service()",
        ),
        (["node.py:on_request"], "callback-stays", "it was at `while True:`"),
    ],
)
def test_a_callback_that_does_not_return_is_named(inner: list[str], kind: str, words: str) -> None:
    """Each way to stay in a callback has its own sentence, with the line."""
    found = hang_of(looks(frames(*inner, *CALLBACK)), FILES, TEXTS)
    assert found is not None
    assert (found.kind, found.file, found.line, found.subject) == (
        kind,
        "node.py",
        11,
        "on_request",
    )
    assert words in found.problem


@pytest.mark.parametrize(
    ("inner", "kind", "words"),
    [
        (
            ["/lib/threading.py:wait", "/venv/rclpy/timer.py:sleep", "node.py:main"],
            "rate-without-spin",
            "sleep() of a rate in main (line 11) waits",
        ),
        (["/venv/rclpy/client.py:call", "node.py:main"], "call-without-spin", "nothing spins"),
        (["node.py:main"], "not-spinning", "main() was at line 11, `while True:`, when"),
        (["node.py:<module>"], "not-spinning", "The program was at line 11"),
    ],
)
def test_a_program_that_never_spins_is_named(inner: list[str], kind: str, words: str) -> None:
    """The main thread waits for something that only an executor brings, or never reaches one."""
    found = hang_of(looks(frames(*inner)), FILES, TEXTS)
    assert found is not None
    assert found.kind == kind
    assert words in found.problem
    spinning = frames(*SPIN[:-1], "/lib/threading.py:run")
    assert hang_of(looks(frames(*inner), spinning), FILES, TEXTS) is None
    assert hang_of(looks(frames(*inner), is_whole=False), FILES, TEXTS) is None


def test_a_node_that_spins_does_not_hang() -> None:
    """An idle program waits for work; a second look confirms this."""
    assert hang_of(looks(frames(*SPIN)), FILES, TEXTS) is None
    assert hang_of([], FILES, TEXTS) is None


def test_a_callback_that_is_seen_once_is_at_work() -> None:
    """A look may meet any callback; one that stays is met twice."""
    at_work = Stack("node", 1, [frames("node.py:on_timer", *CALLBACK)])
    idle = Stack("node", 1, [frames(*SPIN)])
    later = Stack("node", 9, [frames("node.py:on_timer", *CALLBACK)])
    assert hang_of([at_work, idle, later], FILES, TEXTS) is None


def test_lines_of_libraries_alone_say_nothing() -> None:
    """No file of the submission, no place."""
    assert hang_of(looks(frames("/lib/threading.py:wait")), FILES, TEXTS) is None
