"""Calls a lab's own checks within bounds of time, and turns their faults into errors without lost points."""

from __future__ import annotations

import inspect
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from decimal import Decimal
from functools import lru_cache
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError

from grader.checks import base
from grader.checks.own_context import Context, Submission
from grader.evidence.oracle import describe_failure, load_oracle
from grader.lab.lab_code import API_VERSION
from grader.lab.references import OwnCheck
from grader.result import Finding, Location, Outcome

#: CPU time and time of one call of a check, and the interval after which a check that goes on is ended again, in s.
#: Judging a whole submission has 30 s and 100 s.
_MOST_CPU_S, _MOST_S, _AGAIN_S = 10.0, 30.0, 1.0
#: Greatest number of characters of a text from a check, which may quote a student's program.
_MOST_TEXT = 1000


#: Outcomes without credit.
_WITHOUT = (Outcome.FAILED, Outcome.INCONCLUSIVE, Outcome.NOT_REACHED)


_Function = TypeVar("_Function", bound=Callable[..., Finding])


def check(
    *, commands: tuple[str, ...] = (), by_endpoints: bool = False, seeks: tuple[str, ...] = ()
) -> Callable[[_Function], _Function]:
    """Return a decorator that states properties of a check; a check without it has none of them.

    Its arguments must be literals, because they are read without executing the file.

    Parameters
    ----------
    commands
        Commands by which students see the fault themselves while their program runs. `{topic}`
        stands for the parameter of this name, and `{step}` for a command that does the same as the
        step with the label in this parameter.
    by_endpoints
        Whether the check can be passed although messages are missing in the recording.
    seeks
        Kinds of the endpoints that the parameters name and only the graph shows: "publisher",
        "subscription", "service", "action" or "node". A running program that asked for such an
        endpoint loses no points if the graph never showed it.

    Examples
    --------
    >>> @check(commands=("ros2 topic echo {topic}",))
    ... def rises(context: Context, p: Parameters) -> Finding: ...
    """

    def state(function: _Function) -> _Function:
        return function

    return state


class _TooLong(BaseException):
    """Not caught by a check that catches exceptions."""


def find_own(check: OwnCheck, context: base.Context, p: Any) -> Finding:
    """Call a lab's own check; a fault in it is an error, which costs no points."""
    try:
        with _bounded():
            function = load_own(*check)
            seen = Submission(context)
            if context.recorded is not None:
                seen = Context(context)
            return _checked(function(seen, *built(function, p)))
    except (Exception, SystemExit, _TooLong) as problem:
        reason = f"The lab's own check failed: {describe_failure(problem, check.name)}"
        return Finding(Outcome.ERROR, Decimal(0), reason=reason[:_MOST_TEXT], retry=False)


def load_own(lab_folder: Path, check: str) -> Callable[..., Any]:
    """Load a lab's own check; raises ValueError if it is none, or for another version of what it is given."""
    function = load_oracle(lab_folder, check)
    wanted = vars(sys.modules[function.__module__]).get("API_VERSION", API_VERSION)
    if wanted != API_VERSION:
        raise ValueError(
            f"it is written for version {wanted} of grader.own_checks, and this is version {API_VERSION}"
        )
    return function


def built(function: Callable[..., Any], p: BaseModel) -> list[Any]:
    """Return the parameters of a lab's own check, of the class that its second argument names; none if it has none.

    Raises ValueError if the class refuses them.
    """
    given = p.model_dump(exclude_none=True, by_alias=True)
    wanted = list(inspect.signature(function).parameters.values())[1:]
    try:
        return [
            _adapter(_class_of(each.annotation, function)).validate_python(given) for each in wanted
        ]
    except ValidationError as error:
        raise ValueError("; ".join(map(_mistake, error.errors()))) from error


def _adapter(kind: Any) -> TypeAdapter[Any]:
    """Return the reader of a class of parameters."""
    if isinstance(kind, type):
        return _adapter_of_class(kind)
    return TypeAdapter(kind)


@lru_cache(maxsize=64)
def _adapter_of_class(kind: type) -> TypeAdapter[Any]:
    """Return the reader of a class, which all calls of a check share."""
    return TypeAdapter(kind)


def _class_of(annotation: Any, function: Callable[..., Any]) -> Any:
    """Return the class of an annotation, which is a text if the file imports annotations from the future."""
    if not isinstance(annotation, str):
        return annotation
    return vars(sys.modules[function.__module__])[annotation.strip("'\"")]


def _mistake(error: Mapping[str, Any]) -> str:
    """Return an error of pydantic as text, such as `limits: low: Input should be a valid number`."""
    words = error["msg"].removeprefix("Value error, ")
    return ": ".join([*map(str, error["loc"]), words])


def _checked(finding: Any) -> Finding:
    """Return a finding with plain numbers and short texts, as a result can hold them.

    Raises TypeError if it is no finding, and ValueError if its credit does not fit its outcome.
    """
    if not isinstance(finding, Finding):
        raise TypeError("a Finding is expected, as passed() and failed() give it")
    if not all(isinstance(location, Location) for location in finding.where):
        raise TypeError("a Finding is expected, with locations as location() gives them")
    if not _credit_fits(finding):
        raise ValueError(
            "its credit does not fit its outcome; use passed(), failed(), graded() or inconclusive()"
        )
    settled = None
    if finding.settled is not None:
        settled = _checked(finding.settled)
    return Finding(
        finding.outcome,
        finding.credit,
        expected=_short(finding.expected),
        measured=_short(finding.measured),
        reason=_short(finding.reason),
        hint=_short(finding.hint),
        where=tuple(map(_plain, finding.where)),
        notes=tuple(map(_short, finding.notes)),
        retry=bool(finding.retry),
        settled=settled,
        unmeasured=_short(finding.unmeasured) if finding.unmeasured else None,
        unexplained=bool(finding.unexplained),
        causes=tuple(map(_short, finding.causes)),
    )


def _short(text: Any) -> str:
    return str(text)[:_MOST_TEXT]


def _credit_fits(finding: Finding) -> bool:
    """Tell whether the credit of a finding fits its outcome."""
    credit = finding.credit
    if not isinstance(credit, Decimal):
        return False
    if finding.outcome in (Outcome.PASSED, Outcome.EXCUSED):
        return credit == 1
    if finding.outcome is Outcome.PARTIAL:
        return 0 < credit < 1
    return credit == 0 and finding.outcome in _WITHOUT


def _plain(location: Location) -> Location:
    """Return a location with Python's numbers instead of numpy's, for JSON."""
    plain: dict[str, Any] = {}
    for name, kind in (("line", int), ("start_s", float), ("end_s", float)):
        value = getattr(location, name)
        if value is not None:
            plain[name] = kind(value)
    return replace(location, **plain)


@contextmanager
def _bounded() -> Iterator[None]:
    """Raise `_TooLong` within the block after too much computing or waiting; not on Windows."""
    if not hasattr(signal, "setitimer"):
        yield
        return
    # No timer could end a check in another thread; only an empty submission is judged there, as a preparation.
    if threading.current_thread() is not threading.main_thread():
        raise _TooLong("it is called in a main thread only")
    computing = _timer(
        signal.ITIMER_VIRTUAL, signal.SIGVTALRM, _MOST_CPU_S, f"{_MOST_CPU_S:g} s of CPU time"
    )
    with computing, _timer(signal.ITIMER_REAL, signal.SIGALRM, _MOST_S, f"{_MOST_S:g} s"):
        yield


@contextmanager
def _timer(timer: int, number: int, most_s: float, words: str) -> Iterator[None]:
    def stop(number: int, frame: FrameType | None) -> None:
        raise _TooLong(f"it took more than {words}")

    before = signal.signal(number, stop)
    # Again: the first may come within an `except` for all that there is.
    signal.setitimer(timer, most_s, _AGAIN_S)
    try:
        yield
    finally:
        signal.setitimer(timer, 0)
        signal.signal(number, before)
