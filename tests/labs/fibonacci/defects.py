"""Servers with one mistake each: an edit of the solution, and its price.

Prices are points of the checks in `rubric.yaml`, and words in the reason or hint of the first
check.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
SOLUTION = FOLDER / "solution" / "server.py"


@dataclass(frozen=True)
class Defect:
    """A mistake in the solution."""

    edits: tuple[tuple[str, str], ...] = ()
    #: Check -> points that it loses.
    lost: tuple[tuple[str, str], ...] = ()
    words: str = ""

    @property
    def source(self) -> str:
        """The server's source."""
        text = SOLUTION.read_text(encoding="utf-8")
        for old, new in self.edits:
            assert text.count(old) == 1, f"{old!r} is not once in the solution"
            text = text.replace(old, new)
        return text


_SUCCEED, _CANCELED = "        handle.succeed()\n", "                handle.canceled()\n"
_CALLBACK, _DECIDE = (
    "            goal_callback=self.decide,\n",
    "GoalResponse.ACCEPT if goal.order >= 0 else GoalResponse.REJECT",
)

#: Losses of a server that can be found but not tested.
_NO_GOALS = (("goals", "4"), ("work", "6"), ("cancelled", "4"), ("preempted", "3"))

DEFECTS = {
    "solution": Defect(),
    "misspelt_name": Defect(
        (('"/fibonacci"', '"/fibonaci"'),), (("offered", "1.8"),), "named /fibonaci"
    ),
    "no_execute_callback": Defect(
        (("execute_callback=self.execute", "execute_callback=None"),),
        (("offered", "3"), *_NO_GOALS),
        "Failed to register goal execution callback: not callable",
    ),
    "never_answers": Defect(
        ((f"return {_DECIDE}", "time.sleep(600)"),),
        _NO_GOALS,
        "neither accepted nor rejected within 6.0 s",
    ),
    "returns_no_response": Defect(
        ((_DECIDE, "goal.order >= 0"),), _NO_GOALS, "goal_callback returns no GoalResponse"
    ),
    "rejects_all": Defect(
        (("goal.order >= 0", "goal.order >= 1000"),), _NO_GOALS, "Every goal is rejected."
    ),
    "accepts_all": Defect(((_CALLBACK, ""),), (("goals", "2"),), "Every goal is accepted."),
    "no_feedback": Defect(
        (("            handle.publish_feedback(feedback)\n", ""),),
        (("work", "2.4"),),
        "No feedback",
    ),
    "wrong_numbers": Defect(
        (("feedback.sequence[-1] + feedback.sequence[-2]", "2 * feedback.sequence[-1]"),),
        (("work", "2.4"),),
        "sequence is [0, 1, 2, 4, 8, 16], not [0, 1, 1, 2, 3, 5]",
    ),
    # The node ends with it.
    "returns_nothing": Defect(
        (("        return Fibonacci.Result(sequence=feedback.sequence)\n", ""),),
        (("goals", "2"), ("work", "2.4"), *_NO_GOALS[2:]),
        "did not return a result",
    ),
    "forgets_succeed": Defect(((_SUCCEED, ""),), (("work", "1.2"),), "Call goal_handle.succeed()"),
    "raises": Defect(
        ((_SUCCEED, f"        print(feedback.sequence[99])\n{_SUCCEED}"),),
        (("work", "3.6"),),
        "IndexError in server.py",
    ),
    "blocked": Defect(
        (("MultiThreadedExecutor(4)", "None"),), _NO_GOALS[2:], "spin with a MultiThreadedExecutor"
    ),
    "refuses_to_cancel": Defect(
        (("            cancel_callback=lambda goal: CancelResponse.ACCEPT,\n", ""),),
        _NO_GOALS[2:3],
        "was refused",
    ),
    "never_canceled": Defect(
        ((_CANCELED, ""),), (("cancelled", "2"),), "Call goal_handle.canceled() before"
    ),
    "ignores_cancel": Defect(
        (("handle.is_cancel_requested", "False"),),
        _NO_GOALS[2:3],
        "look at goal_handle.is_cancel_requested",
    ),
    "late_cancel": Defect(
        ((_CANCELED, f"                time.sleep(0.7)\n{_CANCELED}"),),
        (("cancelled", "2"),),
        "Look for it more often",
    ),
    "not_preempted": Defect(
        (("self.newest is not handle", "False"),), _NO_GOALS[3:], "call goal_handle.abort()"
    ),
}
