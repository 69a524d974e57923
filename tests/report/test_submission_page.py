"""The HTML report: its contents, and the harmlessness of student text in it."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import re
from collections.abc import Sequence
from decimal import Decimal
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from grader.evidence.recorded import Recorded
from grader.recording.session import OutputLine, ProcessRun, SessionRecord, StepRun
from grader.recording.submission import ArtifactFact, FileFact, SubmissionRecord
from grader.report.figures.graph import Call, CallGroup, QosRow
from grader.report.figures.link import LinkTable, Profile
from grader.report.figures.link import Outcome as Crossed
from grader.report.figures.plan import Branch, Item, Tree, Warned
from grader.report.figures.svg import Figure
from grader.report.submission_page import render
from grader.report.views import location_of
from grader.result import (
    CheckResult,
    CriterionResult,
    Finding,
    Location,
    Outcome,
    Result,
    Score,
)
from ros_bag.qos import Qos
from ros_bag.reading import Bag
from tests.report.taken_apart import Page
from tests.thorough import examples

START_NS = 1_800_000_000_000_000_000
EVIL = "\"'><script>alert(1)</script></style></pre><img src=x onerror=alert(2)>{{ 7*7 }}\x1b[31m\u202e\x00"


def check(
    identity: str, outcome: Outcome, earned: str, possible: str = "6", **finding: Any
) -> CheckResult:
    """Return a check's result."""
    undecided = Decimal(0) if outcome.decided else Decimal(possible)
    return CheckResult.of(
        Finding(outcome, Decimal(earned) / Decimal(possible), **finding),
        id=identity,
        title=f"Title of {identity}",
        session="alone",
        earned=Decimal(earned),
        possible=Decimal(possible),
        undecided=undecided,
    )


CHECKS = (
    check("a.good", Outcome.PASSED, "6", measured="all of it"),
    check(
        "a.half",
        Outcome.PARTIAL,
        "4.50",
        expected="100 Hz",
        measured="90 Hz",
        reason="It is slow.",
        hint="Use a timer.",
        where=(
            Location(file="node.py", line=3),
            Location(session="alone", topic="/cmd", start_s=1.23, end_s=7.29),
        ),
    ),
    check(
        "a.bad",
        Outcome.FAILED,
        "0",
        reason="It crashed.",
        where=(Location(session="alone", process="node"),),
    ),
    dataclasses.replace(
        check("a.after", Outcome.NOT_REACHED, "0", "2", reason="since 'x' failed"),
        blocked_by="a.half",
    ),
    check("a.open", Outcome.INCONCLUSIVE, "0", "4", reason="overloaded"),
    check("a.broken", Outcome.ERROR, "0", "1", reason="The check broke"),
)


def result_of(checks: Sequence[CheckResult] = CHECKS, **changes: Any) -> Result:
    """Return a result with one criterion."""
    zero = Decimal(0)
    earned = sum((c.earned for c in checks), zero)
    possible = sum((c.possible for c in checks), zero)
    undecided = sum((c.undecided for c in checks), zero)
    criterion = CriterionResult(
        "a", "Criterion A", earned, possible, undecided, tuple(checks), "What it is about"
    )
    result = Result("alice", "Lab 1: Nodes", Score(earned, possible, undecided), (criterion,))
    return dataclasses.replace(result, **changes)


def session(lines: Sequence[str] = ("hello",), **changes: Any) -> SessionRecord:
    """Return a session with one process."""
    output = []
    for n, text in enumerate(lines):
        output.append(OutputLine(START_NS + 10**9 + n * 10**6, "stderr", text))
    run = ProcessRun(
        "node",
        "student",
        ["python"],
        "node",
        START_NS,
        START_NS + 2 * 10**9,
        None,
        1,
        "interrupt",
        output,
    )
    step = StepRun(
        "wait_for", {"publisher": "/cmd"}, "topic", START_NS + 10**9, START_NS + 3 * 10**9
    )
    record = SessionRecord(
        "alone",
        started_ns=START_NS,
        ended_ns=START_NS + 8 * 10**9,
        complete=True,
        isolation={"level": "confined", "covers": ["own network"], "lacks": ["memory limit"]},
        processes=[run],
        steps=[step],
    )
    return dataclasses.replace(record, **changes)


def submission(text: str = "one\ntwo\n    three\nfour\nfive\nsix\n") -> SubmissionRecord:
    """Return a submission of one file."""
    return SubmissionRecord(
        "alice",
        files=[FileFact("node.py", 1, "")],
        texts={"node.py": text},
        artifacts=[
            ArtifactFact("node", "node.py", "node.py", "name"),
            ArtifactFact("other", "other.py"),
        ],
    )


def page_of(result: Result | None = None, figures: Sequence[Figure] = (), **more: Any) -> str:
    """Render a report."""
    sessions = more.get("sessions", {"alone": session()})
    recordings = {name: Recorded(record, Bag.empty()) for name, record in sessions.items()}
    return render(
        result or result_of(), {"a": figures}, recordings, more.get("submission", submission())
    )


def text_of(html: str) -> str:
    """Return a page's visible words, with single spaces."""
    return " ".join(Page(html).words.split())


def test_score_and_outcomes_are_in_words() -> None:
    """The score has no trailing zeros, and each outcome stands there as a word."""
    words = text_of(page_of())
    assert "10.5 of 25 points" in words
    assert "10.5 of 25 points now, up to 15.5" in words
    assert "5 still open: your instructor decides, you need do nothing" in words
    for word in ("passed", "partial", "failed", "not reached", "undecided"):
        assert word in words
    assert "4.5 / 6" in words
    assert "? / 4" in words
    assert "Recorded 2027-01-15 08:00 UTC · isolation: confined" in words


def test_an_undecided_check_names_the_rule_that_decided() -> None:
    """Decided checks show their proof instead, and results of earlier versions name no rule."""
    open_ = dataclasses.replace(CHECKS[4], decided_by="messages_dropped")
    lost = dataclasses.replace(CHECKS[1], decided_by="measured")
    words = text_of(page_of(result_of([lost, open_])))
    assert "Decided by the rule “messages dropped”" in words
    assert words.count("Decided by") == 1
    assert "Decided by" not in text_of(page_of())


def test_what_opens_most_comes_first() -> None:
    """Losses are sorted by the points that their fix opens, with their dependent checks; each stands there once, whole."""
    dear = dataclasses.replace(CHECKS[1], commands=("ros2 topic hz /cmd",))
    html = page_of(result_of([CHECKS[0], dear, *CHECKS[2:]]))
    fix = html[html.index('<section class="fix"') : html.index('<section class="still-open"')]
    assert re.findall(r'class="cost">−([\d.]+)<', fix) == ["6", "1.5"]
    assert re.findall(r'<article [^>]*id="([^"]+)"', fix) == ["check-a.bad", "check-a.half"]
    assert "Fix it, and 2 more points can be earned: Title of a.after (2)." in text_of(fix)
    assert "See it yourself ros2 topic hz /cmd Try again grade . --sessions alone" in text_of(fix)
    opening = dataclasses.replace(CHECKS[3], possible=Decimal(8))
    html = page_of(result_of([*CHECKS[:3], opening]))
    assert re.findall(r'class="cost">−([\d.]+)<', html) == ["1.5", "6"]


def test_one_fix_is_shown_once() -> None:
    """Checks that lost points by the same mistake are named beside the first of them."""
    again = dataclasses.replace(CHECKS[1], id="a.same", title="Title of a.same")
    html = page_of(result_of([CHECKS[1], again]))
    fix = html[html.index('<section class="fix"') : html.index("<main>")]
    assert fix.count("Use a timer.") == 1
    assert "1.5 more points can be earned: Title of a.same (1.5)." in text_of(fix)


def test_what_endangers_comes_before_what_opens_most() -> None:
    """A dangerous mistake stands first, though another one costs more, and says so."""
    dangerous = dataclasses.replace(CHECKS[1], endangers=True)
    html = page_of(result_of([CHECKS[0], dangerous, *CHECKS[2:]]))
    fix = html[html.index('<section class="fix"') : html.index('<section class="still-open"')]
    assert re.findall(r'<article [^>]*id="([^"]+)"', fix) == ["check-a.half", "check-a.bad"]
    assert "Fix this first: it can hurt people or damage the hardware." in text_of(fix)
    assert "Fix this first" not in text_of(page_of())


def test_cards_of_one_mistake_are_one_card() -> None:
    """The other checks with the same remedy, and excused ones, are folded."""
    again = dataclasses.replace(CHECKS[1], id="a.same")
    excused = check("a.excused", Outcome.EXCUSED, "6", reason="Charged under 'Title of a.half'.")
    html = page_of(result_of([CHECKS[1], again, excused]))
    assert re.findall(r'<article [^>]*id="([^"]+)"', html) == ["check-a.half"]
    assert re.findall(r'<details class="check (\w+)"', html) == ["partial", "excused"]


def test_the_card_with_the_charge_names_the_checks_that_it_spares() -> None:
    """An excused check links to the charge, and the charge links to it, also from a folded card of the same mistake."""
    again = dataclasses.replace(CHECKS[1], id="a.same", title="Title of a.same")
    spared = check("a.spared", Outcome.EXCUSED, "6", reason="It stopped, too.")
    for charging in ("a.half", "a.same"):
        excused = dataclasses.replace(spared, charged_by=(charging,))
        html = page_of(result_of([CHECKS[1], again, excused]))
        fix = html[html.index('<section class="fix"') : html.index("<main>")]
        words = "Charged here alone. The same mistake costs nothing in: Title of a.spared"
        assert words in text_of(fix)
        assert '<a href="#check-a.spared">' in fix
        assert f"Charged once, under Title of {charging}" in text_of(html)
    assert "Charged here alone" not in text_of(page_of())


def test_a_whole_file_is_marked_at_its_proof() -> None:
    """The excerpt links to the line; the mark names the check and its loss, and the whole file is there."""
    html = page_of()
    assert '<a href="#file-0-3">node.py:3</a>' in html
    file = html[html.index('<details class="session" id="file-0">') :]
    assert "6 lines, 1 marked" in text_of(html)
    assert re.search(
        r'<mark id="file-0-3">    three</mark><a class="mark-of" href="#check-a.half">', file
    )
    assert "\nsix\n" in file


def test_a_figure_stands_beside_the_loss_that_it_shows() -> None:
    """A figure stands with the first loss that it shows; without a loss it is folded with its criterion."""
    figure = Figure(table="plan", content=_PLAN, title="Plan", shows=("a.good", "a.half"))
    html = page_of(figures=[figure, dataclasses.replace(figure, shows=("a.good",))])
    fix, folded = (
        html[html.index('<section class="fix"') : html.index("<main>")],
        html[html.index("<main>") :],
    )
    assert fix.count("<figure") == folded.count("<figure") == 1


def test_a_bad_link_stands_beside_the_students_own_words() -> None:
    """The report has the arrived messages, the program's output, and the passage that the check of the explanation found."""
    outcome = Crossed(0.3, 0.688, np.array([0.010, 0.011, 0.012]), True, 4, 3)
    table = LinkTable(
        [Profile("fast", "best effort", "best effort", "", [outcome], "fast: 1001 msgs")], "a.good"
    )
    explained = check(
        "a.good",
        Outcome.PASSED,
        "6",
        counted=("latency: README.md", "README.md, line 3: “It is fresh.”"),
    )
    text = text_of(
        page_of(result_of([explained]), [Figure(table="link", content=table, title="Link")])
    )
    assert "68.8 % half in 11 ms 95 % in 11.9 ms late joiners: 3 of 4" in text
    assert "Your program printed, on this computer: fast: 1001 msgs" in text
    assert "From what you wrote, README.md, line 3: “It is fresh.”" in text


def test_the_ros_that_it_was_graded_on_is_named() -> None:
    """Where the handout was written for another distribution, both are named."""
    provenance: Any = {"versions": {"ros-jazzy-rclpy": "7.1.6"}, "handout_ros": "Humble"}
    assert "graded on ROS 2 Jazzy (the handout: Humble)" in text_of(
        page_of(result_of(provenance=provenance))
    )
    provenance["handout_ros"] = "Jazzy"
    assert "graded on ROS 2 Jazzy ·" in text_of(page_of(result_of(provenance=provenance)))


def test_every_link_has_a_target() -> None:
    """All links stay within the page and lead to an element; no id is used twice."""
    page = Page(page_of())
    ids = page.values("id")
    assert len(ids) == len(set(ids))
    for href in page.values("href"):
        assert href.startswith("#")
        assert href[1:] in ids


def test_a_remedy_for_several_checks_is_said_once() -> None:
    """The later checks of a criterion refer to the first one with the same hint."""
    checks = [
        check("a.one", Outcome.FAILED, "0", hint="Write a setup.cfg."),
        check("a.two", Outcome.PARTIAL, "4.50", hint="Write a setup.cfg."),
        check("a.open", Outcome.INCONCLUSIVE, "0", hint="Write a setup.cfg."),
    ]
    words = text_of(page_of(result_of(checks)))
    assert words.count("Write a setup.cfg.") == 1
    assert "The remedy is the same as for “ Title of a.one ”." in words


def test_lost_points_show_their_proof() -> None:
    """Expected, measured, reason, hint, the source line with its neighbours, and the span of a topic."""
    words = text_of(page_of())
    assert "It is slow. How to fix it Use a timer. Fix it, and 2 more" in words
    assert "Expected 100 Hz Measured 90 Hz Credit 75% of 6 points Where node.py:3" in words
    assert "1 one 2 two ▸3 three 4 four 5 five" in words
    assert "six" not in words[: words.index("Your files")]
    assert "recording 'alone', /cmd, 1.2–7.3 s" in words


def test_a_score_of_some_sessions_says_so() -> None:
    """Where only some sessions were asked for, the points are told to be theirs alone."""
    asked = dataclasses.replace(submission(), sessions=["alone", "other"])
    assert "only of the sessions alone, other" in text_of(page_of(submission=asked))
    assert "only of the session" not in text_of(page_of())


def test_the_time_of_a_call_is_reported_in_milliseconds() -> None:
    """A span of less than a second is told to the millisecond, so that two calls are told apart."""
    places = []
    for s in (0.671, 0.674):
        places.append(
            location_of(Location(session="alone", start_s=s, end_s=s + 0.002), {}, {}).text
        )
    assert places == ["recording 'alone', 0.671–0.673 s", "recording 'alone', 0.674–0.676 s"]


def test_lines_are_counted_as_python_does() -> None:
    """Form feeds and Unicode line separators do not end a line; CRLF is one end."""
    words = text_of(page_of(submission=submission("a\x0cb\r\nc\u2028d\r\nTHIS\r\ne\r\n")))
    assert "▸3 THIS" in words


def test_passed_checks_are_folded_and_others_open() -> None:
    """A check that is full is a closed `details`; the others need no click."""
    html = page_of()
    assert re.search(r'<details class="check passed" id="check-a.good">', html)
    assert re.search(r'<article class="check open partial" id="check-a.half">', html)


def test_nothing_is_fetched() -> None:
    """No element loads anything, no address stands in the page, and the policy allows only our own code."""
    html = page_of(figures=FIGURES)
    page = Page(html)
    assert page.tags().isdisjoint(
        {"link", "img", "iframe", "object", "embed", "form", "base", "image", "use"}
    )
    assert not page.values("src") + page.values("srcset") + page.values("style")
    assert "http:" not in html
    assert "https:" not in html
    assert "@import" not in html
    assert "url(" not in html
    policy = next(
        a["content"] for t, a in page.elements if a.get("http-equiv") == "Content-Security-Policy"
    )
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for code in page.scripts:
        digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy


_ITEM = Item(EVIL, EVIL, EVIL)
_BRANCH = Branch(EVIL, EVIL, EVIL, [EVIL], [EVIL], [_ITEM], [_ITEM], [(EVIL, EVIL)])
_PLAN = Tree(
    outcome="error",
    problem=EVIL,
    arguments=[_ITEM],
    includes=[_ITEM],
    environment=[_ITEM],
    processes=[_BRANCH],
    not_started=[_ITEM],
    warnings=[Warned(EVIL, EVIL)],
)
_QOS = QosRow(EVIL, "publisher", Qos(EVIL, EVIL, EVIL), EVIL, 3)
_LINK = LinkTable([Profile(EVIL, EVIL, "", EVIL, (), EVIL)], "a.bad", EVIL)
FIGURES = (
    Figure(
        EVIL,
        lambda canvas: canvas.text(1, 2, EVIL),
        (("line-0", EVIL),),
        title="Joints",
        session="alone",
    ),
    Figure(
        table="calls_table",
        content=[CallGroup(EVIL, EVIL, [Call(0.0, 0.001, {EVIL: EVIL})])],
        title="Calls",
    ),
    Figure(table="plan", content=_PLAN, title="Plan"),
    Figure(table="qos", content=[_QOS], title="QoS"),
    Figure(table="link", content=_LINK, title="Link"),
)


def hostile_page(evil: str) -> str:
    """Render a report with a student's text at every possible place."""
    finding: dict[str, Any] = dict.fromkeys(("expected", "measured", "reason", "hint"), evil)
    places = (
        Location(file=evil, line=1),
        Location(session=evil, topic=evil, process=evil),
        Location(file="node.py", line=1),
    )
    result = result_of(
        [check("a.bad", Outcome.FAILED, "0", where=places, counted=(f"“{evil}”",), **finding)],
        submission=evil,
        advisories=(evil,),
        problems=(evil,),
        provenance={"versions": {evil: evil}, "sessions": {evil: {"started_ns": START_NS}}},
    )
    record = session([evil], names={evil: evil}, problems=[evil])
    record.steps.append(StepRun("call", {"service": evil}, evil, result={"problem": evil}))
    record.processes[0].name = evil
    facts = submission(evil)
    facts.texts[evil] = evil
    facts.artifacts.append(ArtifactFact("x", "x.py", evil, "near miss", [evil]))
    facts.left_out.append(evil)
    recorded = Recorded(record, Bag.empty())
    return render(result, {"a": FIGURES}, {"alone": recorded, evil: recorded}, facts)


def assert_tame(html: str) -> None:
    """Assert that a page holds no element, attribute or character but ours."""
    page = Page(html)
    assert len(page.scripts) == 2
    assert page.tags().isdisjoint({"img", "iframe", "object", "link"})
    for _, attributes in page.elements:
        assert not [name for name in attributes if name.startswith("on")]
    assert not re.search(
        r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]", html
    )


def test_student_text_is_only_text() -> None:
    """Markup, template syntax and control characters of a student come out as words."""
    html = hostile_page(EVIL)
    assert_tame(html)
    assert "{{ 7*7 }}" in html
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in html


evil_parts = st.sampled_from(
    [
        "<script>",
        "</script>",
        "</style>",
        "<!--",
        "-->",
        "]]>",
        "&lt;",
        '"',
        "'",
        "\x1b[2J",
        "\u202e",
        "\x00",
        "\ud800",
    ]
)


@given(st.lists(evil_parts | st.text(max_size=12), max_size=8).map("".join))
@settings(max_examples=examples(40), deadline=None)
def test_any_student_text_is_only_text(evil: str) -> None:
    """Whatever students write, the page keeps its own elements and can be saved as UTF-8."""
    html = hostile_page(evil)
    html.encode()
    assert_tame(html)


def test_long_output_is_cut_in_the_middle() -> None:
    """First and last lines are shown with their times, and how many are left out between them."""
    record = session([f"line{n}." for n in range(1000)])
    words = text_of(page_of(result_of(CHECKS[:1]), sessions={"alone": record}))
    assert "line0." in words
    assert "line999." in words
    assert "line500." not in words
    assert "930 lines left out" in words
    assert "1.000 err line0." in words
    assert len(page_of(sessions={"alone": session(["x" * 10**6])})) < 200_000


def test_a_progress_bar_reads_as_its_last_state() -> None:
    """Overwritten text of a line is left out; a carriage return at its end overwrites nothing."""
    words = text_of(page_of(sessions={"alone": session(["10 %\r50 %\rdone", "whole\r", "a\rb\r"])}))
    assert "1.000 err done 1.001 err whole 1.002 err b" in words


def test_process_ends_are_reported() -> None:
    """The end of a process is put in words, with signals by their names."""
    record = session()
    record.processes[0].exit_status, record.processes[0].ended_by = -11, "itself"
    assert "ended by itself, signal SIGSEGV" in text_of(page_of(sessions={"alone": record}))
    record.processes[0].exit_status, record.processes[0].ended_by = -9, "kill"
    assert "did not end on Ctrl-C or SIGTERM; killed" in text_of(
        page_of(sessions={"alone": record})
    )


def test_a_second_start_is_separated_from_the_first() -> None:
    """Two processes of one name have outputs of their own, and findings lead to the later one."""
    record = session()
    record.processes.append(dataclasses.replace(record.processes[0]))
    html = page_of(sessions={"alone": record})
    assert "Output of node, start 1" in text_of(html)
    assert "Output of node, start 2" in text_of(html)
    assert 'href="#output-alone-1"' in html


def test_backticks_mark_code() -> None:
    """Text between backticks is set as code, and stays text; a single backtick stays unchanged."""
    hint = "Call `spin(<node>)` first"
    assert "Call <code>spin(&lt;node&gt;)</code> first" in page_of(
        result_of([check("a.x", Outcome.FAILED, "0", hint=hint)])
    )
    assert "a ` b" in page_of(result_of([check("a.x", Outcome.FAILED, "0", hint="a ` b")]))


def test_grader_troubles_are_marked_as_such() -> None:
    """Problems of the grader's side are told apart from mistakes; without them nothing is said."""
    assert "Trouble on the grader’s side" in page_of(
        result_of(problems=("alone: the recorder died",))
    )
    assert "Trouble on the grader’s side" not in page_of()


def test_full_score_has_nothing_to_fix() -> None:
    """A submission without lost points is told so."""
    words = text_of(page_of(result_of([check("a.good", Outcome.PASSED, "6")])))
    assert "Nothing: all points are earned." in words
    assert "undecided" not in words


def test_a_report_without_recordings_is_still_a_report() -> None:
    """Missing sessions, figures and provenance leave parts out and break nothing."""
    html = render(result_of(provenance={}), {}, {}, SubmissionRecord("alice"))
    assert "No session was recorded." in text_of(html)


def test_equal_results_give_equal_bytes() -> None:
    """Rendering twice gives the same page."""
    assert page_of(figures=FIGURES) == page_of(figures=FIGURES)
