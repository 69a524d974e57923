"""A class of made-up students: the result of the kept solution, with mistakes as students make them."""

from __future__ import annotations

import copy
import hashlib
import random
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from pathlib import Path
from typing import Any

from grader.cohort.entries import ClassEntry, report_link
from grader.judging.judge import judge, open_recordings
from grader.lab.rubric import Rubric
from grader.result import read_result, to_plain

SOLUTION = Path(__file__).parent / "recordings/solution"
DUE = datetime(2026, 11, 20, 22, 59, tzinfo=UTC)

_FIRST = """
    Aaliyah Anton Beatriz Chen Clara David Elif Emma Farid Giulia Hannah Ibrahim Ines Jakub Jonas Katarzyna Lars
    Leila Linh Luca Maja Mateo Mehmet Mira Noah Nora Oskar Paula Priya Quentin Rafael Sofia Soren Tariq Tomoko
    Ulrike Viktor Wei Yara Zoë
"""
_LAST = """
    Abadi Bauer Costa Dubois Eriksen Fischer Garcia Hoffmann Ito Jansen Kaya Lindqvist Moreau Novak Okafor Petrov
    Quispe Rossi Schmidt Tanaka Ueda Vogel Weber Xu Yilmaz Zimmermann
"""
FIRST, LAST = _FIRST.lower().split(), _LAST.lower().split()


@dataclass(frozen=True)
class Slip:
    """A mistake: its frequency, its check, and the grader's text about it.

    `{...}` in the reason are values that differ from student to student.
    """

    share: float
    check: str
    credit: str
    reason: str
    hint: str = ""
    blocks: tuple[str, ...] = ()


SLIPS = (
    Slip(0.45, "qos.explains", "0", "There is next to nothing in writing about the trade-offs."),
    Slip(
        0.42,
        "subscriber.mean",
        "0",
        "Your numbers match the signed error; the lab asks for |error|.",
    ),
    Slip(
        0.38,
        "service.refuses",
        "0.5",
        "It refuses only when the parameter is false from the start; a change while it runs has no effect.",
    ),
    Slip(0.33, "publisher.rate", "0.6", "Messages come at {rate} Hz, {off}% slower than 100 Hz."),
    Slip(0.3, "documentation.readme", "0.4", "It found no mention of {file}, {other}."),
    Slip(0.28, "documentation.code", "0.8", "Neither a docstring nor a comment explains {docs}."),
    Slip(
        0.28,
        "qos.profiles",
        "0.94",
        "/test_control_command has durability volatile, not transient_local.",
    ),
    Slip(0.2, "launch.parameters", "0.8", "The launch file gives {node} no publish_rate."),
    Slip(
        0.16,
        "publisher.publishes",
        "0.4",
        "The topic is named {topic}, not /joint_commands; the rest is judged on {topic}.",
    ),
    Slip(
        0.14,
        "publisher.reliable",
        "0",
        "The publisher offers BEST_EFFORT reliability, not RELIABLE.",
    ),
    Slip(
        0.14,
        "qos.honest",
        "0",
        "It prints {n} messages for /test_reliable, and {lines} arrived.",
    ),
    Slip(
        0.12,
        "service.offers",
        "0",
        "There is no robot_service.py in the submission.",
        "Hand in a file named robot_service.py.",
        (
            "service.enables",
            "service.disables",
            "service.parameters",
            "service.refuses",
            "service.two_clients",
        ),
    ),
    Slip(
        0.1,
        "subscriber.early_state",
        "0",
        "Python stops with an exception: it uses a command before there is one. (TypeError in {file}, line {n})",
    ),
    Slip(
        0.08,
        "launch.loads",
        "0",
        "Executable '{exe}' not found in package '{package}'; did you mean 'joint_subscriber'?",
        "Write the name of an entry point of setup.py, and build again.",
        ("launch.arguments", "launch.nodes", "launch.parameters", "launch.together"),
    ),
    Slip(0.06, "qos.honest", "0", "best_effort reports {n} messages; 999 were published."),
    Slip(
        0.05,
        "service.two_clients",
        "0.5",
        "{n} of 50 calls took longer than 1 s, or got no answer.",
    ),
)


def solution_result(rubric: Rubric) -> dict[str, Any]:
    """Give the plain result of the solution, which has all points."""
    return to_plain(judge(open_recordings(SOLUTION, rubric), rubric))


def sample_class(
    rubric: Rubric, number: int = 40, base: dict[str, Any] | None = None
) -> list[ClassEntry]:
    """Make a class: most have some mistakes, one was not graded, two have something undecided, one a violation."""
    chance = random.Random(20261120)
    base = base or solution_result(rubric)
    hints = {check.id: check.hint for check in rubric.checks()}
    entries = []
    for n in range(number):
        name = f"{FIRST[n % len(FIRST)]}_{LAST[(n * 7) % len(LAST)]}" + (
            str(n) if n >= len(FIRST) else ""
        )
        result = copy.deepcopy(base) | {"submission": name}
        result["provenance"] |= {"submission_sha256": hashlib.sha256(name.encode()).hexdigest()}
        weakness = min(1.9, max(0.0, chance.gauss(0.95, 0.5)))
        for slip in SLIPS:
            if chance.random() < slip.share * weakness:
                spoil(result, slip, chance, hints)
        if n in (11, 26):
            leave_open(
                result,
                "subscriber.rms",
                "The machine kept the node from a core for too long to tell.",
            )
        if n == 17:
            text = "/joint_state_subscriber published 40 messages on /joint_states, which is the reference node's topic."
            result["violations"] = [
                {
                    "kind": "publishes_on_reference_topic",
                    "session": "subscriber",
                    "text": text,
                    "certain": True,
                }
            ]
        if n == 5:
            late = {
                "kind": "late",
                "what": "2026-11-20 23:59 +01:00",
                "points": -10,
                "reason": "Handed in a day after it was due.",
            }
            result["adjustments"] = [late | {"who": "", "when": ""}]
        add_up(result)
        early = timedelta(minutes=chance.randrange(9000))
        at = DUE - early + timedelta(days=n == 5 and 7)
        entries.append(
            ClassEntry(name, read_result(result), "", report_link(name), at, f"{4100000 + 37 * n}")
        )
    if number > 33:
        there_is_none = "There is nothing in it that the lab asks for: no joint_publisher.py, no joint_subscriber.py."
        entries[33] = ClassEntry(
            entries[33].name, None, there_is_none, "", entries[33].submitted_at, "4101221"
        )
    return entries


def values(chance: random.Random) -> dict[str, Any]:
    """Draw the values that differ from student to student."""
    rate = chance.uniform(85, 95)
    modules = [f"{m}.py" for m in ("joint_publisher", "robot_service", "qos_comparison")]
    return {
        "rate": f"{rate:.1f}",
        "off": f"{100 - rate:.1f}",
        "file": chance.choice(("joint_publisher.py", "joint_subscriber.py", "robot_launch.py")),
        "other": chance.choice(("robot_service.py", "qos_comparison.py")),
        "docs": ", ".join(modules[: chance.randint(1, 3)]),
        "node": chance.choice(("joint_command_publisher", "/joint_command_publisher")),
        "topic": chance.choice(
            ("/joint_command", "/commands", "/joint_cmd", "/cmd_joints", "/jointcommands")
        ),
        "n": chance.randint(2, 40),
        "lines": chance.randint(30, 90),
        "exe": chance.choice(("state_subscriber", "joint_subsciber", "subscriber")),
        "package": chance.choice(("physical_ai_textbook", "lab_09", "ros_lab")),
    }


def check_of(result: dict[str, Any], name: str) -> dict[str, Any]:
    """Give a check of a result by its id."""
    return next(
        c for criterion in result["criteria"] for c in criterion["checks"] if c["id"] == name
    )


def spoil(result: dict[str, Any], slip: Slip, chance: random.Random, hints: dict[str, str]) -> None:
    """Add a mistake to a result, and put the checks that depend on it out of reach."""
    check = check_of(result, slip.check)
    if check["outcome"] != "passed":
        return
    earned = (Decimal(str(check["possible"])) * Decimal(slip.credit)).quantize(Decimal("0.1"))
    reason = slip.reason.format(**values(chance))
    outcome = "partial" if earned else "failed"
    check |= {
        "outcome": outcome,
        "earned": float(earned),
        "reason": reason,
        "hint": slip.hint or hints[slip.check],
    }
    for name in slip.blocks:
        reason = f"Not tested, because '{check['title']}' failed."
        check_of(result, name).update(outcome="not_reached", earned=0, reason=reason, hint="")


def leave_open(result: dict[str, Any], name: str, reason: str) -> None:
    """Let a check of a result be undecided."""
    check = check_of(result, name)
    check |= {
        "outcome": "inconclusive",
        "earned": 0,
        "undecided": check["possible"],
        "reason": reason,
        "hint": "",
    }


def add_up(result: dict[str, Any]) -> None:
    """Make sums over checks the points of criteria and of the whole."""
    for whole in result["criteria"]:
        for key in ("earned", "possible", "undecided"):
            whole[key] = float(sum(Decimal(str(c[key])) for c in whole["checks"]))
    for key in ("earned", "possible", "undecided"):
        result["score"][key] = float(sum(Decimal(str(c[key])) for c in result["criteria"]))
    adjusted = sum(Decimal(str(a["points"])) for a in result.get("adjustments", ()))
    result["score"]["final"] = float(Decimal(str(result["score"]["earned"])) + adjusted)
