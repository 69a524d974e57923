"""Servers with one mistake each: what is written in place of what in the solution, and what that costs.

Costs are points of the checks of `rubric.yaml`, and words in the reason or hint of the first.
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

DEFECTS = {
    "solution": Defect(),
    "misspelt_name": Defect((('"/fibonacci"', '"/fibonaci"'),), (("offered", "1.8"),), "named /fibonaci"),
    "no_execute_callback": Defect((("execute_callback=self.execute", "execute_callback=None"),)),
    "never_answers": Defect(((f"return {_DECIDE}", "time.sleep(600)"),)),
    "returns_no_response": Defect(((_DECIDE, "goal.order >= 0"),)),
    "rejects_all": Defect((("goal.order >= 0", "goal.order >= 1000"),)),
    "accepts_all": Defect(((_CALLBACK, ""),)),
    "no_feedback": Defect((("            handle.publish_feedback(feedback)\n", ""),)),
    "wrong_numbers": Defect((("feedback.sequence[-1] + feedback.sequence[-2]", "2 * feedback.sequence[-1]"),)),
    "returns_nothing": Defect((("        return Fibonacci.Result(sequence=feedback.sequence)\n", ""),)),
    "forgets_succeed": Defect(((_SUCCEED, ""),)),
    "raises": Defect(((_SUCCEED, f"        print(feedback.sequence[99])\n{_SUCCEED}"),)),
    "blocked": Defect((("MultiThreadedExecutor(4)", "None"),)),
    "refuses_to_cancel": Defect((("            cancel_callback=lambda goal: CancelResponse.ACCEPT,\n", ""),)),
    "never_canceled": Defect(((_CANCELED, ""),)),
    "ignores_cancel": Defect((("handle.is_cancel_requested", "False"),)),
    "late_cancel": Defect(((_CANCELED, f"                time.sleep(0.7)\n{_CANCELED}"),)),
    "not_preempted": Defect((("self.newest is not handle", "False"),)),
}
