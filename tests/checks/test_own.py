"""A lab's own checks: arguments, mistakes at no cost to students, and copies in recordings."""

from __future__ import annotations

import json
import pickle
import shutil
import threading
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
import yaml

from grader import own_checks
from grader.checks import own
from grader.checks.registry import REGISTRY, former_checks
from grader.cli import main
from grader.errors import RubricError
from grader.judging.judge import Recordings, judge
from grader.judging.judgement import prepare
from grader.judging.rubrics import read_rubric, recorded_rubric, rubric_files
from grader.lab import references
from grader.lab.kept_lab import KEPT, lab_folder, named_files
from grader.lab.lab_code import LAB_MARKERS, LAB_TYPES
from grader.recording.submission import write_submission
from grader.result import CheckResult, Outcome, to_json
from grader.result_folder import RECORDINGS
from tests.synthetic import FLOATS, ROOT, Session, at, evenly, submission

TOPIC = "/commands"
RUBRIC = """\
lab: {id: own, title: Own, points: 3}
artifacts:
  it: {file: it.py}
sessions:
  experiment:
    steps:
      - start: {student: it}
      - wait_for: {publisher: /commands, type: std_msgs/msg/Float64MultiArray}
      - observe: {duration_s: 2, first_message_on: /commands}
        label: window
criteria:
  - id: all
    title: All
    points: 3
    checks:
      - id: mine
        points: 3
        session: experiment
        check: checks/mine.py:rises
        with: {topic: /commands, window: window, least: 5}
"""
HEAD = """\
from __future__ import annotations

from dataclasses import dataclass, field

from grader.own_checks import Context, FieldPath, Finding, Share, Topic, Window, failed, graded, passed


@dataclass
class Limits:
    low: float = 0.0
    high: float = 1.0


@dataclass
class Parameters:
    topic: Topic
    window: Window
    path: FieldPath = "data[0]"
    least: int = 3
    most: Share = 1.0
    limits: Limits = field(default_factory=Limits)


"""
RISES = """\
def rises(context: Context, p: Parameters) -> Finding:
    messages = context.messages(p.topic, p.window)
    values = [row[0] for row in messages.numbers(p.path)]
    rising = sum(b > a for a, b in zip(values, values[1:]))
    expected, measured = f"at least {p.least} rising", f"{rising} rising of {len(values)}"
    where = [context.location(p.topic, p.window)]
    if rising >= p.least:
        return passed(expected, measured, where=where)
    return graded(rising / p.least, expected, measured, "They fall.", where=where)
"""


def lab(folder: Path, body: str = RISES, rubric: str = RUBRIC) -> Path:
    """Write a lab with a check of its own; returns its rubric."""
    (folder / "lab/checks").mkdir(parents=True)
    (folder / "lab/checks/mine.py").write_text(HEAD + body, encoding="utf-8")
    (folder / "lab/rubric.yaml").write_text(rubric, encoding="utf-8")
    return folder / "lab/rubric.yaml"


def session(folder: Path, rows: list[list[float]] | None = None) -> Session:
    """Record ten messages with rising numbers, and a line of output."""
    rows = [[float(n)] for n in range(10)] if rows is None else rows
    made = Session(folder).endpoint("publisher", TOPIC).process("it", ["hello"])
    return made.messages(TOPIC, rows, evenly(10, 0.9)[: len(rows)]).window(0.5, 5.0)


def judged(rubric: Path, made: Session, left_out: Sequence[str] = ()) -> CheckResult:
    """Judge a recording by a rubric of one check."""
    record = submission()
    record.left_out = list(left_out)
    recordings = Recordings(record, {"experiment": made.recorded()})
    (found,) = judge(recordings, read_rubric(rubric)).checks
    return found


@pytest.mark.parametrize(
    ("rising", "outcome", "earned"), [(9, "passed", 3), (5, "passed", 3), (3, "partial", 1.8)]
)
def test_it_judges_by_the_messages(
    tmp_path: Path, rising: int, outcome: str, earned: float
) -> None:
    """Right, at the limit, and below it; with its parameters as the rubric gives them, and its location."""
    rows = [[float(min(n, rising))] for n in range(10)]
    found = judged(lab(tmp_path), session(tmp_path, rows))
    assert (found.outcome.value, float(found.earned)) == (outcome, earned), found.reason
    assert found.measured == f"{rising} rising of 10"
    assert str(found.where[0]) == "recording 'experiment', /commands, 0.5–5.0 s"


def test_it_sees_what_the_documentation_promises(tmp_path: Path) -> None:
    """Times in s since the session's start, processes with their output, steps, endpoints, the submission's files."""
    body = """\
def rises(context: Context) -> Finding:
    run, window = context.process("it"), context.window("window")
    seen = [
        context.seed, context.duration_s, list(context.nodes), window, run.role, run.ended_by, round(run.exited_s, 1),
        [(line.t_s, line.text) for line in run.lines], context.step("window").kind, context.step("none"),
        [e.node for e in context.endpoints("/commands")], context.endpoints("/commands", "subscription"),
        list(context.messages("/commands").sent_s[:2]), context.messages("/commands").type,
        len(context.messages("/no")), len(context.messages("/commands", "none")), context.delay_s("it", "window"),
        context.paths, context.text("it.py"), context.path_of("it"), context.path_of("that"), context.finding("mine"),
    ]
    return passed("", repr(seen))
"""
    text = RUBRIC.replace("        with: {topic: /commands, window: window, least: 5}\n", "")
    made = session(tmp_path)
    made.record.seed = 7
    found = judged(lab(tmp_path, body, text), made)
    assert eval(found.measured.replace("np.float64", "float")) == [
        *(7, 30.0, ["/student"], (0.5, 5.0), "student", "interrupt", 20.1),
        *([(2.0, "hello")], "observe", None, ["/student"], (), [1.0, 1.1], FLOATS, 0),
        *(0, 0.0, ("it.py",), "", "it.py", None, None),
    ]


WRONG = [
    ("raise KeyError('x')", "checks/mine.py, line 25: KeyError: 'x'"),
    ("return 5", "TypeError: a Finding is expected"),
    ("return passed('a', 'b', where=['here'])", "TypeError: a Finding is expected"),
    ("return helper()", "checks/mine.py, line 28: ZeroDivisionError: division by zero"),
    ("import nowhere", "checks/mine.py, line 25: ModuleNotFoundError: No module named 'nowhere'"),
    ("raise SystemExit(1)", "checks/mine.py, line 25: SystemExit: 1"),
    (
        "return Finding(passed('', '').outcome, passed('', '').credit * 5)",
        "its credit does not fit its outcome",
    ),
    (
        "return Finding(passed('', '').outcome, failed('', '', '').credit)",
        "its credit does not fit its outcome",
    ),
    ("return Finding(graded(0.5, '', '', '').outcome, 0.5)", "its credit does not fit its outcome"),
]


@pytest.mark.parametrize(("statement", "words"), WRONG, ids=[statement for statement, _ in WRONG])
def test_what_goes_wrong_in_it_costs_nothing(tmp_path: Path, statement: str, words: str) -> None:
    """The outcome is an error that names the lab's file and line; the session is not recorded again for it."""
    body = f"def rises(context: Context, p: Parameters) -> Finding:\n    {statement}\n\ndef helper():\n    return 1 / 0\n"
    found = judged(lab(tmp_path, body), session(tmp_path))
    assert found.outcome is Outcome.ERROR
    assert words in found.reason
    assert (float(found.undecided), found.retry) == (3.0, False)


@pytest.mark.parametrize("caught", ["except Exception", "except"])
def test_without_an_end_it_is_ended(
    caught: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An endless check is ended even if it catches every exception, or the ending itself once."""
    monkeypatch.setattr(own, "_MOST_CPU_S", 0.1)
    body = f"""\
def rises(context: Context, p: Parameters) -> Finding:
    try:
        while True:
            sum(range(1000))
    {caught}:
        pass
    while True:
        sum(range(1000))
"""
    found = judged(lab(tmp_path, body), session(tmp_path))
    assert found.outcome is Outcome.ERROR
    assert "it took more than 0.1 s of CPU time" in found.reason


def test_one_that_waits_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A waiting check uses no CPU, and is ended by its time.

    Catching every exception once does not help it.
    """
    monkeypatch.setattr(own, "_MOST_S", 0.1)
    body = """\
def rises(context: Context, p: Parameters) -> Finding:
    import time
    try:
        time.sleep(20)
    except:
        time.sleep(20)
    return passed("", "")
"""
    found = judged(lab(tmp_path, body), session(tmp_path))
    assert found.outcome is Outcome.ERROR
    assert "it took more than 0.1 s" in found.reason


def test_nothing_is_kept_waiting_where_a_check_could_not_be_ended(tmp_path: Path) -> None:
    """Judging is prepared in a thread, where no signal can end a check.

    No check is called there.
    """
    text = RUBRIC.replace("        session: experiment\n", "").replace(
        "topic: /commands, window: window, ", ""
    )
    called = tmp_path / "called"
    body = f"""\
from pathlib import Path
from grader.own_checks import Submission

@dataclass
class Least:
    least: int

def rises(submission: Submission, p: Least) -> Finding:
    Path({str(called)!r}).touch()
    return passed("", "")
"""
    rubric = read_rubric(lab(tmp_path, body, text))
    preparing = threading.Thread(target=prepare, args=[rubric])
    preparing.start()
    preparing.join()
    assert not called.exists()


def test_another_version_is_refused(tmp_path: Path) -> None:
    """A file without a version is taken for the current version."""
    found = judged(lab(tmp_path, RISES + "\nAPI_VERSION = 2\n"), session(tmp_path))
    assert found.outcome is Outcome.ERROR
    assert "written for version 2 of grader.own_checks, and this is version 1" in found.reason
    assert (
        judged(lab(tmp_path / "b", RISES + "\nAPI_VERSION = 1\n"), session(tmp_path / "b")).outcome
        is Outcome.PASSED
    )


def test_a_clock_that_was_set_leaves_it_open(tmp_path: Path) -> None:
    """A clock that was set leaves a check open without any code by its author."""
    made = session(tmp_path, [[0.0]] * 10).clock({0.5: 0.0, 1.0: 0.0, 1.5: 3.0, 2.0: 3.0})
    found = judged(lab(tmp_path), made)
    assert (found.outcome, "clock jumped" in found.reason) == (Outcome.INCONCLUSIVE, True)


def test_a_check_of_files_needs_no_session(tmp_path: Path) -> None:
    """A check of the submission needs no session; a check of the context must name its session."""
    body = """\
from grader.own_checks import Submission

def rises(submission: Submission) -> Finding:
    return passed("a file", f"{submission.paths[0]}, not {', '.join(submission.left_out)}")
"""
    text = RUBRIC.replace("        session: experiment\n        check", "        check")
    text = text.replace("        with: {topic: /commands, window: window, least: 5}\n", "")
    left_out = ["ws/build/: made by a tool"]
    found = judged(lab(tmp_path / "a", body, text), session(tmp_path), left_out)
    assert found.measured == "it.py, not ws/build/"
    with pytest.raises(RubricError) as caught:
        read_rubric(
            lab(tmp_path / "b", body.replace("submission: Submission", "submission: Context"), text)
        )
    assert "say which by the key session" in caught.value.mistakes[0]


#: A right text, its mistyped replacement, and words of the message; the message names the
#: replacement's line.
MISTYPED = [
    (
        "checks/mine.py:rises",
        "checks/mine.py:rise",
        "no function or class 'rise' in checks/mine.py; did you mean 'rises'?",
    ),
    (
        "checks/mine.py:rises",
        "checks/mint.py:rises",
        "no Python file 'checks/mint.py' beside the rubric; did you mean",
    ),
    ("checks/mine.py:rises", "checks/mine.py", "no function or class '' in checks/mine.py"),
    ("checks/mine.py:rises", "../lab/checks/mine.py:rises", "did you mean 'checks/mine.py'"),
    ("checks/mine.py:rises", "checks/mine.py:Limits", "Limits is a class; a check is a function"),
    (
        "checks/mine.py:rises",
        "checks/mine.py:no_arguments",
        "no_arguments must take (context: Context)",
    ),
    (
        "checks/mine.py:rises",
        "checks/mine.py:untyped",
        "the second argument of untyped must name the dataclass",
    ),
    ("topic: /commands, window", "topic: /comands, window", "did you mean '/commands'?"),
    ("topic: /commands, window", "topc: /commands, window", "unknown key; did you mean 'topic'?"),
    ("{topic: /commands, window: window, ", "{topic: /commands, ", "window: this key is missing"),
    (
        "window: window, least",
        "window: widow, least",
        "no step labelled 'widow' in session 'experiment'",
    ),
    ("least: 5", "least: five", "a whole number is expected"),
    ("least: 5", "most: 5", "a share from 0 to 1 is expected"),
    ("least: 5", "path: dta", "has no field 'dta'; did you mean 'data'?"),
    ("least: 5", "limits: {lo: 1}", "unknown key; did you mean 'low'?"),
    ("least: 5", "limits: {low: much}", "a number is expected"),
]


@pytest.mark.parametrize(
    ("old", "new", "words"), MISTYPED, ids=[f"{new} {words:.20}" for _, new, words in MISTYPED]
)
def test_what_is_mistyped_is_reported_without_running_it(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    """Mistakes in its name, parameters and references are found by the annotations of its file."""
    mark = tmp_path / "executed"
    more = f"\nimport pathlib\npathlib.Path({str(mark)!r}).touch()\ndef no_arguments():\n    pass\n"
    more += "\ndef untyped(context: Context, p: dict) -> Finding:\n    pass\n"
    text = RUBRIC.replace(old, new, 1)
    with pytest.raises(RubricError) as caught:
        read_rubric(lab(tmp_path, RISES + more, text))
    line = text[: text.index(new)].count("\n") + 1
    assert any(
        m.startswith(f"rubric.yaml:{line}: ") and words in m for m in caught.value.mistakes
    ), caught.value.mistakes
    assert not mark.exists()


def test_values_that_only_its_class_refuses_are_an_error(tmp_path: Path) -> None:
    """A value that only the class refuses is found at execution, as in `grade lab check`."""
    body = RISES.replace(
        "def rises",
        "def __post_init__(p):\n    raise ValueError('odd')\nParameters.__post_init__ = __post_init__\ndef rises",
    )
    found = judged(lab(tmp_path, body), session(tmp_path))
    assert (found.outcome, "odd" in found.reason) == (Outcome.ERROR, True)


def test_types_of_its_parameters_are_given_under_their_names() -> None:
    """All types but `FileBeside` are given.

    Recordings do not keep a file beside the rubric, and could not be judged again.
    """
    named = set()
    for name in vars(references):
        if hasattr(own_checks, name) and not name.startswith("_"):
            named.add(name)
    assert named == {*LAB_TYPES, *LAB_MARKERS}
    assert "FileBeside" not in LAB_TYPES


def result(results: Path) -> Any:
    """Read a result."""
    return json.loads((results / "result.json").read_text(encoding="utf-8"))


def test_its_recording_is_judged_again_without_the_lab(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file is kept beside the copy of the rubric; rubrics with such checks can be sent to other processes."""
    rubric = read_rubric(lab(tmp_path))
    assert named_files(rubric) == ["checks/mine.py"]
    assert pickle.loads(pickle.dumps(rubric)) == rubric
    recordings = tmp_path / "results/ann" / RECORDINGS
    session(recordings).recorded()
    write_submission(recordings, submission())
    for path, text in rubric_files(recordings, rubric).items():
        path.write_text(text or "", encoding="utf-8")
    shutil.rmtree(rubric.folder)
    assert (recordings / KEPT / "checks/mine.py").is_file()
    assert main(["regrade", str(recordings.parent)]) == 0
    assert result(recordings.parent)["score"]["earned"] == 3
    assert recorded_rubric(recordings / "rubric.yaml").lab.id == "own"
    capsys.readouterr()


def test_what_it_says_is_of_a_length_that_can_be_shown(tmp_path: Path) -> None:
    """The texts of a check may quote a student's program, and are cut to 1,000 characters."""
    body = 'def rises(context: Context) -> Finding:\n    return failed("x" * 10**6, "y" * 10**6, "z" * 10**6)\n'
    text = RUBRIC.replace("        with: {topic: /commands, window: window, least: 5}\n", "")
    found = judged(lab(tmp_path, body, text), session(tmp_path))
    assert max(map(len, (found.expected, found.measured, found.reason))) == 1000


def test_numbers_of_numpy_can_be_written(tmp_path: Path) -> None:
    """A location made by hand accepts the numbers that messages give."""
    body = """\
import numpy as np
from grader.own_checks import Location

def rises(context: Context) -> Finding:
    return passed("", "", where=[Location(file="it.py", line=np.int64(2)), Location(start_s=np.float32(0.5), end_s=1)])
"""
    text = RUBRIC.replace("        with: {topic: /commands, window: window, least: 5}\n", "")
    rubric, recorded = read_rubric(lab(tmp_path, body, text)), session(tmp_path).recorded()
    plain = json.loads(to_json(judge(Recordings(submission(), {"experiment": recorded}), rubric)))
    where = plain["criteria"][0]["checks"][0]["where"]
    assert (where[0]["line"], where[1]["start_s"]) == (2, 0.5)


SILENT = """\
def rises(context: Context, p: Parameters) -> Finding:
    messages = context.messages(p.topic, p.window)
    if len(messages):
        return passed("messages", "some")
    return failed("messages", "none", "Nothing is published.")
"""


def ended_at(folder: Path, module: str, name: str = "it") -> Session:
    """Record a program that ended at an import in its second line."""
    lines = ["Traceback (most recent call last):", '  File "/ws/src/it.py", line 2, in <module>']
    lines.append(f"ModuleNotFoundError: No module named '{module}'")
    return Session(folder).process(name, lines, interrupted_ns=None).window(0.5, 5.0)


@pytest.mark.parametrize("is_launched", [False, True])
@pytest.mark.parametrize(
    ("module", "outcome"),
    [
        ("matplotlib", Outcome.INCONCLUSIVE),
        ("team_msgs", Outcome.INCONCLUSIVE),
        ("my_helpers", Outcome.FAILED),
    ],
)
def test_what_is_missing_here_leaves_it_open(
    tmp_path: Path, module: str, outcome: Outcome, is_launched: bool
) -> None:
    """A library or interface that the grading computer lacks costs nothing, whether its author thought of it or not."""
    record = submission({"it.py": f"\nimport {module}\n"})
    record.absent_modules = ["matplotlib", "team_msgs"]
    record.not_built = {"team_msgs": "it took too long to build"}
    made = ended_at(tmp_path, module)
    if is_launched:
        made.record.processes[0].artifact = None
    recorded = made.recorded()
    rubric = read_rubric(lab(tmp_path, SILENT))
    (found,) = judge(Recordings(record, {"experiment": recorded}), rubric).checks
    assert found.outcome is outcome
    assert float(found.undecided) == (3.0 if outcome is Outcome.INCONCLUSIVE else 0.0)
    if module == "team_msgs":
        assert "took too long to build" in found.reason


def test_what_it_passes_is_passed_though_something_is_missing(tmp_path: Path) -> None:
    """Everything shown before the program ended counts."""
    record = submission({"it.py": "\nimport matplotlib\n"})
    record.absent_modules = ["matplotlib"]
    made = ended_at(tmp_path, "matplotlib").endpoint("publisher", TOPIC)
    made.messages(TOPIC, [[float(n)] for n in range(10)], evenly(10, 0.9))
    rubric = read_rubric(lab(tmp_path, SILENT))
    (found,) = judge(Recordings(record, {"experiment": made.recorded()}), rubric).checks
    assert found.outcome is Outcome.PASSED


# -- limits, commands, series ----------------------------------------------------------------------

LIMITED = """\
from pydantic import BaseModel, Field

from grader.own_checks import Part, check, not_reached, of_parts


class Limited(BaseModel):
    \"\"\"Values rise, and begin low.\"\"\"

    topic: Topic
    path: FieldPath = "data"
    least: int = Field(gt=0, description="Number of values that rise.")
    most: float | None = Field(None, ge=0)


@check(commands=("ros2 topic echo {topic}",))
def limited(context: Context, p: Limited) -> Finding:
    series = context.series(p.topic, p.path)
    if series is None:
        return not_reached("Nothing to compare.")
    values = series.only(series.sequence > 1).values[:, 0]
    rising = sum(b > a for a, b in zip(values, values[1:]))
    span_s = (series.sent_s[0], series.sent_s[-1])
    parts = [Part(rising / p.least, f"{rising} rising"), Part(float(len(context.rows(p.topic, p.path)) > 2))]
    return of_parts("rising values", parts, where=[context.location(p.topic, span_s=span_s)])
"""


def limited(folder: Path, **given: object) -> Path:
    """Write a lab with a check that limits its parameters and states a command."""
    values = json.dumps({"topic": TOPIC, "least": 16, **given})
    text = RUBRIC.replace("{topic: /commands, window: window, least: 5}", values)
    return lab(folder, LIMITED, text.replace("mine.py:rises", "mine.py:limited"))


def test_series_and_parts_lead_to_a_finding(tmp_path: Path) -> None:
    """Eight rising values of 16 earn half of a part; the proof is the span of the series."""
    found = judged(limited(tmp_path), session(tmp_path))
    assert (found.outcome, found.earned) == (Outcome.PARTIAL, Decimal("2.3"))
    assert "8 rising" in found.measured
    assert found.commands == ("ros2 topic echo /commands",)
    (where,) = found.where
    assert (where.topic, where.start_s, where.end_s) == (TOPIC, 1.0, 1.9)


def test_a_check_may_find_that_it_was_not_reached(tmp_path: Path) -> None:
    """Without a message there is nothing to judge."""
    empty = Session(tmp_path).process("it").window(0.5, 5.0)
    assert judged(limited(tmp_path), empty).outcome is Outcome.NOT_REACHED


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"least": 0}, "least"),
        ({"most": -1}, "most"),
        ({"least": "many"}, "a whole number is expected"),
        ({"lowest": 1}, "unknown key"),
    ],
)
def test_limits_hold_before_anything_is_executed(
    tmp_path: Path, given: dict[str, object], words: str
) -> None:
    """A value outside the limits of a field is a mistake of the rubric, with its line."""
    with pytest.raises(RubricError) as caught:
        read_rubric(limited(tmp_path, **given))
    assert any(words in mistake for mistake in caught.value.mistakes)


def test_the_schema_of_a_lab_describes_its_own_checks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An editor gets descriptions and limits of their parameters."""
    assert main(["rubric", str(limited(tmp_path)), "--schema"]) == 0
    model = json.loads(capsys.readouterr().out)["$defs"]["Limited"]
    assert model["description"] == "Values rise, and begin low."
    assert model["properties"]["least"]["exclusiveMinimum"] == 0
    assert model["properties"]["least"]["description"] == "Number of values that rise."
    assert model["required"] == ["topic", "least"]


def test_a_rubric_of_earlier_names_a_check_that_was_built_in(tmp_path: Path) -> None:
    """An old rubric finds the former built-in check in the shipped lab, with the same judgement."""
    former = yaml.safe_load(
        (lab_folder() / "reference/former_checks.yaml").read_text(encoding="utf-8")
    )
    values = "{topic: /commands, field: data, length: 1}"
    results: list[CheckResult] = []
    for name in ("message_values", former["message_values"]):
        text = RUBRIC.replace("{topic: /commands, window: window, least: 5}", values)
        rubric = tmp_path / "rubric.yaml"
        rubric.write_text(text.replace("checks/mine.py:rises", name), encoding="utf-8")
        shutil.rmtree(tmp_path / "reference", ignore_errors=True)
        if name != "message_values":
            shutil.copytree(ROOT / "reference", tmp_path / "reference")
        results.append(judged(rubric, session(tmp_path / f"{len(results)}")))
    built_in, own_now = results
    assert built_in.outcome is Outcome.PASSED
    assert built_in == own_now


def test_every_former_check_is_there() -> None:
    """Each leads to a function with parameters, and none is built in."""
    former = yaml.safe_load(
        (lab_folder() / "reference/former_checks.yaml").read_text(encoding="utf-8")
    )
    assert former.keys() == former_checks().keys()
    assert former.keys().isdisjoint(REGISTRY)


def test_a_decorator_with_other_arguments_is_a_mistake(tmp_path: Path) -> None:
    """Arguments of a decorator must be literals, because the file is read without executing it."""
    for wrong in ("commands=LINES", "topics=()"):
        folder = tmp_path / wrong[:4]
        rubric = limited(folder)
        file = folder / "lab/checks/mine.py"
        text = file.read_text(encoding="utf-8")
        file.write_text(text.replace('commands=("ros2 topic echo {topic}",)', wrong), "utf-8")
        with pytest.raises(RubricError) as caught:
            read_rubric(rubric)
        assert any("a decorator whose arguments" in each for each in caught.value.mistakes)


@pytest.mark.parametrize(
    ("trait", "outcome"), [("", "failed"), ("seeks=('publisher',)", "inconclusive")]
)
def test_an_endpoint_that_was_made_and_never_seen_is_undecided(
    tmp_path: Path, trait: str, outcome: str
) -> None:
    """A check that seeks an endpoint takes no points for one that a running program asked for."""
    body = LIMITED.replace('commands=("ros2 topic echo {topic}",)', trait)
    body = body.replace("return not_reached(", "return failed('', '', ")
    values = json.dumps({"topic": TOPIC, "least": 16})
    text = RUBRIC.replace("{topic: /commands, window: window, least: 5}", values)
    rubric = lab(tmp_path, body, text.replace("mine.py:rises", "mine.py:limited"))
    made = Session(tmp_path).process("it", interrupted_ns=at(4.0)).claim("publisher", TOPIC)
    assert judged(rubric, made.window(0.5, 5.0)).outcome.value == outcome
