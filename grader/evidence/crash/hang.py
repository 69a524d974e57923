"""The line at which a program hangs, from the stacks that it showed when something did not come in time.

A student's process wrote the stacks. They explain a finding in words and point at a line; they never decide a finding.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from grader.evidence.crash.causes import Diagnosis
from grader.evidence.crash.tracebacks import student_file
from grader.recording.session import Stack, StackFrame

_SPINNING = ("spin", "spin_once", "spin_until_future_complete", "spin_once_until_future_complete")
#: Longest part of a source line that is quoted.
_QUOTED = 60
_BLOCKED = "so that the executor, which would bring {awaited}, waits for this callback for ever"
_ASYNC = "Return from the callback at once: use call_async(), and handle the answer in future.add_done_callback(...)."


@dataclass(frozen=True)
class _Place:
    """The innermost line of the submission in a thread."""

    file: str
    line: int
    function: str
    #: Name of the function of rclpy that is called there; empty if another one is, or none.
    calls: str
    #: True if rclpy itself called the function, as it calls callbacks.
    in_callback: bool
    #: True if all threads were asked, and none runs an executor outside of this place.
    nothing_spins: bool


def hang_of(
    stacks: Iterable[Stack], root_files: Collection[str], texts: Mapping[str, str]
) -> Diagnosis | None:
    """Return where a program hangs; None if its stacks do not show that.

    Parameters
    ----------
    stacks
        Stacks of one program. Each question takes its stacks twice, a moment apart; a function counts that is in both.
    root_files
        Files of the submission, relative to its root.
    texts
        Their texts.
    """
    asked: dict[int, list[Stack]] = {}
    for stack in stacks:
        asked.setdefault(stack.asked_ns, []).append(stack)
    for looks in asked.values():
        if len(looks) < 2:
            continue
        before = {(place.file, place.function) for place in _places(looks[0], root_files)}
        for place in _places(looks[-1], root_files):
            if (place.file, place.function) in before:
                found = _cause(place, texts)
                if found is not None:
                    return found
    return None


def _places(stack: Stack, root_files: Collection[str]) -> list[_Place]:
    """Return the places of a program's threads; callbacks come first."""
    spinning = [_has_spin(frames) for frames in stack.threads]
    found = []
    for number, frames in enumerate(stack.threads):
        for at, frame in enumerate(frames):
            file = student_file(frame.file, root_files)
            if file is None:
                continue
            outer = frames[at + 1 :]
            others = [*spinning[:number], *spinning[number + 1 :], _has_spin(outer)]
            calls = _called(frames, at)
            in_callback = any(map(_is_rclpy, outer))
            nothing_spins = stack.is_whole and not any(others)
            named = _named(frames[at:])
            found.append(_Place(file, frame.line, named, calls, in_callback, nothing_spins))
            break
    return sorted(found, key=lambda place: not place.in_callback)


def _called(frames: Sequence[StackFrame], at: int) -> str:
    """Return the function of rclpy that the frame at an index calls; empty if it calls another, or none."""
    for inner in frames[max(at - 1, 0) : at]:
        if _is_rclpy(inner):
            return inner.function
    return ""


def _named(frames: Sequence[StackFrame]) -> str:
    """Return the function of the innermost frame, or the one around a lambda or a comprehension."""
    inner = frames[0]
    for frame in frames:
        if frame.file != inner.file:
            break
        if not frame.function.startswith("<"):
            return frame.function
    return inner.function


def _is_rclpy(frame: StackFrame) -> bool:
    return "/rclpy/" in frame.file


def _has_spin(frames: Sequence[StackFrame]) -> bool:
    return any(_is_rclpy(frame) and frame.function in _SPINNING for frame in frames)


def _cause(place: _Place, texts: Mapping[str, str]) -> Diagnosis | None:
    """Return the cause of a hang at a place; None if a working program can stand there."""
    at = f"{place.function} (line {place.line})"
    if place.calls in _SPINNING:
        if not place.in_callback:
            return None
        problem = (
            f"The callback {at} calls {place.calls}() while the node spins already, "
            f"{_BLOCKED.format(awaited='the result')}."
        )
        return _diagnosis("nested-spin", problem, _ASYNC, place)
    if place.calls == "call":
        return _waiting_call(place, at)
    if place.calls == "sleep" and place.nothing_spins:
        problem = f"sleep() of a rate in {at} waits for an executor that spins, and nothing spins."
        remedy = (
            "Do the work in a timer and call rclpy.spin(node), or spin in a thread beside the loop."
        )
        return _diagnosis("rate-without-spin", problem, remedy, place)
    if place.calls.startswith("wait_for_"):
        problem = f"{at} still waits in {place.calls}(), for something that is not there."
        remedy = f"Give {place.calls}() a timeout_sec, and go on without it."
        return _diagnosis("waits-for-other", problem, remedy, place)
    return _other_line(place, at, texts)


def _waiting_call(place: _Place, at: str) -> Diagnosis | None:
    """Return the cause of a service's `call` that has no answer."""
    if place.in_callback:
        problem = f"The callback {at} waits in call(), {_BLOCKED.format(awaited='the answer')}."
        return _diagnosis("call-in-callback", problem, _ASYNC, place)
    if not place.nothing_spins:
        return None
    problem = f"{at} waits in call() for an answer, and nothing spins that could bring the answer."
    remedy = "Use call_async() and rclpy.spin_until_future_complete(node, future)."
    return _diagnosis("call-without-spin", problem, remedy, place)


def _other_line(place: _Place, at: str, texts: Mapping[str, str]) -> Diagnosis | None:
    """Return the line at which a callback does not go on, or a program without a spinning node."""
    code = f"`{_source_line(texts.get(place.file, ''), place.line)}`"
    if place.in_callback:
        problem = f"The callback {at} had not returned when the grader looked: it was at {code}."
        remedy = "Let each callback return soon: spread work over the calls of a timer, and do not wait or loop in it."
        return _diagnosis("callback-stays", problem, remedy, place)
    if not place.nothing_spins:
        return None
    where = "The program" if place.function == "<module>" else f"{place.function}()"
    problem = f"{where} was at line {place.line}, {code}, when the grader looked, and nothing was spinning."
    remedy = "Callbacks, timers and requests run only in rclpy.spin(node): reach that line, or spin in a thread."
    return _diagnosis("not-spinning", problem, remedy, place)


def _diagnosis(kind: str, problem: str, remedy: str, place: _Place) -> Diagnosis:
    return Diagnosis(kind, problem, remedy, place.file, place.line, subject=place.function)


def _source_line(text: str, line: int) -> str:
    """Return a line of a source text without its indentation, shortened; empty if there is no such line."""
    lines = text.splitlines()
    if not 1 <= line <= len(lines):
        return ""
    code = lines[line - 1].strip()
    return code if len(code) <= _QUOTED else f"{code[:_QUOTED]}..."
