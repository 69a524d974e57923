"""Judging kept recordings: the verdicts, the same bytes each time, and nobody pays for the grader's faults."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from grader.checks import publisher as publisher_checks
from grader.checks import registry
from grader.checks.base import passed
from grader.checks.registry import REGISTRY, Check
from grader.classroom.expectations import Verdict, compare, load_fixture
from grader.errors import RecordingError
from grader.judging.attempts import undecided_sessions
from grader.judging.judge import Recordings, judge, judge_checks, open_recordings, violations_of
from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric
from grader.recording.session import OutputLine, SessionRecord, Usage, read_session, write_session
from grader.recording.submission import SUBMISSION_FILE, read_submission, write_submission
from grader.result import CheckResult, Finding, Outcome, Result, Score, to_json
from tests.synthetic import TEXT, Session, evenly, submission

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "tests/recordings"
SOLUTION = KEPT / "solution"
FIXTURES = sorted(path.name for path in KEPT.iterdir() if path.name != SOLUTION.name)


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


@pytest.fixture(scope="module")
def solution(rubric: Rubric) -> Recordings:
    """Give the recordings of the solution."""
    return open_recordings(SOLUTION, rubric)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Give a copy of the solution's recordings to damage."""
    shutil.copytree(SOLUTION, tmp_path / "recordings")
    return tmp_path / "recordings"


def checks_of(result: Result) -> dict[str, CheckResult]:
    """Give the results of all checks by their ids."""
    return {check.id: check for criterion in result.criteria for check in criterion.checks}


def findings_of(folder: Path, rubric: Rubric) -> dict[str, Finding]:
    """Return the findings of all checks for recordings."""
    recordings = open_recordings(folder, rubric)
    return judge_checks(recordings, rubric, violations_of(recordings, rubric))


@cache
def judged(name: str) -> Result:
    """Give the result of a kept recording."""
    rubric = read_rubric(None)
    return judge(open_recordings(KEPT / name, rubric), rubric)


def lost(result: Result) -> Decimal:
    """Give the points that are neither earned nor undecided."""
    return result.score.possible - result.score.earned - result.score.undecided


# -- verdicts --------------------------------------------------------------------------------------


def test_the_solution_has_all_points() -> None:
    """A correct submission scores 100, with nothing undecided and no problem."""
    result = judged(SOLUTION.name)
    assert result.score == Score(Decimal(100), Decimal(100), Decimal(0))
    assert result.problems == ()
    assert {check.outcome for check in checks_of(result).values()} == {Outcome.PASSED}


@pytest.mark.parametrize("name", FIXTURES)
def test_a_kept_fixture_gets_its_verdict(name: str, rubric: Rubric) -> None:
    """A fixture loses points where its expected.yaml says, and nowhere else."""
    assert compare(
        load_fixture(ROOT / "fixtures" / name).expectation, judged(name), rubric
    ) == Verdict((), undecided=False)


@pytest.mark.parametrize("name", FIXTURES)
def test_each_lost_point_shows_its_proof(name: str) -> None:
    """Each lost point shows the expectation, the measurement, the reason and a remedy."""
    for check in checks_of(judged(name)).values():
        if check.outcome in (Outcome.FAILED, Outcome.PARTIAL):
            finding = check
            assert finding.expected, check.id
            assert finding.measured, check.id
            assert finding.reason, check.id
            assert finding.hint, check.id


def test_a_typo_in_a_topic_is_charged_once() -> None:
    """A reliable subscriber of the lab hears nothing; all else is judged on the topic that the student used."""
    publisher = judged("wrong_topic").criteria[0]
    outcomes = {check.id: check.outcome for check in publisher.checks}
    assert outcomes.pop("publisher.publishes") is Outcome.EXCUSED
    assert outcomes.pop("publisher.reliable") is Outcome.FAILED
    assert set(outcomes.values()) == {Outcome.PASSED}


def test_a_missing_file_is_charged_at_its_first_check() -> None:
    """The first check says which file, and all others that they could not be reached."""
    checks = checks_of(judged("missing_service_file"))
    service = [check for name, check in checks.items() if name.startswith("service.")]
    assert "no robot_service.py" in service[0].reason
    assert {check.outcome for check in service[1:]} == {Outcome.NOT_REACHED}
    assert all("Offers the service" in check.reason for check in service[1:])


def test_only_sessions_that_were_asked_for_are_judged() -> None:
    """Checks of other sessions are left out, and do not count as possible points."""
    assert {check.session for check in checks_of(judged("wrong_topic")).values()} == {
        "publisher",
        None,
    }


# -- the same bytes --------------------------------------------------------------------------------


def rendered(folder: Path, rubric: Rubric) -> str:
    """Give the result of a folder of recordings as its file holds it."""
    return to_json(judge(open_recordings(folder, rubric), rubric))


@pytest.mark.parametrize("name", [SOLUTION.name, "wrong_topic", "qos_invented_numbers"])
def test_judging_twice_gives_equal_bytes(name: str, rubric: Rubric) -> None:
    """The same recording and rubric give the same text."""
    assert rendered(KEPT / name, rubric) == rendered(KEPT / name, rubric)


JUDGE = """
import sys
from pathlib import Path
from grader.judging.judge import judge, open_recordings
from grader.judging.rubrics import read_rubric
from grader.result import to_json
rubric = read_rubric(None)
for name in sys.argv[2:]:
    sys.stdout.write(to_json(judge(open_recordings(Path(sys.argv[1], name), rubric), rubric)))
"""


def test_another_process_gives_equal_bytes(rubric: Rubric) -> None:
    """Neither hash seeds, nor time zone, nor working directory change a byte."""
    names = ["solution", "qos_invented_numbers", "signed_mean_statistics"]
    here = "".join(rendered(KEPT / name, rubric) for name in names)
    for seed, zone in (("1", "Asia/Tokyo"), ("4242", "America/Lima")):
        environment = {
            "PYTHONHASHSEED": seed,
            "TZ": zone,
            "PATH": "",
            "PYTHONPATH": str(ROOT),
            "LC_ALL": "C",
        }
        command = [sys.executable, "-c", JUDGE, str(KEPT), *names]
        run = subprocess.run(
            command, env=environment, cwd="/", capture_output=True, text=True, check=True
        )
        assert run.stdout == here


def test_where_the_recording_lies_makes_no_difference(copy: Path, rubric: Rubric) -> None:
    """A copy elsewhere is judged alike."""
    assert rendered(copy, rubric) == rendered(SOLUTION, rubric)


# -- nobody pays for the grader's faults -----------------------------------------------------------


@pytest.mark.parametrize(
    "check", sorted({spec.check for c in read_rubric(None).criteria for spec in c.checks})
)
def test_a_check_that_breaks_costs_nothing(
    check: str, solution: Recordings, rubric: Rubric, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An exception in a check leaves its points undecided, and those that hang on it."""

    def broken(context: object, parameters: object) -> Any:
        raise ZeroDivisionError("inside")

    monkeypatch.setattr(registry, "REGISTRY", {**REGISTRY, check: Check(broken)})
    result = judge(solution, rubric)
    mine = [
        spec for criterion in rubric.criteria for spec in criterion.checks if spec.check == check
    ]
    assert lost(result) == 0
    assert result.score.undecided >= sum(spec.points for spec in mine)
    reasons = [checks_of(result)[spec.id] for spec in mine]
    assert {f.outcome for f in reasons} <= {Outcome.ERROR, Outcome.INCONCLUSIVE}
    assert "ZeroDivisionError: inside" in reasons[0].reason


def break_recording(folder: Path, how: str) -> None:
    """Break the recording of a session in one of the ways tested below."""
    record = read_session(folder)
    if how == "without its folder":
        shutil.rmtree(folder)
    elif how == "cut off":
        write_session(folder, dataclasses.replace(record, complete=False))
    elif how == "with a problem":
        problems = ["a reference node died"]
        write_session(folder, dataclasses.replace(record, problems=problems))
    else:
        break_bag(next(folder.glob("*.mcap")), how)


def break_bag(bag: Path, how: str) -> None:
    """Remove a bag, cut it in half, or change eight bytes in its middle."""
    if how == "without its bag":
        bag.unlink()
        return
    data = bag.read_bytes()
    middle = len(data) // 2
    rest = b""
    if how == "a damaged bag":
        wrong = bytes(byte ^ 0xFF for byte in data[middle : middle + 8])
        rest = wrong + data[middle + 8 :]
    bag.write_bytes(data[:middle] + rest)


@pytest.mark.parametrize(
    ("how", "session"),
    [
        *(
            ("cut off", session)
            for session in ("publisher", "subscriber", "service", "launch", "qos")
        ),
        ("with a problem", "launch"),
        ("with a problem", "service"),
        ("without its bag", "publisher"),
        ("without its bag", "qos"),
        ("half of its bag", "publisher"),
        ("half of its bag", "subscriber"),
        ("a damaged bag", "subscriber"),
        ("a damaged bag", "launch"),
        ("without its folder", "service"),
        ("without its folder", "qos"),
    ],
)
def test_a_broken_recording_costs_nothing(
    copy: Path, rubric: Rubric, session: str, how: str
) -> None:
    """A session that was cut off, disturbed or lost leaves its points undecided, and only those."""
    break_recording(copy / session, how)
    recordings = open_recordings(copy, rubric)
    result = judge(recordings, rubric)
    own = [spec for spec in rubric.checks() if spec.session == session]
    assert lost(result) == 0
    assert result.score.undecided == sum(spec.points for spec in own)
    assert bool(result.problems) == (how != "without its folder")
    assert undecided_sessions(result, list(rubric.sessions)) == [session]


def killed(record: SessionRecord) -> SessionRecord:
    """Give the session as it were if something outside of it had killed the student's program."""
    student = next(run for run in record.processes if run.role == "student")
    student.ended_by, student.exit_status, student.interrupted_ns = "itself", 137, None
    return dataclasses.replace(record, graph=[])


def unseen(record: SessionRecord) -> SessionRecord:
    """Give the session as it were if nothing of the student's had come into the graph."""
    wait = next(step for step in record.steps if step.kind == "wait_for")
    wait.outcome = "timeout"
    return dataclasses.replace(record, graph=[], claims=[])


def test_a_program_that_was_refused_a_thread_is_looked_at_twice_again(
    copy: Path, rubric: Rubric
) -> None:
    """Other programs may have used up the kernel's limit.

    A program with too many processes of its own fails.
    """
    record = killed(read_session(copy / "subscriber"))
    student = next(run for run in record.processes if run.role == "student")
    student.exit_status, student.output = (
        1,
        [OutputLine(0, "stderr", "RuntimeError: Resource temporarily unavailable")],
    )
    for attempt, limit, points in ((1, None, 0), (2, None, 0), (3, None, 20), (1, "processes", 20)):
        student.limit = limit
        write_session(copy / "subscriber", dataclasses.replace(record, attempt=attempt, claims=[]))
        assert lost(judge(open_recordings(copy, rubric), rubric)) == points


def test_what_a_program_can_bring_about_is_not_undecided_for_ever(
    copy: Path, rubric: Rubric
) -> None:
    """A subscriber without its node fails in the third recording, whichever recording is kept."""
    record = unseen(read_session(copy / "subscriber"))
    record.claims = read_session(copy / "subscriber").claims
    for attempt, attempts, decided in ((1, 0, False), (2, 2, False), (3, 0, True), (1, 3, True)):
        kept = dataclasses.replace(record, attempt=attempt, attempts=attempts)
        write_session(copy / "subscriber", kept)
        finding = findings_of(copy, rubric)["subscriber.receives"]
        assert finding.outcome is (Outcome.FAILED if decided else Outcome.INCONCLUSIVE)
        assert ("The session was recorded 3 times" in finding.reason) == decided


def late(record: SessionRecord) -> SessionRecord:
    """Give the session as it were if the service had come into the graph after the first call."""
    call = next(step for step in record.steps if step.kind == "call")
    call.outcome, call.result = "timeout", {"calls": [], "problem": "the service is not up"}
    graph = [
        dataclasses.replace(taken, t_ns=call.ended_ns + number)
        for number, taken in enumerate(record.graph, 1)
    ]
    return dataclasses.replace(record, graph=graph)


@pytest.mark.parametrize(
    ("how", "session"), [(killed, "subscriber"), (unseen, "subscriber"), (late, "service")]
)
def test_what_may_be_flaky_costs_nothing_until_it_is_seen_again(
    copy: Path, rubric: Rubric, how: Callable[[SessionRecord], SessionRecord], session: str
) -> None:
    """A killed program or a missing or late node is undecided once, and judged the second time."""
    record = how(read_session(copy / session))
    for attempt in (1, 2):
        write_session(copy / session, dataclasses.replace(record, attempt=attempt))
        result = judge(open_recordings(copy, rubric), rubric)
        again = undecided_sessions(result, list(rubric.sessions))
        assert again == ([session] if attempt == 1 else [])
        assert (lost(result) == 0) == (attempt == 1)


def test_a_node_that_a_limit_kept_from_the_graph_is_not_waited_for_again(
    copy: Path, rubric: Rubric
) -> None:
    """A node that exceeded a limit was not missing by chance, and the reason names the limit."""
    record = unseen(read_session(copy / "subscriber"))
    next(run for run in record.processes if run.role == "student").limit = "processes"
    write_session(copy / "subscriber", record)
    recordings = open_recordings(copy, rubric)
    assert undecided_sessions(judge(recordings, rubric), list(rubric.sessions)) == []
    finding = checks_of(judge(recordings, rubric))["subscriber.receives"]
    assert finding.outcome is Outcome.FAILED
    assert "(limit: processes)" in finding.reason


def test_what_hangs_on_an_undecided_check_is_undecided(
    solution: Recordings, rubric: Rubric, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A check is not lost because the one that it requires could not be decided."""

    def broken(context: object, parameters: object) -> Any:
        raise ZeroDivisionError

    changed = {**REGISTRY, "topic_published": Check(broken)}
    monkeypatch.setattr(registry, "REGISTRY", changed)
    checks = checks_of(judge(solution, rubric))
    assert checks["publisher.rate"].outcome is Outcome.INCONCLUSIVE
    assert "Publishes joint commands" in checks["publisher.rate"].reason


def test_a_check_that_fails_lets_those_that_require_it_rest(rubric: Rubric) -> None:
    """A check that requires a failed check is not reached, and names the failed check."""
    findings = findings_of(KEPT / "missing_service_file", rubric)
    for spec in rubric.checks():
        if spec.id in findings and findings[spec.id].outcome is Outcome.NOT_REACHED:
            assert any(
                findings[r].outcome in (Outcome.FAILED, Outcome.NOT_REACHED) for r in spec.requires
            )


def test_a_missing_artifact_is_the_students_even_without_a_recording(
    copy: Path, rubric: Rubric
) -> None:
    """A session without its file fails at its first check. The reason lists the left-out files."""
    shutil.rmtree(copy / "service")
    record = read_submission(copy)
    next(fact for fact in record.artifacts if fact.name == "service").path = None
    record.left_out = ["old/notes.txt: not readable", "old/robot_service.py: not readable"]
    write_submission(copy, record)
    checks = checks_of(judge(open_recordings(copy, rubric), rubric))
    assert checks["service.offers"].outcome is Outcome.FAILED
    reason = "There is no robot_service.py in the submission. Left out was old/robot_service.py: not readable."
    assert checks["service.offers"].reason == reason
    assert checks["service.enables"].outcome is Outcome.NOT_REACHED


def waited(record: SessionRecord, delay_s: float, cpu_s: float = 0.2) -> SessionRecord:
    """Give the session as if the service had been waited for in vain for 10 s, by a machine that was busy."""
    student = next(run for run in record.processes if run.role == "student")
    begin_ns = student.started_ns
    student.usage = [
        Usage(begin_ns + n * 500_000_000, round(cpu_s * n * 5e7), round(delay_s * n * 5e7))
        for n in range(21)
    ]
    steps = [
        dataclasses.replace(
            step,
            outcome="timeout",
            started_ns=begin_ns,
            ended_ns=begin_ns + 10_000_000_000,
            result={},
        )
        for step in record.steps
        if step.kind == "wait_for"
    ]
    graph = [dataclasses.replace(graph, services=[]) for graph in record.graph]
    processes = [run for run in record.processes if run.role != "student" or run is student]
    return dataclasses.replace(
        record, steps=steps, graph=graph, processes=processes, claims=[], attempt=3
    )


@pytest.mark.parametrize(
    ("delay_s", "cpu_s", "lost_points"), [(7.0, 0.2, 0), (4.0, 0.2, 20), (7.0, 9.0, 20)]
)
def test_what_a_busy_machine_kept_from_coming_costs_nothing(
    copy: Path, rubric: Rubric, delay_s: float, cpu_s: float, lost_points: int
) -> None:
    """However often it is tried: a program that had no core cannot have been in time; one that burnt it could."""
    write_session(copy / "service", waited(read_session(copy / "service"), delay_s, cpu_s))
    result = judge(open_recordings(copy, rubric), rubric)
    assert lost(result) == lost_points


@pytest.mark.parametrize(("step_s", "costs"), [(0.5, False), (0.0, True)])
def test_nothing_that_goes_by_the_clock_is_charged_where_that_was_set(
    copy: Path, rubric: Rubric, step_s: float, costs: bool
) -> None:
    """A tool that ended too soon by a clock that was set may have run as long as it was to."""
    record = read_session(copy / "qos")
    run = next(run for run in record.processes if run.role == "student")
    run.started_ns += 5_000_000_000
    middle = len(record.machine) // 2
    for sample in record.machine[middle:]:
        sample.clock_offset_ns += round(step_s * 1e9)
    write_session(copy / "qos", record)
    result = judge(open_recordings(copy, rubric), rubric)
    assert (lost(result) > 0) == costs
    outcome = checks_of(result)["qos.runs"].outcome
    assert outcome is (Outcome.PARTIAL if costs else Outcome.INCONCLUSIVE)


# -- what cannot be judged at all ------------------------------------------------------------------


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"schema": "other"}', '{"schema": 1}'])
def test_files_of_another_shape_are_an_error(copy: Path, rubric: Rubric, text: str) -> None:
    """A damaged or foreign file ends with an error that says where, and no score."""
    for path in (copy / "publisher/session.json", copy / SUBMISSION_FILE):
        path.write_text(text)
        with pytest.raises(RecordingError) as caught:
            open_recordings(copy, rubric)
        assert caught.value.exit_status == 6
        assert caught.value.remedy


def test_a_record_with_an_unknown_key_is_an_error(copy: Path, rubric: Rubric) -> None:
    """A recording of a later version is not half understood."""
    path = copy / "qos/session.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "later": 1}))
    with pytest.raises(RecordingError, match="cannot be read") as caught:
        open_recordings(copy, rubric)
    assert "later" in caught.value.remedy


# -- pure ------------------------------------------------------------------------------------------


def test_judging_and_reporting_load_neither_ros_nor_processes() -> None:
    """After a whole judgement and its report, no module of ROS, of processes or of the live half is loaded."""
    code = (
        "import sys\nbefore = set(sys.modules)\n"
        "from pathlib import Path\n"
        "from grader.judging.judge import judge, open_recordings\n"
        "from grader.judging.judgement import report_page\nfrom grader.judging.rubrics import read_rubric\n"
        "from grader.report import submission_page\nfrom grader.result import to_json\n"
        "rubric = read_rubric(None)\n"
        "recordings = open_recordings(Path(sys.argv[1]), rubric)\n"
        "result = judge(recordings, rubric)\n"
        "assert result.score.earned == 100\n"
        "report_page(result, recordings, rubric), to_json(result)\n"
        "print(*sorted(set(sys.modules) - before))\n"
    )
    command = [sys.executable, "-c", code, str(SOLUTION)]
    run = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    loaded = set(run.stdout.split())
    forbidden = {
        "rclpy",
        "subprocess",
        "asyncio",
        "multiprocessing",
        "grader.live",
        "launch",
        "rpyutils",
    }
    assert not {
        name for name in loaded if name in forbidden or name.startswith(("rclpy.", "grader.live."))
    }


def test_kept_recordings_tell_nothing_of_the_machine() -> None:
    """No path of the machine on which they were made stands in them, and they stay small."""
    own = [str(ROOT), sys.prefix, str(Path.home()) + "/"]
    total = 0
    for path in KEPT.rglob("*"):
        if path.is_file():
            content = path.read_bytes()
            total += len(content)
            assert not [name for name in own if name.encode() in content], path
    assert total < 6_000_000


def test_what_a_fault_costs_stands_in_the_rubric(tmp_path: Path) -> None:
    """The price of another topic name is the parameter of the check."""
    text = (ROOT / "rubric.yaml").read_text(encoding="utf-8")
    cost = "other_name_costs: 0.5"
    assert cost in text
    # The dearer consequence of another name, which would excuse this one.
    dearer = "{topic: /joint_commands, type: std_msgs/msg/Float64MultiArray, reliability"
    assert dearer in text
    text = text.replace(dearer, "{topic: /joint_commands, reliability")
    mine = tmp_path / "rubric.yaml"
    for other, earned in ((cost, "0.5"), ("other_name_costs: 10%", "0.9")):
        mine.write_text(text.replace(cost, other), encoding="utf-8")
        rubric = read_rubric(mine)
        recordings = open_recordings(KEPT / "wrong_topic", rubric)
        checks = {check.id: check for c in judge(recordings, rubric).criteria for check in c.checks}
        assert str(checks["publisher.publishes"].earned) == earned


def test_the_check_that_the_developers_page_shows_can_be_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The example of a new check works as it stands there, with a line in the registry and one in a rubric."""
    page = (ROOT / "docs" / "developers.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(class TopicSilent.*?)```", page, re.DOTALL)
    assert code is not None
    names: dict[str, Any] = {**vars(publisher_checks), "passed": passed}
    exec(code[1], names)
    changed = {**REGISTRY, "topic_silent": Check(names["topic_silent"])}
    monkeypatch.setattr(registry, "REGISTRY", changed)
    text = (ROOT / "rubric.yaml").read_text(encoding="utf-8")
    used = re.sub(
        r"check: topic_jitter\n( +)with: .*",
        r"check: topic_silent\n\1with: {topic: /joint_commands}",
        text,
    )
    assert used != text
    (tmp_path / "rubric.yaml").write_text(used, encoding="utf-8")
    rubric = read_rubric(tmp_path / "rubric.yaml")
    finding = findings_of(KEPT / "solution", rubric)["publisher.steady"]
    assert finding.reason == "Something publishes on /joint_commands."


NOT_AWAITED = """\
lab: {id: "1", title: One, points: 2}
artifacts: {it: {file: it.py}}
reference: {robot: {file: robot.py, node: /robot}}
sessions: {experiment: {steps: [{start: {student: it}}]}}
criteria:
  - id: all
    title: All
    points: 2
    checks:
      - {id: publishes, points: 1, session: experiment, check: topic_published,
         with: {artifact: it, topic: /speeds, type: std_msgs/msg/Float64MultiArray}}
      - {id: holds, points: 1, session: experiment, check: field_range, requires: [publishes],
         with: {topic: /speeds, field: data, high: 1}}
"""


@pytest.mark.parametrize(
    ("name", "publishes"), [("/speed", Outcome.PARTIAL), ("/speeds", Outcome.PASSED)]
)
def test_a_misspelt_topic_is_found_though_no_step_waited_for_it(
    tmp_path: Path, name: str, publishes: Outcome
) -> None:
    """The name costs a part, and the rest is judged on the misspelt topic.

    Topics of reference nodes are never candidates.
    """
    (tmp_path / "robot.py").write_text("", encoding="utf-8")
    (tmp_path / "lab.yaml").write_text(NOT_AWAITED, encoding="utf-8")
    session = (
        Session(tmp_path)
        .process()
        .endpoint("publisher", name)
        .messages(name, [[0.5]] * 9, evenly(1, 8))
    )
    session.endpoint("publisher", "/speed_limits", "/robot")
    write_submission(tmp_path, submission())
    session.recorded()
    rubric = read_rubric(tmp_path / "lab.yaml")
    checks = checks_of(judge(open_recordings(tmp_path, rubric), rubric))
    assert (checks["publishes"].outcome, checks["holds"].outcome) == (publishes, Outcome.PASSED)


INPUT_AND_OUTPUT = NOT_AWAITED.replace(
    "      - {id: holds",
    """      - {id: hears, points: 0, session: experiment, check: field_range,
         with: {topic: /limits, field: data, high: 1}}
      - {id: holds""",
)


def test_an_input_is_not_taken_for_a_missing_output(tmp_path: Path) -> None:
    """The only topic of the output's type is more like an input of the lab, which is missing too."""
    (tmp_path / "robot.py").write_text("", encoding="utf-8")
    (tmp_path / "lab.yaml").write_text(INPUT_AND_OUTPUT, encoding="utf-8")
    session = Session(tmp_path).process().endpoint("publisher", "/my_limits")
    session.messages("/my_limits", [[0.5]] * 9, evenly(1, 8))
    write_submission(tmp_path, submission())
    session.recorded()
    rubric = read_rubric(tmp_path / "lab.yaml")
    checks = checks_of(judge(open_recordings(tmp_path, rubric), rubric))
    assert checks["publishes"].outcome is Outcome.FAILED
    assert checks["holds"].outcome is Outcome.NOT_REACHED


NOT_CALLED_BY_ITS_NAME = """\
lab: {id: "1", title: One, points: 2}
artifacts: {it: {file: it.py}}
sessions:
  experiment:
    steps:
      - start: {student: it}
      - call: {service: /robot/enable, type: std_srvs/srv/SetBool, request: {data: true}}
        label: enable
criteria:
  - id: all
    title: All
    points: 2
    checks:
      - {id: offers, points: 1, session: experiment, check: service_offered,
         with: {artifact: it, service: /robot/enable, type: std_srvs/srv/SetBool}}
      - {id: enables, points: 1, session: experiment, check: call_answered, requires: [offers],
         with: {artifact: it, step: enable, response: {success: true}}}
"""
#: The same of an action.
NOT_SENT_BY_ITS_NAME = (
    NOT_CALLED_BY_ITS_NAME.replace(
        "call: {service: /robot/enable", "send_goal: {action: /robot/enable"
    )
    .replace(
        "type: std_srvs/srv/SetBool, request: {data: true}",
        "type: test_msgs/action/Fibonacci, goal: {order: 3}",
    )
    .replace("check: service_offered", "check: action_server")
    .replace("service: /robot/enable, type: std_srvs/srv/SetBool", "WHAT, offered: {}")
    .replace("check: call_answered", "check: action_server")
    .replace("step: enable, response: {success: true}", "WHAT, accepted: {step: enable}")
    .replace("WHAT", "action: /robot/enable, type: test_msgs/action/Fibonacci")
)


@pytest.mark.parametrize(
    ("text", "service", "kind", "label", "key"),
    [
        (NOT_CALLED_BY_ITS_NAME, "/robot/enabel", "std_srvs/srv/SetBool", "call", "service"),
        (
            NOT_SENT_BY_ITS_NAME,
            "/robot/enabel/_action/send_goal",
            "test_msgs/action/Fibonacci_SendGoal",
            "send_goal",
            "action",
        ),
    ],
    ids=["service", "action"],
)
def test_a_misspelt_server_is_found_though_no_step_waited_for_it(
    tmp_path: Path, text: str, service: str, kind: str, label: str, key: str
) -> None:
    """The name costs its part, once. Requests to the right name are not tested, with the reason."""
    (tmp_path / "lab.yaml").write_text(text, encoding="utf-8")
    session = Session(tmp_path).process().service(service, kind=kind)
    session.service("/student/set_parameters", kind="rcl_interfaces/srv/SetParameters")
    session.step(label, "enable", "timeout", calls=[], problem="it is not up")
    session.record.steps[-1].parameters = {key: "/robot/enable", "goal": {"order": 3}}
    write_submission(tmp_path, submission())
    session.recorded()
    rubric = read_rubric(tmp_path / "lab.yaml")
    checks = checks_of(judge(open_recordings(tmp_path, rubric), rubric))
    assert (checks["offers"].outcome, checks["offers"].earned) == (Outcome.PARTIAL, Decimal("0.4"))
    assert checks["enables"].outcome is Outcome.NOT_REACHED
    assert (
        "it was called as /robot/enable, and yours is named /robot/enabel."
        in checks["enables"].reason
    )


def test_nothing_that_was_published_is_meant_where_no_name_is_like_it(tmp_path: Path) -> None:
    """A topic of another type and name stays one of its own."""
    (tmp_path / "robot.py").write_text("", encoding="utf-8")
    (tmp_path / "lab.yaml").write_text(NOT_AWAITED, encoding="utf-8")
    session = Session(tmp_path).process().endpoint("publisher", "/chatter", topic_type=TEXT)
    session.texts("/chatter", ["hello"] * 9, evenly(1, 8))
    write_submission(tmp_path, submission())
    session.recorded()
    rubric = read_rubric(tmp_path / "lab.yaml")
    checks = checks_of(judge(open_recordings(tmp_path, rubric), rubric))
    assert (checks["publishes"].outcome, checks["holds"].outcome) == (
        Outcome.FAILED,
        Outcome.NOT_REACHED,
    )
