"""Check of the numbers that a tool prints about the messages of its QoS profiles."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from grader.judging.judge import judge, open_recordings
from grader.judging.rubrics import read_rubric
from grader.result import Finding, Outcome
from tests.synthetic import RELIABLE, Session, at, evenly, given, judged, submission

REPORTED_TRAFFIC = "reference/checks/qos_report.py:reported_traffic"
TOPIC = "/test_fast"
REPORTED = {
    "artifact": "it",
    "rows": [{"name": "fast", "topic": TOPIC}],
    "pattern": r"(?P<count>\d+) msgs, avg latency: (?P<mean_ms>[\d.]+)ms, max: (?P<max_ms>[\d.]+)ms",
}
CLAIM = replace(RELIABLE, history="keep_last", depth=10)


# -- honesty ---------------------------------------------------------------------------------------


def reported(folder: Path, line: str, latency_s: float = 0.001, listens: bool = True) -> Finding:
    """Judge a printed line about a thousand messages."""
    session = Session(folder).endpoint("publisher", TOPIC).process("it", [line])
    if listens:
        session.endpoint("subscription", TOPIC)
    times = evenly(100, 9.99)
    session.messages(TOPIC, [[0.0]] * len(times), times, latency_s=latency_s)
    return judged(REPORTED_TRAFFIC, REPORTED, session)


def row(count: int = 1000, mean_ms: float = 1.0, max_ms: float = 3.0, name: str = "fast") -> str:
    """Give a line of results."""
    return f"{name:10}: {count:5} msgs, avg latency: {mean_ms:.2f}ms, max: {max_ms:.2f}ms"


def test_a_row_of_sides_that_cannot_connect_shows_nothing(tmp_path: Path) -> None:
    """No message is a true count; nothing was measured, and the reason names the policy."""
    session = Session(tmp_path).process(
        "it", [f"{'fast':10}:     0 msgs, avg latency: 0ms, max: 0ms"]
    )
    session.endpoint("publisher", TOPIC, qos=replace(RELIABLE, reliability="best_effort"))
    session.endpoint("subscription", TOPIC)
    session.messages(TOPIC, [[0.0]] * 101, evenly(100, 1.0))
    finding = judged(REPORTED_TRAFFIC, REPORTED, session)
    assert finding.credit == 0
    assert "so nothing was measured. The two sides of /test_fast are incompatible" in finding.reason


@pytest.mark.parametrize(("least", "credit"), [(0.5, "0.5"), (0.75, "0")])
def test_a_table_with_too_few_rows_that_can_have_messages_compares_nothing(
    tmp_path: Path, least: float, credit: str
) -> None:
    """A true row beside a row without messages is half of a table, or none, as the rubric says."""
    session = Session(tmp_path).process("it", [row(), row(0, name="slow")])
    times = evenly(100, 9.99)
    for topic, offered in ((TOPIC, "reliable"), ("/test_slow", "best_effort")):
        session.endpoint("publisher", topic, qos=replace(RELIABLE, reliability=offered))
        session.endpoint("subscription", topic)
        session.messages(topic, [[0.0]] * len(times), times, latency_s=0.001)
    rows = [*REPORTED["rows"], {"name": "slow", "topic": "/test_slow"}]
    finding = judged(REPORTED_TRAFFIC, {**REPORTED, "rows": rows, "least_matched": least}, session)
    assert finding.credit == Decimal(credit)
    assert ("for 1 of 2 rows" in finding.reason) == (credit == "0")


LAMBDA = "for name in names:\n    create_subscription(T, name, lambda m: on({}, m), 10)\n"


@pytest.mark.parametrize(("argument", "is_named"), [("name", True), ("m.name", False)])
def test_the_lambda_of_a_loop_is_named(tmp_path: Path, argument: str, is_named: bool) -> None:
    """All messages are counted for the last row, because a lambda sees the last value of its loop."""
    session = Session(tmp_path).process("it", [row(0), row(2000, name="slow")])
    times = evenly(100, 9.99)
    for topic in (TOPIC, "/test_slow"):
        session.endpoint("publisher", topic).endpoint("subscription", topic)
        session.messages(topic, [[0.0]] * len(times), times, latency_s=0.001)
    rows = [*REPORTED["rows"], {"name": "slow", "topic": "/test_slow"}]
    record = submission({"it.py": LAMBDA.format(argument)})
    finding = judged(REPORTED_TRAFFIC, {**REPORTED, "rows": rows}, session, record)
    assert finding.credit == 0
    assert ("the lambda in line 2" in finding.reason) == is_named
    assert (
        finding.hint.startswith("Keep the value as a default: lambda message, name=name")
        == is_named
    )


@pytest.mark.parametrize(
    ("line", "credit"),
    [
        (row(), "1"),
        (row(980), "1"),
        (row(1020), "1"),
        (row(970), "0"),
        (row(1030), "0"),
        (row(mean_ms=5.0, max_ms=9.0), "1"),
        (row(mean_ms=5.1, max_ms=9.0), "0.5"),
        (row(mean_ms=0.25, max_ms=9.0), "1"),
        (row(mean_ms=0.2, max_ms=9.0), "0.5"),
        (row(mean_ms=2.0, max_ms=1.0), "0.5"),
        (row(500, 50.0, 60.0), "0"),
        (row(name="test_fast"), "1"),
        (row(name="faster"), "0"),
        ("fast: no latency data", "0"),
    ],
)
def test_a_wrong_count_costs_all_and_a_wrong_latency_half(
    tmp_path: Path, line: str, credit: str
) -> None:
    """The count may be 2 % off; the mean latency must be one that can be, and no more than the maximum."""
    assert reported(tmp_path, line).credit == Decimal(credit)


@pytest.mark.parametrize(
    ("line", "credit"),
    [
        ("fast: received 1000, mean 0.001 s, worst 0.003 s", "1"),
        ("fast: 1000 messages, mean 1000 us", "0.75"),
        ("fast: 1000 messages", "0.5"),
    ],
)
def test_other_forms_are_judged_by_what_they_say(tmp_path: Path, line: str, credit: str) -> None:
    """Other words and units cost nothing, a missing maximum a quarter, a missing latency half."""
    assert reported(tmp_path, line).credit == Decimal(credit)


@pytest.mark.parametrize(("max_ms", "credit"), [(0.98, "0.5"), (1.0, "1")])
def test_the_slowest_of_many_messages_is_no_sooner_than_the_usual_one(
    tmp_path: Path, max_ms: float, credit: str
) -> None:
    """A mean that a quick program could have is impossible with a largest latency below the usual one."""
    finding = reported(tmp_path, row(mean_ms=0.5, max_ms=max_ms), latency_s=0.001)
    assert finding.credit == Decimal(credit)
    said = "half of the recorded messages took 1.00 ms or longer" in finding.reason
    assert said == (credit != "1")


@pytest.mark.parametrize(
    ("line", "said"), [("avg latency: 0.0010ms, max: 0.0030ms", True), (row(mean_ms=0.2), False)]
)
def test_seconds_that_are_called_milliseconds_are_named(
    tmp_path: Path, line: str, said: bool
) -> None:
    """A latency that a factor of 1000 puts right is told to be in s; another is not."""
    reason = reported(tmp_path, line if "msgs" in line else f"fast: 1000 msgs, {line}").reason
    assert "recorded was 1.00 ms." in reason
    assert ("The value is right in seconds" in reason) == said


@pytest.mark.parametrize(
    ("means_ms", "credit"), [((1000.0, 1000.0), "0.25"), ((1000.0, 1.0), "0.75"), ((1.0, 1.0), "1")]
)
def test_a_table_of_impossible_latencies_misleads(
    tmp_path: Path, means_ms: tuple[float, float], credit: str
) -> None:
    """Microseconds called ms make each row wrong, and cost more than a wrong latency in one row."""
    names = ("fast", "slow")
    lines = [row(1000, mean, 3 * mean, name) for name, mean in zip(names, means_ms, strict=True)]
    session = Session(tmp_path).process("it", lines)
    times = evenly(100, 9.99)
    for topic in (TOPIC, "/test_slow"):
        session.endpoint("publisher", topic).endpoint("subscription", topic)
        session.messages(topic, [[0.0]] * len(times), times, latency_s=0.001)
    rows = [*REPORTED["rows"], {"name": "slow", "topic": "/test_slow"}]
    finding = judged(REPORTED_TRAFFIC, {**REPORTED, "rows": rows}, session)
    assert finding.credit == Decimal(credit)
    is_named = "The value is right in µs; divide it by 1000 for ms." in finding.reason
    assert is_named == (max(means_ms) == 1000.0)


@pytest.mark.parametrize(
    ("means_ms", "credit"),
    [((1.25, 1.25, 1.25), "0.25"), ((1.25, 1.25, 1.26), "1"), ((0.01, 0.01, 0.01), "1")],
)
def test_rows_with_one_latency_are_of_one_list(
    tmp_path: Path, means_ms: tuple[float, float, float], credit: str
) -> None:
    """A list of latencies that all callbacks share prints the same numbers in each row; short ones may be equal."""
    names = ("fast", "slow", "late")
    lines = [row(1000, mean, 3 * mean, name) for name, mean in zip(names, means_ms, strict=True)]
    session = Session(tmp_path).process("it", lines)
    times = evenly(100, 9.99)
    latency_s = means_ms[0] / 1000
    rows = []
    for name, topic in zip(names, (TOPIC, "/test_slow", "/test_late"), strict=True):
        session.endpoint("publisher", topic).endpoint("subscription", topic)
        session.messages(topic, [[0.0]] * len(times), times, latency_s=latency_s)
        rows.append({"name": name, "topic": topic})
    finding = judged(REPORTED_TRAFFIC, {**REPORTED, "rows": rows}, session)
    assert finding.credit == Decimal(credit)
    assert ("so these are not their own" in finding.reason) == (credit == "0.25")


def test_what_was_never_sent_is_not_charged_in_the_report(tmp_path: Path) -> None:
    """A topic without traffic costs points for the traffic.

    A report of messages never sent is invented.
    """
    wanted = {
        **REPORTED,
        "rows": [{"name": "fast", "topic": TOPIC}, {"name": "slow", "topic": "/slow"}],
    }
    for name, lines, credit in (
        ("honest", [row()], "1"),
        ("liar", [row(), row(name="slow")], "0.5"),
    ):
        session = (
            Session(tmp_path, name).endpoint("publisher", TOPIC).endpoint("subscription", TOPIC)
        )
        session.messages(TOPIC, [[0.0]] * 1000, evenly(100, 9.99), latency_s=0.001).process(
            "it", lines
        )
        assert judged(REPORTED_TRAFFIC, wanted, session).credit == Decimal(credit)
    silent = Session(tmp_path, "silent").process("it", ["fast: 0 msgs, no latency data"])
    assert judged(REPORTED_TRAFFIC, REPORTED, silent).outcome is Outcome.NOT_REACHED


def test_numbers_without_a_subscription_are_invented(tmp_path: Path) -> None:
    """Right numbers earn nothing without a subscription."""
    finding = reported(tmp_path, row(), listens=False)
    assert finding.outcome is Outcome.FAILED
    assert "nothing subscribes" in finding.reason
    assert "to which nothing of the submission subscribes" in (finding.unmeasured or "")


@pytest.mark.parametrize(
    ("callback", "body", "keeps"),
    [
        ("self.on_message", "pass", False),
        ("self.on_message", "self.get_logger().info('got one')", False),
        ("lambda message: None", "pass", False),
        ("self.on_message", "self.count += 1", True),
        ("lambda message: self.times.append(message)", "pass", True),
        ("self.on_message_of(name)", "pass", True),
    ],
)
def test_a_callback_that_keeps_nothing_measures_nothing(
    tmp_path: Path, callback: str, body: str, *, keeps: bool
) -> None:
    """Right numbers keep their points, and a person looks at them."""
    source = "class It(Node):\n    def __init__(self):\n"
    source += f"        self.create_subscription(T, '/test_fast', {callback}, 10)\n"
    source += f"    def on_message(self, message):\n        {body}\n"
    session = Session(tmp_path).endpoint("publisher", TOPIC).process("it", [row()])
    times = evenly(100, 9.99)
    session.endpoint("subscription", TOPIC)
    session.messages(TOPIC, [[0.0]] * len(times), times, latency_s=0.001)
    finding = judged(REPORTED_TRAFFIC, REPORTED, session, submission({"it.py": source}))
    assert finding.outcome is Outcome.PASSED
    assert bool(finding.unmeasured) == (not keeps)
    assert keeps or "it.py, line 3" in (finding.unmeasured or "")


@pytest.mark.parametrize(("mean_ms", "max_ms"), [(1.0, 3.0), (50.0, 90.0)])
def test_counts_that_the_machine_may_have_lowered_are_undecided(
    tmp_path: Path, mean_ms: float, max_ms: float
) -> None:
    """After a delay of the tool, a count that is far too low neither loses nor earns points."""
    session = Session(tmp_path).endpoint("publisher", TOPIC).endpoint("subscription", TOPIC)
    times = evenly(100, 9.99)
    session.messages(TOPIC, [[0.0]] * len(times), times, latency_s=0.001)
    session.process("it", [row(850, mean_ms, max_ms)]).delayed("it", 3.0, 12.0)
    assert judged(REPORTED_TRAFFIC, REPORTED, session).outcome is Outcome.INCONCLUSIVE


@pytest.mark.parametrize(
    ("depth", "count", "delay_s", "outcome"),
    [
        (1, 960, 0.06, Outcome.PASSED),
        (1, 972, 0.01, Outcome.PASSED),
        (1, 800, 0.06, Outcome.FAILED),
        (10, 960, 0.06, Outcome.INCONCLUSIVE),
    ],
)
def test_a_count_may_lack_what_a_short_queue_did_not_hold(
    tmp_path: Path, depth: int, count: int, delay_s: float, outcome: Outcome
) -> None:
    """Some messages that came while the tool waited for a core are lost to a queue of one, and none to a longer one."""
    asked = replace(CLAIM, depth=depth)
    session = Session(tmp_path).endpoint("publisher", TOPIC).endpoint("subscription", TOPIC)
    session.claim("subscription", TOPIC, qos=asked)
    times = evenly(100, 9.99)
    session.messages(TOPIC, [[0.0]] * len(times), times, latency_s=0.001)
    # In each delay six messages come for a queue of one; or one comes and pushes out the one
    # before.
    session.process("it", [row(count)]).disturbed(
        "it", *((float(start_s), delay_s) for start_s in range(1, 11))
    )
    finding = judged(REPORTED_TRAFFIC, REPORTED, session)
    assert finding.outcome is outcome
    is_low = "(a full queue may have lost " in finding.measured
    assert is_low == (depth == 1)


@pytest.mark.parametrize(
    ("mean_ms", "outcome"),
    [(12.0, Outcome.PASSED), (18.0, Outcome.INCONCLUSIVE), (400.0, Outcome.PARTIAL)],
)
def test_a_latency_may_be_later_by_what_the_machine_makes_a_message_wait(
    tmp_path: Path, mean_ms: float, outcome: Outcome
) -> None:
    """A mean is right that is later by half of each delay, as often as there are delays; more than all of it is not."""
    session = Session(tmp_path).endpoint("publisher", TOPIC).endpoint("subscription", TOPIC)
    session.claim("subscription", TOPIC, qos=replace(CLAIM, depth=10))
    times = evenly(100, 9.99)
    session.messages(TOPIC, [[0.0]] * len(times), times, latency_s=0.001)
    # A delay of 30 ms in each 50 ms: a message waits 9 ms on average, and 4 ms are allowed in any case.
    session.process("it", [row(999, mean_ms, 500.0)], exited_ns=at(10.2))
    session.disturbed("it", *((n / 20, 0.03) for n in range(2, 200)))
    assert judged(REPORTED_TRAFFIC, REPORTED, session).outcome is outcome


def test_the_machine_does_not_excuse_counts_of_what_never_was(tmp_path: Path) -> None:
    """More messages than were published cannot come from a slow machine."""
    session = Session(tmp_path).endpoint("publisher", TOPIC).endpoint("subscription", TOPIC)
    times = evenly(100, 9.99)
    session.messages(TOPIC, [[0.0]] * len(times), times, latency_s=0.001)
    session.process("it", [row(1100)]).delayed("it", 2.0, 12.0)
    assert judged(REPORTED_TRAFFIC, REPORTED, session).outcome is Outcome.FAILED


@pytest.mark.parametrize(
    ("source", "outcome"),
    [
        ("RESULTS = {'fast': (1000, 0.91, 3.2), 'slow': (998, 1.13, 2.75)}", Outcome.FAILED),
        (
            "print('fast: 1000 msgs, avg 0.91 max 3.20')\nprint('slow: 998 msgs, avg 1.13 max 2.75')",
            Outcome.FAILED,
        ),
        ("N = [1000, 998]\nSECONDS = [0.00091, 3.2e-3, 0.00113, 2.75e-3]", Outcome.FAILED),
        (
            "# fast: 1000 msgs, avg 0.91 max 3.20\n# slow: 998 msgs, avg 1.31 max 2.57",
            Outcome.PASSED,
        ),
        ("RESULTS = (10.91, 13.2, 11.13, 12.75, 1000, 998)", Outcome.PASSED),
    ],
)
def test_numbers_that_stand_in_the_source_were_not_measured(
    tmp_path: Path, source: str, outcome: Outcome
) -> None:
    """If all printed values are constants, nothing was measured.

    An older result in a comment is no constant.
    """
    session = Session(tmp_path)
    for topic in (TOPIC, "/slow"):
        session.endpoint("publisher", topic).endpoint("subscription", topic)
        session.messages(topic, [[0.0]] * 1000, evenly(100, 9.99), latency_s=0.001)
    session.process("it", [row(1000, 0.91, 3.2), row(998, 1.13, 2.75, "slow")])
    wanted = {
        **REPORTED,
        "rows": [{"name": "fast", "topic": TOPIC}, {"name": "slow", "topic": "/slow"}],
    }
    finding = judged(REPORTED_TRAFFIC, wanted, session, submission({"it.py": source}))
    assert finding.outcome is outcome
    assert [place.file for place in finding.where[:1]] == [
        "it.py" if outcome is Outcome.FAILED else None
    ]


def test_a_pattern_without_its_groups_is_an_error_without_lost_points(tmp_path: Path) -> None:
    """The error names the groups."""
    finding = judged(
        REPORTED_TRAFFIC, {**REPORTED, "pattern": "(x)"}, Session(tmp_path).process("it")
    )
    assert finding.outcome is Outcome.ERROR
    assert "count, mean_ms and max_ms" in finding.reason


def test_a_line_in_the_form_asked_for_counts_before_others(tmp_path: Path) -> None:
    """Other lines that begin with a row's name are no results, before or after it."""
    for n, lines in enumerate(([row(), "fast | 1 | x"], ["fast | 1 | x", row()])):
        session = (
            Session(tmp_path, f"s{n}").endpoint("publisher", TOPIC).endpoint("subscription", TOPIC)
        )
        session.messages(TOPIC, [[0.0]] * 1000, evenly(100, 9.99), latency_s=0.001).process(
            "it", lines
        )
        assert judged(REPORTED_TRAFFIC, REPORTED, session).outcome is Outcome.PASSED


@pytest.mark.parametrize(
    ("check", "parameters"),
    [
        (REPORTED_TRAFFIC, {**REPORTED, "pattern": "("}),
        ("call_answered", {"artifact": "it", "step": "enable", "response": {}, "message": "("}),
        ("readme", {"parts": [], "commands": ["("]}),
    ],
)
def test_a_pattern_that_does_not_compile_is_a_mistake_of_the_rubric(
    check: str, parameters: dict[str, Any]
) -> None:
    """A regular expression that is none is refused when the rubric loads, like any other wrong parameter."""
    with pytest.raises(ValidationError, match="not a valid regular expression"):
        given(check, parameters)


@pytest.mark.parametrize("latency_s", [-0.2, 0.2])
def test_latencies_are_not_compared_with_stamps_of_ones_own(
    tmp_path: Path, latency_s: float
) -> None:
    """A program with arbitrary stamps gets no confirmation of its printed latency."""
    finding = reported(
        tmp_path, row(mean_ms=1e3 * latency_s, max_ms=1e3 * latency_s + 1), latency_s=latency_s
    )
    assert finding.credit == Decimal("0.5")
    assert "not their times of publication" in finding.reason


@pytest.mark.parametrize(
    ("line", "credit"),
    [
        ("fast: 1000 msgs, avg latency: 0 ms, max: 3 ms", "1"),
        ("fast: 1000 msgs, avg latency: 0.000 s, max: 0.003 s", "1"),
        ("FAST: 1000 msgs, avg latency: 0.40ms, max: 3.00ms", "1"),
        ("fast: 1000 msgs, avg latency: 0.00 ms, max: 0.00 ms", "0.5"),
        ("fast: 1000 msgs, avg latency: -1 ms, max: 3 ms", "0.5"),
    ],
)
def test_a_latency_is_judged_to_the_places_that_are_printed(
    tmp_path: Path, line: str, credit: str
) -> None:
    """0.4 ms may be printed as 0 ms, and not as 0.00 ms; no message arrives before it was sent."""
    assert reported(tmp_path, line, latency_s=0.0004).credit == Decimal(credit)


@pytest.mark.parametrize(
    ("kept", "words"),
    [
        ("qos_invented_numbers", "None of the 4 counts"),
        ("solution", None),
        ("best_effort_publisher", None),
    ],
)
def test_numbers_that_nothing_measured_are_for_a_person(kept: str, words: str | None) -> None:
    """None of a random generator's counts equals the number of messages.

    Measured counts, or none, raise no suspicion.
    """
    rubric = read_rubric(None)
    result = judge(
        open_recordings(Path(__file__).resolve().parents[2] / "recordings" / kept, rubric), rubric
    )
    found = [check.unmeasured for check in result.checks if check.unmeasured]
    assert [words in text for text in found if words] == ([True] if words else [])
    assert bool(found) == (words is not None)
