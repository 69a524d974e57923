"""Checks of a publishing node: credit at the limits, and delays of the machine."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from grader.checks.base import apart
from grader.recording.session import Usage
from grader.result import Finding, Outcome
from tests.synthetic import BEST_EFFORT, FLOATS, RELIABLE, Session, at, evenly, judged, submission

TOPIC = "/commands"
PUBLISHED = {"artifact": "it", "topic": TOPIC, "type": FLOATS, "node": "/student"}
RATE = {
    "topic": TOPIC,
    "process": "it",
    "window": "window",
    "rate_hz": 100,
    "full_within": "2%",
    "zero_beyond": "20%",
}
JITTER = {
    "topic": TOPIC,
    "process": "it",
    "window": "window",
    "full_within_s": 0.003,
    "zero_beyond_s": 0.010,
}


def published(folder: Path, times_s: list[float], rows: list[list[float]] | None = None) -> Session:
    """Make a session with a node that publishes messages at these times, all within the window."""
    session = Session(folder).endpoint("publisher", TOPIC).process("it")
    session.messages(TOPIC, rows or [[0.0] * 7] * len(times_s), times_s)
    return session.window(times_s[0] - 0.001, times_s[-1] + 0.001)


def rate(folder: Path, rate_hz: float) -> Finding:
    """Judge a rate that is kept exactly."""
    return judged("topic_rate", RATE, published(folder, evenly(rate_hz, 6.0)))


# -- the topic -------------------------------------------------------------------------------------


def test_a_topic_as_asked_passes(tmp_path: Path) -> None:
    """Name, type and node as asked earn all, and the source line is shown."""
    session = published(tmp_path, evenly(10, 1.0)).claim("publisher", TOPIC, line=12)
    finding = judged("topic_published", PUBLISHED, session)
    assert finding.outcome is Outcome.PASSED
    assert str(finding.where[0]) == "it.py:12"


@pytest.mark.parametrize(
    ("wrong", "credit", "words"),
    [
        ({"topic": "/command"}, "0.4", "/command,"),
        ({"topic_type": "std_msgs/msg/String"}, "0.4", "std_msgs/msg/String"),
        ({"node": "/other"}, "0.8", "/other"),
        (
            {"topic": f"/arm{TOPIC}", "node": "/arm/student"},
            "0.4",
            "in its node's namespace, /arm.",
        ),
        ({"topic": "/command", "topic_type": "std_msgs/msg/String"}, "0", "/command"),
    ],
)
def test_each_wrong_name_costs_its_part(
    tmp_path: Path, wrong: dict[str, str], credit: str, words: str
) -> None:
    """A wrong topic or type costs 60 %, a wrong node name 20 %, and the reason names it."""
    topic = wrong.get("topic", TOPIC)
    session = Session(tmp_path).endpoint(
        "publisher", topic, wrong.get("node", "/student"), wrong.get("topic_type", FLOATS)
    )
    session.messages(topic, [[0.0]] * 5, evenly(4, 1.0)).called(f"{TOPIC}={topic}").process()
    finding = judged("topic_published", PUBLISHED, session)
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


@pytest.mark.parametrize(
    ("announced", "outcome"),
    [("ab", Outcome.PARTIAL), ("cd", Outcome.PASSED), ("", Outcome.PASSED)],
)
def test_a_type_announced_with_another_definition_costs_a_part(
    tmp_path: Path, announced: str, outcome: Outcome
) -> None:
    """The definition announced by a program costs points where the type is checked.

    Everything else is judged.
    """
    times = evenly(10, 1.0)
    session = Session(tmp_path).endpoint("publisher", TOPIC).process("it")
    session.messages(TOPIC, [[0.0] * 7] * len(times), times, type_hash="RIHS01_" + "cd" * 32)
    session.graph.endpoints[0].type_hash = f"RIHS01_{announced * 32}" if announced else ""
    finding = judged("topic_published", PUBLISHED, session)
    assert finding.outcome is outcome
    assert ("another definition (RIHS01_abababab" in finding.reason) == (outcome is Outcome.PARTIAL)


def test_a_namespace_before_the_node_costs_nothing(tmp_path: Path) -> None:
    """A node of the right name in a namespace is the right node."""
    session = Session(tmp_path).endpoint("publisher", TOPIC, "/arm/student").process()
    session.messages(TOPIC, [[0.0]] * 5, evenly(4, 1.0))
    assert judged("topic_published", PUBLISHED, session).outcome is Outcome.PASSED


def test_a_missing_file_is_said_to_be_missing(tmp_path: Path) -> None:
    """Without the file the check fails and says which name was asked for."""
    finding = judged("topic_published", PUBLISHED, Session(tmp_path), submission(it=None))
    assert finding.outcome is Outcome.FAILED
    assert finding.reason == "There is no it.py in the submission."


def test_a_silent_publisher_fails_and_its_exception_is_reported(tmp_path: Path) -> None:
    """The traceback of the process is the reason, with the student's line."""
    lines = [
        "Traceback (most recent call last):",
        '  File "/ws/src/it.py", line 9, in tick',
        "    self.pub.publish(nothing)",
        "NameError: name 'nothing' is not defined",
    ]
    session = (
        Session(tmp_path).endpoint("publisher", TOPIC).process("it", lines, interrupted_ns=None)
    )
    finding = judged("topic_published", PUBLISHED, session)
    assert finding.outcome is Outcome.FAILED
    assert "NameError" in finding.reason
    assert (finding.where[0].file, finding.where[0].line) == ("it.py", 9)


def missing(tmp_path: Path, session: str, module: str) -> Session:
    """Return a session with a program that ended at an import in its second line."""
    lines = ["Traceback (most recent call last):", '  File "/ws/src/it.py", line 2, in <module>']
    lines.append(f"ModuleNotFoundError: No module named '{module}'")
    return Session(tmp_path, session).process("it", lines, interrupted_ns=None)


@pytest.mark.parametrize(
    ("source", "module", "outcome"),
    [
        ("\nimport matplotlib\n", "matplotlib", Outcome.INCONCLUSIVE),
        ("\nfrom matplotlib import (\n    pyplot,\n)\n", "matplotlib", Outcome.INCONCLUSIVE),
        ("\nimport my_helpers\n", "my_helpers", Outcome.FAILED),
        ("\nprint('Traceback ...')\nimport matplotlib\n", "matplotlib", Outcome.FAILED),
        ("\nraise ModuleNotFoundError('matplotlib')\n", "matplotlib", Outcome.FAILED),
        ("\nimport numpy\n", "numpy", Outcome.FAILED),
    ],
)
def test_a_library_that_is_missing_here_is_for_a_person_to_decide(
    tmp_path: Path, source: str, module: str, outcome: Outcome
) -> None:
    """A node that ended at the import of a missing library is undecided.

    A node that only claims so has failed.
    """
    record = submission({"it.py": source})
    record.absent_modules = ["matplotlib"]
    finding = judged("topic_published", PUBLISHED, missing(tmp_path, "a", module), record)
    assert finding.outcome is outcome
    assert not finding.retry or outcome is Outcome.FAILED


def test_what_is_missing_is_missing_in_every_run(tmp_path: Path) -> None:
    """A program that ran on in another session did not lack the library there, nor here."""
    record = submission({"it.py": "\nimport matplotlib\n"})
    other = Session(tmp_path, "b").process("it", ["all is well"]).recorded()
    finding = judged(
        "topic_published",
        PUBLISHED,
        missing(tmp_path, "a", "matplotlib"),
        record,
        others={"b": other},
    )
    assert finding.outcome is Outcome.FAILED


@pytest.mark.parametrize(
    ("topic_type", "ended_by", "credit", "is_silent"),
    [
        (FLOATS, "interrupt", "0.2", True),
        ("std_msgs/msg/String", "interrupt", "0", True),
        (FLOATS, "itself", "0", False),
    ],
    ids=["running", "of another type", "ended"],
)
def test_a_silent_publisher_of_a_running_program_earns_a_part(
    tmp_path: Path, topic_type: str, ended_by: str, credit: str, is_silent: bool
) -> None:
    """One that was in the graph for a moment earns nothing, because the graph may have missed it."""
    session = Session(tmp_path).endpoint("publisher", TOPIC, topic_type=topic_type)
    interrupted_ns = at(20.0) if ended_by == "interrupt" else None
    session.process(ended_by=ended_by, interrupted_ns=interrupted_ns)
    finding = judged("topic_published", {**PUBLISHED, "silent_credit": 0.2}, session)
    assert (finding.credit, finding.is_silent) == (Decimal(credit), is_silent)


def test_a_silent_timer_is_reported_with_its_period(tmp_path: Path) -> None:
    """A node with a timer and without messages is told the timer's period, and of the clock that it may wait for."""
    session = Session(tmp_path).endpoint("publisher", TOPIC).process("it").claim("timer", "0.01")
    finding = judged("topic_published", PUBLISHED, session)
    assert finding.reason.endswith("The timer's period is 0.01 s.")
    assert "/clock" in finding.hint


def test_a_period_in_milliseconds_is_named(tmp_path: Path) -> None:
    """A timer that first fires after the end of the program was given another unit than seconds."""
    session = Session(tmp_path).endpoint("publisher", TOPIC).claim("timer", "20")
    session.process("it", interrupted_ns=at(20.0))
    finding = judged("topic_published", PUBLISHED, session)
    assert finding.reason.endswith("The timer's period is 20 s.")
    assert finding.hint.startswith("Give create_timer() its period in seconds")


def test_endpoints_of_reference_nodes_are_not_the_students(tmp_path: Path) -> None:
    """A publisher of our own on the topic is no publisher of the student's."""
    session = Session(tmp_path).endpoint("publisher", TOPIC, "/ours").process()
    finding = judged("topic_published", PUBLISHED, session, reference_nodes=["/ours"])
    assert finding.outcome is Outcome.FAILED


# -- the rate --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rate_hz", "credit"),
    [
        (100, 1.0),
        (98.0, 1.0),
        (102.0, 1.0),
        (97.5, 0.9),
        (94, 0.7),
        (110, 0.5),
        (80, 0.0),
        (50, 0.0),
        (121, 0.0),
    ],
)
def test_credit_for_a_rate_falls_in_even_steps(
    tmp_path: Path, rate_hz: float, credit: float
) -> None:
    """Within 2 % all is earned, from 20 % nothing, and in between a tenth less for each 1.8 %."""
    finding = rate(tmp_path, rate_hz)
    assert float(finding.credit) == pytest.approx(credit, abs=0.003)
    assert finding.outcome is {0.0: Outcome.FAILED, 1.0: Outcome.PASSED}.get(
        credit, Outcome.PARTIAL
    )


@pytest.mark.parametrize(
    ("rate_hz", "credit"), [(1000, 1.0), (300, 1.0), (98.5, 1.0), (90, 0.5), (80, 0.0), (2, 0.0)]
)
def test_a_least_rate_may_be_exceeded(tmp_path: Path, rate_hz: float, credit: float) -> None:
    """With `at_least` a higher rate earns full credit, and a lower one as much as without."""
    session = published(tmp_path, evenly(rate_hz, 6.0))
    finding = judged("topic_rate", {**RATE, "at_least": True}, session)
    assert float(finding.credit) == pytest.approx(credit, abs=0.05)
    assert finding.expected.startswith("at least 98 Hz for full credit")


def test_the_reason_says_slower_or_faster(tmp_path: Path) -> None:
    """A wrong rate is told with its direction and its number."""
    assert "90.0 Hz, 10.0% slower" in rate(tmp_path / "slow", 90).reason
    assert "110.0 Hz, 10.0% faster" in rate(tmp_path / "fast", 110).reason


@pytest.mark.parametrize(
    ("rate_hz", "period", "words"),
    [
        (
            10,
            "0.1",
            "Messages come at 10.0 Hz, 90.0% slower than 100 Hz. The timer's period is 0.1 s.",
        ),
        (1000, "0", "Messages come at 1000.0 Hz, 10 times 100 Hz. The timer's period is 0 s"),
        (50, "self.period", "50.0% slower than 100 Hz."),
    ],
)
def test_a_timer_that_gives_the_rate_is_named(
    tmp_path: Path, rate_hz: float, period: str, words: str
) -> None:
    """The period of the only timer is told, where the source says it."""
    session = published(tmp_path, evenly(rate_hz, 6.0)).claim("timer", period)
    reason = judged("topic_rate", RATE, session).reason
    assert words in reason
    assert ("period" in reason) == ("period" in words)


@pytest.mark.parametrize("shift_s", [0.0, 0.013, 0.049, 0.087])
def test_bursts_have_the_rate_of_all_their_messages(tmp_path: Path, shift_s: float) -> None:
    """Ten messages every 0.1 s are 100 Hz, wherever in a burst the window begins and ends."""
    times = []
    for burst in range(60):
        for n in range(10):
            times.append(1.0 + 0.1 * burst + 0.0001 * n)
    session = Session(tmp_path).endpoint("publisher", TOPIC).process("it")
    session.messages(TOPIC, [[0.0] * 7] * len(times), times).window(1.0 + shift_s, 6.9 + shift_s)
    assert judged("topic_rate", RATE, session).outcome is Outcome.PASSED
    assert "longest 9" in judged("topic_jitter", JITTER, session).measured


def test_of_a_window_without_messages_those_outside_are_not_told(tmp_path: Path) -> None:
    """Messages before or after the window give no rate."""
    session = (
        Session(tmp_path)
        .process("it")
        .messages(TOPIC, [[0.0] * 7] * 201, evenly(100, 2.0))
        .window(5.0, 6.0)
    )
    found = judged("topic_rate", RATE, session)
    assert (found.outcome, found.measured) == (Outcome.FAILED, "0 messages")


def test_samples_that_the_recorder_lost_do_not_lower_the_rate(tmp_path: Path) -> None:
    """The rate counts by sequence numbers, so that every third message lost changes nothing."""
    times = evenly(100, 6.0)
    kept = [(t, n) for n, t in enumerate(times, 1) if n % 3]
    session = Session(tmp_path).endpoint("publisher", TOPIC).process("it").window(0.9, 7.1)
    session.messages(
        TOPIC, [[0.0]] * len(kept), [t for t, _ in kept], sequence=[n for _, n in kept]
    )
    finding = judged("topic_rate", RATE, session)
    assert finding.outcome is Outcome.PASSED
    assert "100.00 Hz" in finding.measured


def test_a_rate_that_the_machine_may_have_lowered_is_undecided(tmp_path: Path) -> None:
    """A node delayed for as long as it is short of messages loses nothing."""
    times = [t for t in evenly(100, 6.0) if not 3.0 < t < 4.5]
    session = published(tmp_path, times).delayed("it", 1.6, 8.0)
    finding = judged("topic_rate", RATE, session)
    assert finding.outcome is Outcome.INCONCLUSIVE
    assert "the grading computer was too busy" in finding.reason


def test_the_machine_does_not_excuse_a_node_that_is_slow_by_itself(tmp_path: Path) -> None:
    """A timer of 80 Hz stays one of 80 Hz although the machine was busy for a while."""
    session = published(tmp_path, evenly(80, 6.0)).delayed("it", 1.6, 8.0)
    assert judged("topic_rate", RATE, session).outcome is Outcome.FAILED


@pytest.mark.parametrize("turn_s", [4.0, 8.0])
def test_a_rate_that_changes_for_good_is_judged_by_its_end(tmp_path: Path, turn_s: float) -> None:
    """The machine was busy for a moment, which is no excuse for half of the rate."""
    times = [*evenly(100, turn_s), *evenly(50, 9.5 - turn_s, 1.0 + turn_s + 0.02)]
    session = Session(tmp_path).endpoint("publisher", TOPIC).process("it").window(1.0, 10.5)
    session.messages(TOPIC, [[0.0] * 7] * len(times), times).disturbed("it", (3.0, 0.14))
    finding = judged("topic_rate", RATE, session)
    assert finding.outcome is Outcome.FAILED
    assert f"at 100.0 Hz for {turn_s:.1f} s, then at 50.0 Hz" in finding.reason


def test_a_change_that_the_delays_of_the_machine_explain_is_none(tmp_path: Path) -> None:
    """Under load, a loop with a sleep of 10 ms is slower for a while, by as much as it waited for its core."""
    slow = evenly(1 / 0.016, 2.4)
    usual = evenly(1 / 0.013, 7.0, 3.4)
    delays = [(t + 0.001, 0.006) for t in slow] + [(t + 0.001, 0.003) for t in usual]
    session = Session(tmp_path).endpoint("publisher", TOPIC).process("it").window(1.0, 10.4)
    times = [*slow, *usual]
    session.messages(TOPIC, [[0.0] * 7] * len(times), times).disturbed("it", *delays)
    finding = judged("topic_rate", RATE, session)
    assert finding.outcome is Outcome.INCONCLUSIVE
    assert "too busy to measure this" in finding.reason


def test_a_rate_that_changes_is_one_mistake_in_rate_and_spacing(tmp_path: Path) -> None:
    """Two rates make the intervals uneven; that is charged with the rate."""
    times = [*evenly(100, 5.0), *evenly(50, 4.5, 6.02)]
    session = published(tmp_path, times)
    rate, spacing = judged("topic_rate", RATE, session), judged("topic_jitter", JITTER, session)
    assert spacing.outcome is Outcome.FAILED
    assert rate.causes == spacing.causes == (f"changed rate of {TOPIC}",)
    uneven = published(
        tmp_path / "uneven",
        [t + (0.012 if n % 10 == 0 else 0) for n, t in enumerate(evenly(100, 6.0))],
    )
    assert judged("topic_jitter", JITTER, uneven).causes == ()


@pytest.mark.parametrize(
    ("source", "period", "hint"),
    [
        ("while True:\n    talk()\n    time.sleep(0.0125)\n", "", "Publish from a timer"),
        ("node.create_timer(0.0125, talk)\n", "0.0125", "Give the timer a period of 0.01 s."),
        ("node.create_timer(0.01, talk)\n", "0.01", "Keep the callback of the timer short"),
        ("talk()\n", "", ""),
    ],
)
def test_the_remedy_of_a_rate_is_by_the_source(
    tmp_path: Path, source: str, period: str, hint: str
) -> None:
    """A timer is asked for if a sleep paces the node, and a period if a timer has another one."""
    session = published(tmp_path, evenly(80, 6.0))
    if period:
        session.claim("timer", period, line=1)
    finding = judged("topic_rate", RATE, session, submission({"it.py": source}))
    assert finding.outcome is Outcome.FAILED
    assert finding.hint.startswith(hint)
    assert bool(finding.hint) == bool(hint)


@pytest.mark.parametrize("gap_s", [(5.0, 5.4), (6.2, 6.6)], ids=["in the middle", "near the end"])
def test_a_single_gap_is_no_change_of_the_rate(tmp_path: Path, gap_s: tuple[float, float]) -> None:
    """A gap costs its share of the rate in the whole window."""
    times = [t for t in evenly(100, 6.0) if not gap_s[0] < t < gap_s[1]]
    finding = judged("topic_rate", RATE, published(tmp_path, times))
    assert finding.outcome is Outcome.PARTIAL
    assert "changes" not in finding.reason


def test_a_starved_node_is_undecided_however_even_its_intervals(tmp_path: Path) -> None:
    """A node that gets its core every other time is even and slow, and its usual interval proves nothing then."""
    session = published(tmp_path, evenly(60, 6.0)).delayed("it", 3.6, 8.0)
    assert judged("topic_rate", RATE, session).outcome is Outcome.INCONCLUSIVE


def test_a_node_that_burns_its_core_has_itself_to_blame(tmp_path: Path) -> None:
    """Run-queue delay of a process that is busy all the time excuses nothing."""
    times = [t for t in evenly(100, 6.0) if not 3.0 < t < 4.5]
    session = published(tmp_path, times).delayed("it", 1.6, 8.0, cpu_s=8.0)
    assert judged("topic_rate", RATE, session).outcome is Outcome.FAILED


def stopped(rate_hz: float, stop_s: float) -> tuple[list[float], list[tuple[float, float]]]:
    """Give the times of a timer's messages when all stands still for a while every 0.1 s, and when that is."""
    stops = [(1.03 + n / 10, stop_s) for n in range(60)]
    times = evenly(rate_hz, 6.0)
    for start_s, length_s in stops:
        times = [start_s + length_s if start_s < t < start_s + length_s else t for t in times]
    return sorted(set(times)), stops


@pytest.mark.parametrize(
    ("rate_hz", "rate", "even"),
    [(100.0, Outcome.PASSED, Outcome.PASSED), (85.0, Outcome.PARTIAL, Outcome.PASSED)],
)
def test_what_the_machine_disturbs_is_judged_by_what_it_did_not(
    tmp_path: Path, rate_hz: float, rate: Outcome, even: Outcome
) -> None:
    """A quarter of the time all stands still; between, a right node is seen to be right and a slow one to be slow."""
    times, stops = stopped(rate_hz, 0.025)
    session = published(tmp_path, times).disturbed("it", *stops)
    finding = judged("topic_rate", RATE, session)
    assert finding.outcome is rate
    assert float(finding.measured.split()[0]) == pytest.approx(rate_hz, abs=0.1)
    assert judged("topic_jitter", JITTER, session).outcome is even


def test_what_is_uneven_between_disturbances_is_uneven(tmp_path: Path) -> None:
    """A stall of the machine excuses nothing at other times."""
    session = published(tmp_path, uneven(0.4, 0.0095)).disturbed(
        "it", *((1.03 + n, 0.1) for n in range(6))
    )
    assert judged("topic_jitter", JITTER, session).outcome is Outcome.FAILED


def test_without_enough_time_undisturbed_it_stays_undecided(tmp_path: Path) -> None:
    """Two adjacent undisturbed intervals are hardly found, and nothing is concluded from them."""
    times, stops = stopped(100.0, 0.06)
    session = published(tmp_path, times).disturbed("it", *stops)
    assert judged("topic_rate", RATE, session).outcome is Outcome.INCONCLUSIVE
    assert "too busy" in judged("topic_jitter", JITTER, session).reason


def test_two_messages_are_no_rate(tmp_path: Path) -> None:
    """With fewer than three messages the check fails and says how many came."""
    finding = judged("topic_rate", RATE, published(tmp_path, [1.0, 1.01]))
    assert finding.outcome is Outcome.FAILED
    assert finding.measured == "2 messages"


def test_where_no_window_opened_all_messages_count(tmp_path: Path) -> None:
    """A window that never opened leaves the whole session to be measured."""
    session = published(tmp_path, evenly(100, 3.0))
    session.record.steps.clear()
    assert judged("topic_rate", RATE, session).outcome is Outcome.PASSED


@pytest.mark.parametrize(
    ("lasted_s", "outcome"), [(1.0, Outcome.FAILED), (5.2, Outcome.PARTIAL), (5.9, Outcome.PASSED)]
)
def test_a_topic_that_ends_before_its_window_loses_by_the_time_that_is_missing(
    tmp_path: Path, lasted_s: float, outcome: Outcome
) -> None:
    """The right rate for a part of the window is not the right rate for all of it."""
    session = Session(tmp_path).endpoint("publisher", TOPIC).process("it").window(1.0, 7.0)
    times = evenly(100, lasted_s)
    finding = judged("topic_rate", RATE, session.messages(TOPIC, [[0.0]] * len(times), times))
    assert finding.outcome is outcome
    if outcome is not Outcome.PASSED:
        assert f"Messages stop after {lasted_s:.1f} s of the 6.0 s" in finding.reason
        assert "ran on without publishing" in finding.reason


def test_a_program_that_ends_within_the_window_loses_the_rate(tmp_path: Path) -> None:
    """A crash a second after the first message is told as the reason why the messages stop."""
    times = evenly(100, 1.0)
    session = (
        Session(tmp_path)
        .endpoint("publisher", TOPIC)
        .process("it", exit_status=139, ended_by="itself", interrupted_ns=None)
    )
    session.messages(TOPIC, [[0.0]] * len(times), times)
    session.step("observe", "window", "cancelled", parameters={"duration_s": 6.0})
    finding = judged("topic_rate", RATE, session)
    assert finding.outcome is Outcome.FAILED
    assert finding.measured.endswith("for 1.0 s, then nothing for 5.0 s")
    assert "ended by signal 11 (segmentation fault)" in finding.reason


def test_what_ended_a_program_within_the_window_is_shown(tmp_path: Path) -> None:
    """An exception is told with its line and its remedy, and not the pacing of messages."""
    times = evenly(100, 1.0)
    frame = '  File "/ws/src/it.py", line 3, in tick'
    lines = ["Traceback (most recent call last):", frame, "IndexError: list index out of range"]
    session = Session(tmp_path).endpoint("publisher", TOPIC).claim("timer", "0.01", line=9)
    session.process("it", lines, exit_status=1, ended_by="itself", interrupted_ns=None)
    session.messages(TOPIC, [[0.0]] * len(times), times)
    session.step("observe", "window", "cancelled", parameters={"duration_s": 6.0})
    record = submission({"it.py": "\n" * 20})
    finding = judged("topic_rate", RATE, session, record)
    assert str(finding.where[0]) == "it.py:3"
    assert finding.hint == "Check its length before an element is taken."


# -- evenness --------------------------------------------------------------------------------------


def uneven(share: float, by_s: float, rate_hz: float = 100) -> list[float]:
    """Return times at a rate, with a share of late ones.

    Each late time lengthens one interval and shortens the next.
    """
    times = np.array(evenly(rate_hz, 6.0))
    every = round(2 / share)
    times[1:-1:every] += by_s
    return [float(time_s) for time_s in times]


@pytest.mark.parametrize(("by_s", "credit"), [(0.0029, 1.0), (0.0065, 0.5), (0.0099, 0.014)])
def test_credit_for_evenness_falls_between_the_limits(
    tmp_path: Path, by_s: float, credit: float
) -> None:
    """With a tenth of the intervals off, their distance from the median decides."""
    finding = judged("topic_jitter", JITTER, published(tmp_path, uneven(0.2, by_s)))
    assert float(finding.credit) == pytest.approx(credit, abs=0.02)


def test_a_few_late_messages_cost_nothing(tmp_path: Path) -> None:
    """Late messages in clearly less than 5 % of the intervals are not noticed."""
    assert (
        judged("topic_jitter", JITTER, published(tmp_path, uneven(0.01, 0.009))).outcome
        is Outcome.PASSED
    )


def test_evenness_at_the_edge_of_what_a_sample_can_tell_is_undecided(tmp_path: Path) -> None:
    """In some hundred intervals, 4 % late may as well be 5 %. Another recording could differ."""
    finding = judged("topic_jitter", JITTER, published(tmp_path, uneven(0.04, 0.009)))
    assert finding.outcome is Outcome.INCONCLUSIVE
    assert "spans more than one" in finding.reason


def test_a_rate_at_the_edge_of_a_step_is_undecided(tmp_path: Path) -> None:
    """An error of the rate that spans more than one credit level leaves the rate undecided."""
    session = published(tmp_path, uneven(0.5, 0.004, rate_hz=97.82))
    finding = judged("topic_rate", RATE, session)
    assert finding.outcome is Outcome.INCONCLUSIVE
    assert "It earns at least 90% and at most 100% of the points." in finding.reason


def test_nothing_is_timed_by_a_clock_that_was_set(tmp_path: Path) -> None:
    """A step of the system's clock within the window leaves rate and evenness open; slewing does not."""
    for name, step_ms, outcome in (
        ("set", 30.0, Outcome.INCONCLUSIVE),
        ("slewed", 0.4, Outcome.PASSED),
    ):
        session = published(tmp_path / name, evenly(100, 10.0)).clock(
            {1.0: 0.0, 4.0: step_ms / 1e3}
        )
        assert judged("topic_rate", RATE, session).outcome is outcome
        assert judged("topic_jitter", JITTER, session).outcome is outcome


def test_unevenness_of_the_machine_is_undecided(tmp_path: Path) -> None:
    """Delays by the machine are left out, and possible effects of them cost nothing."""
    session = published(tmp_path, uneven(0.2, 0.008)).delayed("it", 2.0, 8.0)
    assert judged("topic_jitter", JITTER, session).outcome is Outcome.INCONCLUSIVE


# -- QoS -------------------------------------------------------------------------------------------


def test_best_effort_is_not_reliable(tmp_path: Path) -> None:
    """An offer of best effort where reliable is asked for fails, at the line of the tap."""
    session = (
        Session(tmp_path)
        .endpoint("publisher", TOPIC, qos=BEST_EFFORT)
        .claim("publisher", TOPIC, 31, BEST_EFFORT)
    )
    finding = judged("offered_qos", {"topic": TOPIC, "reliability": "reliable"}, session)
    assert finding.outcome is Outcome.FAILED
    assert "BEST_EFFORT" in finding.reason
    assert finding.where[0].line == 31


def test_a_wrong_depth_only_advises(tmp_path: Path) -> None:
    """The depth is a claim of the student's code, so that it costs nothing."""
    claim = replace(RELIABLE, history="keep_last", depth=1)
    session = Session(tmp_path).endpoint("publisher", TOPIC).claim("publisher", TOPIC, qos=claim)
    finding = judged(
        "offered_qos", {"topic": TOPIC, "reliability": "reliable", "depth": 10}, session
    )
    assert finding.outcome is Outcome.PASSED
    assert "depth is 1" in finding.notes[0]


def test_a_depth_left_to_the_middleware_is_reported_so(tmp_path: Path) -> None:
    """The system's default profile has no depth of its own."""
    claimed = replace(RELIABLE, history="system_default", depth=0)
    session = Session(tmp_path).endpoint("publisher", TOPIC).claim("publisher", TOPIC, qos=claimed)
    finding = judged(
        "offered_qos", {"topic": TOPIC, "reliability": "reliable", "depth": 10}, session
    )
    assert finding.notes == ("The depth is left to the middleware; the lab asks for 10.",)


def test_each_policy_asked_for_is_a_part(tmp_path: Path) -> None:
    """One of two policies right earns half."""
    session = Session(tmp_path).endpoint("publisher", TOPIC)
    wanted = {"topic": TOPIC, "reliability": "reliable", "durability": "transient_local"}
    assert judged("offered_qos", wanted, session).credit == Decimal("0.5")


def test_a_publisher_that_was_asked_for_and_not_seen_is_undecided(tmp_path: Path) -> None:
    """A running node asked for a publisher that was never seen; the discovery may have failed."""
    for name, outcome in ((TOPIC, Outcome.INCONCLUSIVE), ("/elsewhere", Outcome.FAILED)):
        session = Session(tmp_path / name.strip("/")).process("it").claim("publisher", name)
        assert judged("topic_published", PUBLISHED, session).outcome is outcome
    limited = (
        Session(tmp_path / "limited").process("it", limit="processes").claim("publisher", TOPIC)
    )
    finding = judged("topic_published", PUBLISHED, limited)
    assert (finding.outcome, "(limit: processes)" in finding.reason) == (Outcome.FAILED, True)
    crashed = [
        "Traceback (most recent call last):",
        '  File "/ws/src/it.py", line 9, in tick',
        "ValueError: no",
    ]
    session = Session(tmp_path / "crashed").process("it", crashed).claim("publisher", TOPIC)
    assert judged("topic_published", PUBLISHED, session).outcome is Outcome.FAILED


def test_a_second_publisher_does_not_make_up_for_the_first(tmp_path: Path) -> None:
    """The wrong one of two publishers counts, in either order."""
    for number, order in enumerate([(RELIABLE, BEST_EFFORT), (BEST_EFFORT, RELIABLE)]):
        session = published(tmp_path / str(number), evenly(100, 1.0))
        session.graph.endpoints.clear()
        for qos in order:
            session.endpoint("publisher", TOPIC, qos=qos)
        assert (
            judged("offered_qos", {"topic": TOPIC, "reliability": "reliable"}, session).outcome
            is Outcome.FAILED
        )


def test_a_second_publisher_does_not_lend_its_type(tmp_path: Path) -> None:
    """A publisher of the right type beside one of another is no publisher of the right type alone."""
    session = published(tmp_path, evenly(100, 1.0)).endpoint(
        "publisher", TOPIC, topic_type="std_msgs/msg/String"
    )
    assert judged("topic_published", PUBLISHED, session).outcome is Outcome.PARTIAL


def forged(folder: Path, arrivals_s: list[float]) -> Session:
    """Make a session with messages stamped every 10 ms that arrive at other times."""
    session = Session(folder).endpoint("publisher", TOPIC).process("it")
    for number, arrival_s in enumerate(arrivals_s, 1):
        stamp_s = 1.0 + number / 100
        session.messages(
            TOPIC, [[0.0] * 7], [stamp_s], sequence=[number], latency_s=arrival_s - stamp_s
        )
    return session.window(1.0, 1.0 + len(arrivals_s) / 100 + 0.005)


def test_stamps_that_do_not_tell_of_the_sending_earn_nothing(tmp_path: Path) -> None:
    """Messages that arrive unevenly or at another rate than they are stamped are judged by times of arrival."""
    uneven = forged(tmp_path / "uneven", [1.02 + n / 100 + 0.012 * (n % 2) for n in range(600)])
    finding = judged("topic_jitter", JITTER, uneven)
    assert finding.outcome is Outcome.FAILED
    assert "by times of arrival" in finding.measured
    slow = forged(tmp_path / "slow", [1.02 + n / 50 for n in range(600)])
    assert judged("topic_rate", RATE, slow).outcome is Outcome.FAILED


def test_messages_that_the_recorder_lost_at_the_end_are_no_silence(tmp_path: Path) -> None:
    """The next message tells by its number that those before it were sent, whether they were recorded or not."""
    times = evenly(100, 6.5, 1.0)
    for name, first, outcome in (("lost", 651, Outcome.PASSED), ("silent", 502, Outcome.PARTIAL)):
        session = (
            Session(tmp_path / name).endpoint("publisher", TOPIC).process("it").window(1.0, 7.0)
        )
        kept = [*enumerate(times[:501], 1), (first, times[-1])]
        session.messages(
            TOPIC, [[0.0]] * len(kept), [t for _, t in kept], sequence=[n for n, _ in kept]
        )
        assert judged("topic_rate", RATE, session).outcome is outcome


@pytest.mark.parametrize(
    ("delay_s", "outcome"), [(0.3, Outcome.INCONCLUSIVE), (0.0, Outcome.PARTIAL)]
)
def test_what_a_node_makes_up_for_in_the_window_may_be_the_machines(
    tmp_path: Path, delay_s: float, outcome: Outcome
) -> None:
    """A node with its own schedule sends at once all messages that were due before the window."""
    times = [1.0 + 0.0001 * n for n in range(30)] + evenly(100, 5.99, 1.01)
    session = published(tmp_path, times).delayed("it", delay_s, 1.0)
    session.record.processes[0].usage.append(Usage(at(8.0), 0, round(delay_s * 1e9)))
    assert judged("topic_rate", RATE, session).outcome is outcome


# -- numbers that agree with their verdict ---------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "limits", "places", "text"),
    [
        (99.96, (100.0,), 1, "99.96"),
        (100.0, (100.0,), 1, "100.0"),
        (2.0004, (2.0,), 2, "2.0004"),
        (59.7, (60.0, 10.0), 0, "59.7"),
        (1.0, (2.0,), 0, "1"),
        (1 / 3, (1 / 3 + 1e-13,), 2, "0.33"),
    ],
)
def test_a_number_reads_on_its_own_side_of_a_limit(
    value: float, limits: tuple[float, ...], places: int, text: str
) -> None:
    """A number gets enough decimal places to agree with the verdict, and no more than needed."""
    assert apart(value, *limits, places=places) == text


def test_a_rate_that_just_fails_does_not_read_as_the_one_wanted(tmp_path: Path) -> None:
    """A rubric may be stricter than the digits that are usually shown."""
    session = Session(tmp_path).messages("/t", [[0.0]] * 601, evenly(99.97, 6.0)[:601])
    session.window(1.0, 7.0)
    strict = {
        "topic": "/t",
        "process": "it",
        "window": "window",
        "rate_hz": 100,
        "full_within": "0.01%",
    }
    finding = judged("topic_rate", {**strict, "zero_beyond": "0.02%"}, session)
    assert finding.outcome is Outcome.FAILED
    assert "99.99 to 100.01 Hz" in finding.expected
    assert "100.0 Hz" not in finding.reason
    assert " 0.0%" not in finding.reason


@pytest.mark.parametrize(("used", "outcome"), [(TOPIC, Outcome.PASSED), ("/x", Outcome.FAILED)])
def test_a_publisher_on_another_topic_reaches_nothing(
    tmp_path: Path, used: str, outcome: Outcome
) -> None:
    """Another topic costs all of a profile with a type, by the cause of the check of the topic."""
    session = Session(tmp_path).called(f"{TOPIC}={used}").endpoint("publisher", used)
    session.messages(used, [[0.0]] * 2, [1.0, 2.0])
    wanted = {"topic": TOPIC, "reliability": "reliable", "type": FLOATS}
    finding = judged("offered_qos", wanted, session)
    assert finding.outcome is outcome
    published = judged(
        "topic_published", {"artifact": "it", "topic": TOPIC, "type": FLOATS}, session
    )
    assert published.causes == finding.causes
    assert bool(finding.causes) == (outcome is Outcome.FAILED)
