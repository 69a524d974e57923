"""Reports and statistics that a node prints, as Lab 09-01 checks them, and the doubts that the machine leaves."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from grader.evidence.recorded import Recorded
from grader.recording.session import MachineSample, OutputLine, Usage
from grader.result import Finding, Outcome
from ros_bag.qos import Qos
from ros_bag.reading import Bag
from tests.synthetic import Session, at, judged, submission

REPORTED_SERIES = "reference/checks/reports.py:reported_series"
REPORTED_STATISTICS = "reference/checks/reports.py:reported_statistics"
COMMAND, STATE = "/commands", "/states"
STREAMS: dict[str, Any] = {
    "artifact": "it",
    "streams": {"command": COMMAND, "state": STATE},
    "field": "data",
}
PATTERN = r"RMS[^\d]*([\d.]+)"
SERIES = {
    **STREAMS,
    "pattern": PATTERN,
    "oracle": "reference/oracles.py:tracking_plateaus",
    "tolerance": 0.002,
}
SHARE = {**SERIES, "share": {"oracle": "reference/oracles.py:expected_reports", "costs": 1.0}}
STATISTICS = {
    **STREAMS,
    "label": "Mean",
    "key": "mean",
    "length": 7,
    "oracle": "reference/oracles.py:tracking_statistics",
    "parameters": {"history": 100},
    "report_pattern": PATTERN,
    "alternatives": [
        {"parameters": {"signed": True}, "meaning": "the signed error"},
        {"parameters": {"history": None}, "meaning": "the whole run", "credit": 0.5},
        {"parameters": {"history": 10}, "meaning": "the last 10 states", "credit": 1},
    ],
}
#: Error of all seven joints on each plateau of 40 states: of either sign, and never alike.
ERRORS = (0.9, 0.5, -0.2, 0.6)
STATES_EACH = 40


def stimulus(folder: Path, errors: tuple[float, ...] = ERRORS) -> tuple[Session, list[float]]:
    """Record four plateaus of commands, with states at zero; returns the times of the states as well."""
    session = Session(folder)
    starts = [1.0 + n for n in range(len(errors))]
    session.messages(COMMAND, [[error] * 7 for error in errors], [start - 0.1 for start in starts])
    times = []
    for start in starts:
        for n in range(STATES_EACH):
            times.append(start + 0.02 * n)
    session.messages(STATE, [[0.0] * 7] * len(times), times)
    return session, times


def with_reports(
    session: Session, times: list[float], factor: float = 1.0, every: int = 1
) -> Session:
    """Let a process report the RMS error on each state, or on every n-th."""
    lines = []
    for n, time_s in enumerate(times):
        if n % every == 0:
            lines.append(
                (
                    time_s + 0.001,
                    f"RMS tracking error: {factor * abs(ERRORS[n // STATES_EACH]):.4f} rad",
                )
            )
    return session.process("it", lines)


def vector(value: float, count: int = 7) -> str:
    """Give a vector as numpy prints it."""
    return "[" + " ".join([f"{value:.6f}"] * count) + "]"


def history(last: int | None) -> np.ndarray[Any, Any]:
    """Give the errors of the last states."""
    errors = np.repeat(ERRORS, STATES_EACH)
    return errors if last is None else errors[-last:]


# -- a report on each plateau ----------------------------------------------------------------------


def test_right_reports_pass(tmp_path: Path) -> None:
    """The right value on each plateau earns all."""
    finding = judged(REPORTED_SERIES, SERIES, with_reports(*stimulus(tmp_path)))
    assert finding.outcome is Outcome.PASSED
    assert finding.measured.startswith("right in 4 of 4 phases")


def test_one_wrong_plateau_costs_a_quarter(tmp_path: Path) -> None:
    """Each plateau counts the same."""
    session, times = stimulus(tmp_path)
    with_reports(session, times)
    output = session.record.processes[0].output
    for line in output[:STATES_EACH]:
        line.text = "RMS tracking error: 0.1234 rad"
    finding = judged(REPORTED_SERIES, SERIES, session)
    assert finding.credit == Decimal("0.75")
    assert "always" not in finding.reason
    assert "0.1234; right is 0.9000" in finding.reason


#: Errors that two decimals do not hold.
FINE = (0.0944, 0.0544, -0.0244, 0.0644)


@pytest.mark.parametrize(("form", "credit"), [("{:.2f}", 1), ("{:.1f}", 0), ("{:.1f}00", 0)])
def test_reports_count_as_they_are_rounded(tmp_path: Path, form: str, credit: int) -> None:
    """Two decimals are judged to these; coarser numbers are not taken for rounded ones."""
    session, times = stimulus(tmp_path, FINE)
    lines = []
    for n, t in enumerate(times):
        lines.append((t + 0.001, f"RMS: {form.format(abs(FINE[n // STATES_EACH]))} rad"))
    assert judged(REPORTED_SERIES, SERIES, session.process("it", lines)).credit == credit


HISTORY_INSTEAD = {"parameters": {"over": "history"}, "meaning": "all errors so far", "credit": 0.5}


def test_a_known_mistake_in_the_series_is_named(tmp_path: Path) -> None:
    """The RMS over all errors so far earns a part, with an example and the name of the mistake."""
    session, times = stimulus(tmp_path)
    squares = np.cumsum(np.repeat(ERRORS, STATES_EACH) ** 2) / np.arange(1, len(times) + 1)
    lines = []
    for t, value in zip(times, np.sqrt(squares), strict=True):
        lines.append((t + 0.001, f"RMS: {value:.4f}"))
    wanted = {**SERIES, "alternatives": [HISTORY_INSTEAD]}
    finding = judged(REPORTED_SERIES, wanted, session.process("it", lines))
    assert finding.credit == Decimal("0.5")
    assert finding.reason.endswith("right is 0.5000. Your numbers match all errors so far.")


def test_a_factor_that_the_rubric_knows_is_named(tmp_path: Path) -> None:
    """The root of the sum in place of the mean earns nothing, and is called that."""
    wanted = {
        **SERIES,
        "alternatives": [{"parameters": {"scale": 2.645751}, "meaning": "the root of the sum"}],
    }
    finding = judged(REPORTED_SERIES, wanted, with_reports(*stimulus(tmp_path), factor=7**0.5))
    assert finding.outcome is Outcome.FAILED
    assert finding.reason.endswith("Your numbers match the root of the sum.")


def test_a_right_series_is_no_known_mistake(tmp_path: Path) -> None:
    """A right series passes with any list of alternatives."""
    wanted = {
        **SERIES,
        "alternatives": [{"parameters": {}, "meaning": "what is right", "credit": 0}],
    }
    assert (
        judged(REPORTED_SERIES, wanted, with_reports(*stimulus(tmp_path))).outcome is Outcome.PASSED
    )


@pytest.mark.parametrize(("plateaus", "credit"), [(3, "1"), (2, "1"), (1, "0.5")])
@pytest.mark.parametrize("given", [{"least_reached": 0.5}, {"end_charged_by": "other"}])
def test_a_node_that_ended_is_judged_by_what_it_reached(
    tmp_path: Path, plateaus: int, credit: str, given: dict[str, Any]
) -> None:
    """Plateaus after a node's end do not count, but half of them must be reached."""
    session, times = stimulus(tmp_path)
    with_reports(session, times[: plateaus * STATES_EACH])
    run = session.record.processes[0]
    run.interrupted_ns, run.ended_by, run.exited_ns = None, "itself", run.output[-1].t_ns
    session.delayed("it", 2.0, 5.0)  # An ended process cannot be delayed.
    finding = judged(REPORTED_SERIES, {**SERIES, **given}, session)
    assert finding.credit == Decimal(credit)
    assert f"ended in phase {plateaus + 1} of 4" in finding.notes[0]


def test_no_report_fails(tmp_path: Path) -> None:
    """A node that never reports is told so."""
    session, _ = stimulus(tmp_path)
    finding = judged(REPORTED_SERIES, SERIES, session.process("it", interrupted_ns=None))
    assert finding.outcome is Outcome.FAILED
    assert "no tracking error" in finding.reason


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("try:\n    use()\nexcept: pass\n", "Line 3 of it.py hides each exception"),
        ("self.get_logger().debug('RMS')\n", "Line 1 of it.py logs at the level debug"),
    ],
)
def test_no_report_is_explained_by_the_source(tmp_path: Path, source: str, words: str) -> None:
    """A handler without a word and a quiet log are named with their lines."""
    session, _ = stimulus(tmp_path)
    session.process("it", interrupted_ns=None)
    finding = judged(REPORTED_SERIES, SERIES, session, submission({"it.py": source}))
    assert words in finding.reason
    assert finding.where[0].file == "it.py"


def test_statistics_without_a_number_are_quoted(tmp_path: Path) -> None:
    """An empty list behind the label is no missing line."""
    session = with_reports(*stimulus(tmp_path))
    session.record.processes[0].output.append(
        replace(session.record.processes[0].output[-1], t_ns=0, text="Mean: []")
    )
    finding = judged(REPORTED_STATISTICS, STATISTICS, session)
    assert finding.reason == "It prints 'Mean: []', without a number."


def test_what_a_node_reports_in_another_form_is_shown(tmp_path: Path) -> None:
    """A node that printed something else on each state is not said to be silent."""
    session, times = stimulus(tmp_path)
    lines = [(t + 0.001, "[INFO] [1.5] [it]: error of [0.1 0.2]") for t in times]
    finding = judged(REPORTED_SERIES, SERIES, session.process("it", lines))
    assert "it printed 160 others" in finding.reason
    assert "error of [0.1 0.2]'" in finding.reason


def test_a_node_that_stopped_reporting_loses_the_rest(tmp_path: Path) -> None:
    """Plateaus at the end without a report are lost."""
    session, times = stimulus(tmp_path)
    finding = judged(REPORTED_SERIES, SERIES, with_reports(session, times[: 2 * STATES_EACH]))
    assert finding.credit == Decimal("0.5")
    assert "no report during a whole phase" in finding.reason


@pytest.mark.parametrize(
    ("delay_s", "outcome"), [(3.0, Outcome.INCONCLUSIVE), (0.5, Outcome.PARTIAL)]
)
def test_silence_that_the_machine_may_have_caused_is_undecided(
    tmp_path: Path, delay_s: float, outcome: Outcome
) -> None:
    """A node was right as long as it spoke; only where it mostly had no core, the rest is undecided."""
    session, times = stimulus(tmp_path)
    with_reports(session, times[: 2 * STATES_EACH]).delayed("it", delay_s, 5.0)
    assert judged(REPORTED_SERIES, SERIES, session).outcome is outcome


@pytest.mark.parametrize(
    ("delay_s", "factor", "outcome"),
    [(3.5, 1.0, Outcome.INCONCLUSIVE), (0.5, 1.0, Outcome.PARTIAL), (3.5, 57.3, Outcome.FAILED)],
)
def test_reports_that_come_late_are_undecided_where_the_machine_kept_them(
    tmp_path: Path, delay_s: float, factor: float, outcome: Outcome
) -> None:
    """A node that works off a queue of its own may lag by a phase without a core; wrong numbers stay wrong there."""
    session, times = stimulus(tmp_path)
    with_reports(session, times, factor).delayed("it", delay_s, 5.0)
    process = session.record.processes[0]
    process.output = [replace(line, t_ns=line.t_ns + round(0.6e9)) for line in process.output]
    assert judged(REPORTED_SERIES, SERIES, session).outcome is outcome


def test_without_a_stimulus_nothing_is_decided(tmp_path: Path) -> None:
    """If commands were not recorded, that is the grader's fault."""
    states = (np.arange(20) / 100).tolist()
    recorded = Session(tmp_path).messages(STATE, [[0.0] * 7] * 20, states).process().recorded()
    assert judged(REPORTED_SERIES, SERIES, recorded).outcome is Outcome.INCONCLUSIVE
    assert judged(REPORTED_STATISTICS, STATISTICS, recorded).outcome is Outcome.INCONCLUSIVE


def test_a_pattern_that_is_none_is_a_mistake_of_the_rubric(tmp_path: Path) -> None:
    """A regular expression that does not compile is refused when the rubric loads."""
    with pytest.raises(ValidationError, match="not a valid regular expression"):
        judged(REPORTED_SERIES, {**SERIES, "pattern": "("}, Session(tmp_path))


def test_reports_that_the_grader_read_too_late_are_undecided(tmp_path: Path) -> None:
    """After a stall, the grader takes lines printed on one plateau for lines of the next."""
    session, times = stimulus(tmp_path)
    late = [(max(t, 3.7) if 1.9 < t < 3.7 else t) for t in times]
    lines = []
    for n, t in enumerate(late):
        lines.append((t + 0.001, f"RMS tracking error: {abs(ERRORS[n // STATES_EACH]):.4f} rad"))
    session.process("it", lines)
    session.record.machine = [MachineSample(at(n / 2), 0) for n in range(12)]
    assert judged(REPORTED_SERIES, SERIES, session.recorded()).outcome is Outcome.PARTIAL
    session.record.machine = [
        sample for sample in session.record.machine if not at(1.9) < sample.t_ns < at(3.7)
    ]
    assert judged(
        REPORTED_SERIES, SERIES, Recorded(session.record, Bag.open(session.folder))
    ).outcome is (Outcome.INCONCLUSIVE)


# -- the number of reports -------------------------------------------------------------------------


@pytest.mark.parametrize(("every", "credit"), [(1, 1.0), (2, 0.5), (10, 0.1)])
def test_the_share_of_reports_is_credited(tmp_path: Path, every: int, credit: float) -> None:
    """Nine reports for ten states are enough, and fewer earn their share in tenths."""
    finding = judged(REPORTED_SERIES, SHARE, with_reports(*stimulus(tmp_path), every=every))
    assert float(finding.credit) == pytest.approx(credit, abs=0.005)


@pytest.mark.parametrize(("every", "credit"), [(1, 1.0), (2, 0.875), (50, 0.75)])
def test_reports_that_are_missing_cost_their_share_alone(
    tmp_path: Path, every: int, credit: float
) -> None:
    """Right numbers on few states keep the credit that the rubric leaves."""
    parameters = {**SHARE, "share": {**SHARE["share"], "costs": 0.25}}
    finding = judged(REPORTED_SERIES, parameters, with_reports(*stimulus(tmp_path), every=every))
    assert float(finding.credit) == pytest.approx(credit, abs=0.005)


ONCE_MEANING = "There is one for each command."
ONCE = {
    "oracle": "reference/oracles.py:reports_once_per_command",
    "meaning": ONCE_MEANING,
    "credit": 0.5,
}


@pytest.mark.parametrize(("repeats", "credit"), [(20, 0.4375), (10, 0.875)])
def test_a_command_that_is_used_once_is_named(tmp_path: Path, repeats: int, credit: float) -> None:
    """A report for each command and not for each state is a known mistake; as few reports otherwise are not."""
    session = Session(tmp_path)
    times = []
    for plateau in range(4):
        for n in range(STATES_EACH):
            times.append(1.0 + plateau + 0.02 * n)
    session.messages(STATE, [[0.0] * 7] * len(times), times)
    step = STATES_EACH // repeats
    sent = [(n, time_s - 0.001) for n, time_s in enumerate(times) if n % step == 0]
    commands = [[ERRORS[n // STATES_EACH]] * 7 for n, _ in sent]
    session.messages(COMMAND, commands, [time_s for _, time_s in sent])
    parameters = {**SHARE, "share": {**SHARE["share"], "costs": 0.25, "fewer": [ONCE]}}
    with_reports(session, times, every=2)
    finding = judged(REPORTED_SERIES, parameters, session)
    assert float(finding.credit) == pytest.approx(credit, abs=0.005)
    assert (ONCE_MEANING in finding.reason) == (repeats == 20)


def test_output_that_was_not_kept_costs_nothing(tmp_path: Path) -> None:
    """A node that reported each state as long as its output was kept may have reported the others too."""
    session, times = stimulus(tmp_path)
    with_reports(session, times)
    process = session.record.processes[0]
    process.output, process.output_dropped_bytes = process.output[: len(process.output) // 2], 1000
    whole = judged(REPORTED_SERIES, SERIES, session)
    assert judged(REPORTED_SERIES, SHARE, session) == whole
    # The output after Ctrl-C is kept again.
    process.interrupted_ns = at(times[-1] + 1)
    process.output.append(OutputLine(at(times[-1] + 2), "stdout", "Mean: [1.0]"))
    assert judged(REPORTED_SERIES, SHARE, session) == whole


def test_printing_too_much_does_not_hide_that_reports_are_missing(tmp_path: Path) -> None:
    """A node that reported a tenth of the states while its output was kept earns a tenth."""
    session, times = stimulus(tmp_path)
    with_reports(session, times, every=10)
    session.record.processes[0].output_dropped_bytes = 1000
    assert judged(REPORTED_SERIES, SHARE, session).outcome is Outcome.PARTIAL


def test_reports_that_the_machine_kept_back_are_undecided(tmp_path: Path) -> None:
    """A starved node that reported half is undecided."""
    session = with_reports(*stimulus(tmp_path), every=2).delayed("it", 2.5, 5.0)
    assert judged(REPORTED_SERIES, SHARE, session).outcome is Outcome.INCONCLUSIVE


def test_short_delays_lose_no_reports_while_the_queue_has_room(tmp_path: Path) -> None:
    """A node with a queue of ten has not lost half by many short delays, and one without may have."""
    queue = Qos("reliable", "volatile", "keep_last", 10)
    for name, qos, outcome in (
        ("a", queue, Outcome.PARTIAL),
        ("b", replace(queue, depth=1), Outcome.INCONCLUSIVE),
    ):
        session = with_reports(*stimulus(tmp_path / name), every=2).delayed("it", 2.5, 5.0)
        samples = [Usage(at(t / 100), 0, round(t / 100 * 0.08 * 1e9)) for t in range(0, 500, 50)]
        session.record.processes[0].usage = samples
        session.claim("subscription", "/commands", qos=qos).claim(
            "subscription", "/states", qos=qos
        )
        assert judged(REPORTED_SERIES, SHARE, session).outcome is outcome


def test_only_a_disturbance_that_fills_the_queue_loses_reports(tmp_path: Path) -> None:
    """A second and a half in short pieces loses nothing that a queue of ten holds; in one piece it may."""
    queue = Qos("reliable", "volatile", "keep_last", 10)
    for name, delays, outcome in (
        ("a", [(n / 40, 0.008) for n in range(190)], Outcome.PARTIAL),
        ("b", [(1.0, 1.5)], Outcome.INCONCLUSIVE),
    ):
        session = with_reports(*stimulus(tmp_path / name), every=2).disturbed("it", *delays)
        session.claim("subscription", "/commands", qos=queue).claim(
            "subscription", "/states", qos=queue
        )
        assert judged(REPORTED_SERIES, SHARE, session).outcome is outcome


# -- statistics at the end -------------------------------------------------------------------------


def printed(folder: Path, value: float, count: int = 7, **how: Any) -> Finding:
    """Judge a node that reports on each state and prints a mean at the end."""
    session = with_reports(*stimulus(folder), **how)
    session.record.processes[0].output.append(
        replace(session.record.processes[0].output[-1], t_ns=0)
    )
    session.record.processes[0].output[-1].text = f"Mean: {vector(value, count)}"
    return judged(REPORTED_STATISTICS, STATISTICS, session)


def test_the_right_mean_passes(tmp_path: Path) -> None:
    """The mean of |error| over the history earns all."""
    assert printed(tmp_path, float(np.abs(history(100)).mean())).outcome is Outcome.PASSED


def test_a_forgotten_absolute_value_is_named(tmp_path: Path) -> None:
    """The signed mean fails and the reason says so."""
    finding = printed(tmp_path, float(history(100).mean()))
    assert finding.outcome is Outcome.FAILED
    assert finding.reason == "Your numbers match the signed error."
    assert f"{float(np.abs(history(100)).mean()):.4f}" in finding.expected


def test_another_history_earns_what_the_rubric_leaves(tmp_path: Path) -> None:
    """A known other history earns its credit, and is excused where that is all."""
    whole = printed(tmp_path / "whole", float(np.abs(history(None)).mean()))
    assert whole.credit == Decimal("0.5")
    ten = printed(tmp_path / "ten", float(np.abs(history(10)).mean()))
    assert (ten.outcome, ten.credit) == (Outcome.EXCUSED, Decimal(1))
    assert ten.reason == "Your numbers match the last 10 states."


def test_numbers_of_no_known_origin_fail_with_the_right_ones(tmp_path: Path) -> None:
    """For numbers without a known origin, the reason gives the right numbers."""
    finding = printed(tmp_path, 12.0)
    assert finding.outcome is Outcome.FAILED
    assert "Expected: [" in finding.reason


def test_a_mistake_that_another_check_charged_costs_nothing_again(tmp_path: Path) -> None:
    """An alternative that names a check which took points is excused here, and says so."""
    mean = float(np.abs(history(None)).mean())
    session = with_reports(*stimulus(tmp_path))
    session.record.processes[0].output.append(OutputLine(0, "stdout", f"Mean: {vector(mean)}"))
    alternative = {
        "parameters": {"history": None},
        "meaning": "the whole run",
        "credit": 0.5,
        "charged_by": ["first"],
    }
    wanted = {**STATISTICS, "alternatives": [alternative]}
    taken = Finding(Outcome.PARTIAL, Decimal("0.5"), "", "")
    finding = judged(REPORTED_STATISTICS, wanted, session, findings={"first": taken})
    assert (finding.outcome, finding.credit) == (Outcome.EXCUSED, Decimal(1))
    assert "charged under 'first'" in finding.reason
    given = Finding(Outcome.PASSED, Decimal(1), "", "")
    assert judged(
        REPORTED_STATISTICS, wanted, session, findings={"first": given}
    ).credit == Decimal("0.5")


@pytest.mark.parametrize(("each", "causes"), [(False, 1), (True, 0)])
def test_a_mistake_that_leaves_little_of_use_is_charged_in_each_check(
    tmp_path: Path, each: bool, causes: int
) -> None:
    """Without a cause in common, no other check has the charge."""
    mean = float(np.abs(history(None)).mean())
    session = with_reports(*stimulus(tmp_path))
    session.record.processes[0].output.append(OutputLine(0, "stdout", f"Mean: {vector(mean)}"))
    alternative = {"parameters": {"history": None}, "meaning": "the whole run", "each": each}
    finding = judged(REPORTED_STATISTICS, {**STATISTICS, "alternatives": [alternative]}, session)
    assert finding.outcome is Outcome.FAILED
    assert len(finding.causes) == causes


@pytest.mark.parametrize(
    ("stored", "words"),
    [
        ("self.error", "line 3 of it.py appends the same object each time."),
        ("self.error.copy()", "it holds far less."),
    ],
)
def test_the_line_of_one_stored_object_is_named(tmp_path: Path, stored: str, words: str) -> None:
    """Without such a line, the words of the rubric stand there."""
    source = f"class Node:\n    def on_state(self, m):\n        self.errors.append({stored})\n"
    mean = float(np.abs(history(None)).mean())
    session = with_reports(*stimulus(tmp_path))
    session.record.processes[0].output.append(OutputLine(0, "stdout", f"Mean: {vector(mean)}"))
    alternative = {
        "parameters": {"history": None},
        "meaning": "the last state alone",
        "stores_one_object": "it holds far less",
    }
    wanted = {**STATISTICS, "alternatives": [alternative]}
    finding = judged(REPORTED_STATISTICS, wanted, session, submission({"it.py": source}))
    assert finding.reason == f"Your numbers match the last state alone: {words}"
    is_named = "self.errors.append(self.error.copy())" in finding.hint
    assert is_named == (stored == "self.error")


@pytest.mark.parametrize(("status", "is_named"), [(1, True), (0, False)])
def test_an_interrupt_that_ends_a_program_is_named(
    tmp_path: Path, status: int, is_named: bool
) -> None:
    """A handler around another line is no help; a program that only prints the word ends without an error."""
    session = with_reports(*stimulus(tmp_path))
    process = session.record.processes[0]
    process.exit_status = status
    process.output.append(OutputLine(at(9.0), "stderr", "KeyboardInterrupt"))
    finding = judged(REPORTED_STATISTICS, STATISTICS, session)
    assert finding.outcome is Outcome.FAILED
    assert ("KeyboardInterrupt ended the program" in finding.reason) == is_named
    assert ("traceback" in finding.hint) == is_named


@pytest.mark.parametrize(("number", "credit"), [("0.06", 1), ("0.07", 0), ("0.060", 0)])
def test_two_decimals_are_enough(tmp_path: Path, number: str, credit: int) -> None:
    """Numbers printed with two decimals are compared to two decimals, others to all of theirs."""
    session, _ = stimulus(tmp_path, FINE)
    wanted = {
        **STATISTICS,
        "label": "Max",
        "key": "max",
        "parameters": {"history": 30},
        "alternatives": [],
    }
    finding = judged(
        REPORTED_STATISTICS, wanted, session.process("it", ["Max: [" + f"{number} " * 7 + "]"])
    )
    assert finding.credit == credit


def test_a_table_is_as_good_with_a_note(tmp_path: Path) -> None:
    """A column of a table after Ctrl-C counts, and the form that was asked for is told."""
    mean = float(np.abs(history(100)).mean())
    session = with_reports(*stimulus(tmp_path))
    run = session.record.processes[0]
    assert run.interrupted_ns is not None
    rows = ["Joint   Mean     Max", *(f"{n:5d}   {mean:.4f}   0.9" for n in range(7))]
    run.output += [OutputLine(run.interrupted_ns + 1, "stdout", row) for row in rows]
    finding = judged(REPORTED_STATISTICS, STATISTICS, session)
    assert finding.outcome is Outcome.PASSED
    assert "the lab asks for a line" in finding.notes[0]


SHORTER = {**STATISTICS, "shorter": {"session": "other", "least": 10, "most": 900}}


@pytest.mark.parametrize(
    ("lines", "facts", "credit"),
    [
        ([], {}, "0.5"),
        (["Not enough samples"], {}, "0.5"),
        (["Mean: [1.]"], {}, "1"),
        (["KeyboardInterrupt"], {}, "1"),
        ([], {"ended_by": "kill"}, "1"),
        ([], {"ended_by": "itself", "interrupted_ns": None}, "1"),
    ],
)
def test_statistics_must_come_after_a_shorter_run_too(
    tmp_path: Path, lines: list[str], facts: dict[str, Any], credit: str
) -> None:
    """A node that prints nothing where it was stopped earlier loses half, unless something else may have kept it."""
    session = with_reports(*stimulus(tmp_path))
    mean = float(np.abs(history(100)).mean())
    session.record.processes[0].output.append(OutputLine(0, "stdout", f"Mean: {vector(mean)}"))
    other = Session(tmp_path, "other")
    reports = [(1.0 + 0.01 * n, "RMS: 0.1") for n in range(50)]
    other.process(
        "joint_subscriber-2", [*reports, *((29.0, line) for line in lines)], artifact=None
    )
    run = other.record.processes[0]
    run.ended_by = "interrupt"
    for name, value in facts.items():
        setattr(run, name, value)
    finding = judged(REPORTED_STATISTICS, SHORTER, session, others={"other": other.recorded()})
    assert finding.credit == Decimal(credit)
    assert ("stopped after 50 reports" in finding.reason) == (credit != "1")


@pytest.mark.parametrize(("filled", "credit"), [(1.0, "1"), (0.5, "0")])
def test_empty_entries_of_a_history_are_no_errors(
    tmp_path: Path, filled: float, credit: str
) -> None:
    """Fifty reports leave half of a history of 100 empty; its zeros may not count."""
    session = with_reports(*stimulus(tmp_path))
    rms = float(np.sqrt((history(100) ** 2).mean()))
    session.record.processes[0].output.append(OutputLine(0, "stdout", f"RMS: {vector(rms)}"))
    other = Session(tmp_path, "other")
    lines = [(1.0 + 0.01 * n, "error RMS=0.1") for n in range(50)]
    diluted = 0.1 * float(np.sqrt(filled))
    other.process("joint_subscriber-2", [*lines, (29.0, f"RMS: {vector(diluted)}")], artifact=None)
    other.record.processes[0].ended_by = "interrupt"
    shorter = {**SHORTER["shorter"], "unfilled_credit": 0}
    wanted = {**SHORTER, "label": "RMS", "key": "rms", "shorter": shorter}
    wanted["report_pattern"] = r"RMS=([\d.]+)"
    finding = judged(REPORTED_STATISTICS, wanted, session, others={"other": other.recorded()})
    assert finding.credit == Decimal(credit)
    assert ("empty entries" in finding.reason) == (credit == "0")


@pytest.mark.parametrize(("filled", "credit"), [(1.0, "1"), (0.7, "1"), (0.4, "0")])
def test_a_mean_counts_no_empty_entries_either(tmp_path: Path, filled: float, credit: str) -> None:
    """Its size follows from the messages of the shorter run: 40 of them fill two fifths of a history of 100."""
    session = with_reports(*stimulus(tmp_path / "whole"))
    mean = float(np.abs(history(100)).mean())
    session.record.processes[0].output.append(OutputLine(0, "stdout", f"Mean: {vector(mean)}"))
    other = Session(tmp_path, "other")
    times = [1.0 + 0.01 * n for n in range(STATES_EACH)]
    other.messages(COMMAND, [[0.5] * 7], [0.9])
    other.messages(STATE, [[0.0] * 7] * STATES_EACH, times)
    lines = [(time_s + 0.001, "RMS: 0.5") for time_s in times]
    printed_line = f"Mean: {vector(0.5 * filled)}"
    other.process("joint_subscriber-2", [*lines, (29.0, printed_line)], artifact=None)
    other.record.processes[0].ended_by = "interrupt"
    shorter = {**SHORTER["shorter"], "unfilled_credit": 0}
    wanted = {**SHORTER, "shorter": shorter}
    finding = judged(REPORTED_STATISTICS, wanted, session, others={"other": other.recorded()})
    assert finding.credit == Decimal(credit)
    assert ("empty entries" in finding.reason) == (credit == "0")


@pytest.mark.parametrize(("late", "credit"), [(0, "1"), (4, "1"), (6, "0.3")])
def test_an_older_command_shows_at_the_start_of_each_phase(
    tmp_path: Path, late: int, credit: str
) -> None:
    """Some wrong reports at the start of each later phase are a queue; a few may be the machine's."""
    session, times = stimulus(tmp_path)
    lines = []
    for n, time_s in enumerate(times):
        place = n // STATES_EACH
        value = abs(ERRORS[place])
        if place:
            if n % STATES_EACH < late:
                value = 1.7
        lines.append((time_s + 0.001, f"RMS tracking error: {value:.4f} rad"))
    outdated = {"meaning": "an older command", "credit": 0.3}
    finding = judged(
        REPORTED_SERIES, {**SERIES, "outdated": outdated}, session.process("it", lines)
    )
    assert finding.credit == Decimal(credit)


def test_reports_of_a_status_line_count_one_by_one(tmp_path: Path) -> None:
    """A carriage return ends a report, and the source line of a traceback is none."""
    session = with_reports(*stimulus(tmp_path))
    mean = float(np.abs(history(100)).mean())
    session.record.processes[0].output.append(OutputLine(0, "stdout", f"Mean: {vector(mean)}"))
    traceback = ["Traceback (most recent call last):", '  File "it.py", line 3', "    RMS: 0.1"]
    for text, more, credit in (("\rRMS: 0.1" * 50, [], "0.5"), ("RMS: 0.1", traceback * 20, "1")):
        other = Session(tmp_path / credit, "other")
        other.process("joint_subscriber-2", [text, *more], artifact=None)
        finding = judged(REPORTED_STATISTICS, SHORTER, session, others={"other": other.recorded()})
        assert finding.credit == Decimal(credit)


def test_another_number_of_joints_fails(tmp_path: Path) -> None:
    """Six right numbers are not seven."""
    finding = printed(tmp_path, float(np.abs(history(100)).mean()), 6)
    assert finding.outcome is Outcome.FAILED
    assert "6 numbers are printed, not one for each of 7" in finding.reason


def test_statistics_over_what_a_node_received_pass(tmp_path: Path) -> None:
    """A node that lost states is judged over those that it reported, and a note says so."""
    session, times = stimulus(tmp_path)
    with_reports(session, times)
    output = session.record.processes[0].output
    kept = output[: 2 * STATES_EACH + 5] + output[3 * STATES_EACH :]
    errors = [ERRORS[0]] * 40 + [ERRORS[1]] * 40 + [ERRORS[2]] * 5 + [ERRORS[3]] * 40
    mean = float(np.abs(errors[-100:]).mean())
    session.record.processes[0].output = [*kept, replace(kept[-1], text=f"Mean: {vector(mean)}")]
    finding = judged(REPORTED_STATISTICS, STATISTICS, session)
    assert finding.outcome is Outcome.PASSED
    assert finding.expected.startswith(f"{finding.measured} from the ")
    assert "right for the 125 of 160 messages that the node reported" in finding.notes[0]


def test_a_loss_makes_no_right_history_too_long(tmp_path: Path) -> None:
    """Where lost messages let the right numbers fit the whole run as well, the node is taken at its word."""
    session, times = stimulus(tmp_path)
    with_reports(session, times)
    output = session.record.processes[0].output
    kept = [line for n, line in enumerate(output) if n < STATES_EACH or n % 3]
    errors = [ERRORS[0]] * 40 + [error for error in ERRORS[1:] for _ in range(27)]
    mean = float(np.abs(errors[-100:]).mean())
    session.record.processes[0].output = [*kept, replace(kept[-1], text=f"Mean: {vector(mean)}")]
    finding = judged(REPORTED_STATISTICS, STATISTICS, session)
    assert (finding.outcome, finding.reason) == (Outcome.PASSED, "")
    assert "from the 120 messages that the node reported" in finding.expected
    assert "right for the 120 of 160 messages that the node reported" in finding.notes[0]


def test_nothing_printed_fails_with_what_to_do(tmp_path: Path) -> None:
    """A node that prints nothing after Ctrl-C is told where to print."""
    finding = judged(REPORTED_STATISTICS, STATISTICS, with_reports(*stimulus(tmp_path)))
    assert finding.outcome is Outcome.FAILED
    assert "KeyboardInterrupt" in finding.hint


def test_a_node_that_had_to_be_killed_is_reported_so(tmp_path: Path) -> None:
    """A node that does not end after Ctrl-C fails for that, if it does so however often it is tried."""
    session = with_reports(*stimulus(tmp_path))
    session.record.processes[0].ended_by = "kill"
    finding = judged(REPORTED_STATISTICS, STATISTICS, session)
    assert finding.outcome is Outcome.INCONCLUSIVE
    assert finding.settled is not None
    assert "did not end in time" in finding.settled.reason


def test_a_node_that_ended_before_is_reported_why(tmp_path: Path) -> None:
    """An exception that ended the node before Ctrl-C is the reason."""
    session = with_reports(*stimulus(tmp_path))
    run = session.record.processes[0]
    frame = '  File "/ws/src/it.py", line 3, in hear'
    text = ["Traceback (most recent call last):", frame, "IndexError: list index out of range"]
    run.output += [OutputLine(at(6.0), "stderr", line) for line in text]
    run.interrupted_ns, run.ended_by, run.exited_ns = None, "itself", at(6.0)
    finding = judged(REPORTED_STATISTICS, STATISTICS, session)
    assert "IndexError" in finding.reason


def test_a_signal_in_the_midst_of_a_call_is_nobodys_fault(tmp_path: Path) -> None:
    """A Ctrl-C that rclpy turned into another error leaves the statistics undecided."""
    session = with_reports(*stimulus(tmp_path))
    text = "RuntimeError: Unable to convert call argument '0' to Python object"
    session.record.processes[0].output.append(OutputLine(session.record.ended_ns, "stderr", text))
    assert judged(REPORTED_STATISTICS, STATISTICS, session).outcome is Outcome.INCONCLUSIVE


# -- lines that are repeated -----------------------------------------------------------------------


def padded(
    session: Session, times: list[float], every: int, lines: int, apart_s: float = 0.0001
) -> Session:
    """Let a process report on every n-th state, each time in several lines."""
    describe_diagnosis = [(n, time_s) for n, time_s in enumerate(times) if n % every == 0]
    said = []
    for n, time_s in describe_diagnosis:
        for k in range(lines):
            said.append(
                (
                    time_s + 0.001 + k * apart_s,
                    f"RMS tracking error: {abs(ERRORS[n // STATES_EACH]):.4f} rad",
                )
            )
    return session.process("it", said)


@pytest.mark.parametrize(("every", "lines", "credit"), [(8, 8, 0.1), (2, 2, 0.5), (1, 2, 1.0)])
def test_a_repeated_line_is_no_further_report(
    tmp_path: Path, every: int, lines: int, credit: float
) -> None:
    """A report counts once for each state; to say everything twice costs nothing."""
    finding = judged(REPORTED_SERIES, SHARE, padded(*stimulus(tmp_path), every=every, lines=lines))
    assert float(finding.credit) == pytest.approx(credit, abs=0.005)
    assert ("that repeat one" in finding.measured) is (credit < 1)


def test_reports_that_came_together_are_no_repeats(tmp_path: Path) -> None:
    """A node that fell behind now and then reports on several states at once, each in a line of its own."""
    session, times = stimulus(tmp_path)
    with_reports(session, times)
    output = session.record.processes[0].output
    session.record.processes[0].output = [
        replace(o, t_ns=output[n - n % 4 + 3].t_ns) for n, o in enumerate(output)
    ]
    assert judged(REPORTED_SERIES, SHARE, session).outcome is Outcome.PASSED


def test_reports_that_the_grader_read_together_are_no_repeats(tmp_path: Path) -> None:
    """After a stall of the grader, all reports read at once came late."""
    session, times = stimulus(tmp_path)
    with_reports(session, times)
    for line in session.record.processes[0].output:
        line.t_ns = at(2.3) if at(1.3) < line.t_ns < at(2.3) else line.t_ns
    session.record.machine = [MachineSample(at(t / 10), 0) for t in range(0, 60) if not 13 < t < 23]
    assert judged(REPORTED_SERIES, SHARE, session).outcome is Outcome.PASSED


@pytest.mark.parametrize(
    ("every", "lines", "credit"), [(1, 1, 1.0), (3, 1, 0.3), (8, 1, 0.1), (8, 8, 0.1)]
)
def test_statistics_earn_the_share_of_the_states_that_they_are_over(
    tmp_path: Path, every: int, lines: int, credit: float
) -> None:
    """Numbers over those states alone on which the node reported are worth their share, also where it repeats lines."""
    session, times = stimulus(tmp_path)
    last = times[-STATES_EACH:]
    padded(session, last, every, lines)
    for line in session.record.processes[0].output:
        line.text = f"RMS tracking error: {abs(ERRORS[-1]):.4f} rad"
    session.record.processes[0].output.append(
        OutputLine(at(20.0), "stdout", f"Mean: {vector(abs(ERRORS[-1]))}")
    )
    wanted = {**STATISTICS, "parameters": {"history": 1000}, "alternatives": [], "full_from": 0.25}
    finding = judged(REPORTED_STATISTICS, wanted, session)
    assert float(finding.credit) == pytest.approx(credit, abs=0.005)
    assert ("missed the others" in finding.reason) == (credit < 1)


def test_right_statistics_are_shown_with_the_usual_digits(tmp_path: Path) -> None:
    """More digits are for numbers that lose points and would read as the right ones."""
    finding = printed(tmp_path, float(np.abs(history(100)).mean()))
    assert (finding.outcome, finding.reason) == (Outcome.PASSED, "")
    assert len(finding.measured) == len(vector(0.0)) - 7 * 2
