"""`grade lab`: a new lab works, and mistakes in one are reported before anything runs."""

from __future__ import annotations

import json
import shutil
import textwrap
from collections.abc import Iterable
from pathlib import Path

import pytest
import yaml

from grader import own_checks
from grader.cli import main
from grader.judging.judge import Recordings, judge
from grader.judging.rubrics import read_rubric, rubric_kinds
from grader.lab.kept_lab import lab_folder
from grader.lab.rubric import json_schema
from grader.live.interfaces.build import lacking_toolchain
from grader.result import CheckResult
from tests.synthetic import Session, evenly, submission

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
NODE = """\
import sys
from dataclasses import dataclass

from grader.reference_node import reference_node, run


@dataclass(frozen=True)
class Settings:
    rate_hz: float = 10.0

    def __post_init__(self):
        if self.rate_hz > 1000:
            raise ValueError("rate_hz is at most 1000")


def play(configuration, settings, stop):
    pass


if __name__ == "__main__":
    sys.exit(run(Settings, play))
"""
CHECKS = """\
from dataclasses import dataclass

from grader.own_checks import Context, Finding, Topic, passed


@dataclass
class Parameters:
    topic: Topic
    least: int = 1

    def __post_init__(self):
        if self.least > 100:
            raise ValueError("least is at most 100")


def always(context: Context, p: Parameters) -> Finding:
    return passed("anything", "something")


def expected(streams, parameters, seed):
    return {}
"""


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    """Run the command in this process; returns exit status, output with single spaces, and errors."""
    status = main(["lab", *map(str, arguments)])
    captured = capsys.readouterr()
    return status, " ".join(captured.out.split()), captured.err


@pytest.fixture
def new(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """Make a lab."""
    folder = tmp_path / "labs/08-03"
    assert run(capsys, "new", folder)[0] == 0
    return folder


def edit(lab: Path, old: str, new: str, file: str = "rubric.yaml") -> int:
    """Change a file of a lab; returns the line of the change."""
    text = (lab / file).read_text(encoding="utf-8")
    assert old in text
    (lab / file).write_text(text.replace(old, new, 1), encoding="utf-8")
    return text[: text.index(old)].count("\n") + 1


def with_code(lab: Path) -> Path:
    """Add a reference node and a check to a lab."""
    (lab / "reference").mkdir()
    (lab / "reference/robot.py").write_text(NODE, encoding="utf-8")
    (lab / "checks").mkdir()
    (lab / "checks/mine.py").write_text(CHECKS, encoding="utf-8")
    node = 'reference:\n  robot: {file: reference/robot.py, node: /robot, settings: "reference/robot.py:Settings"}\n'
    edit(lab, "# The experiments.", f"{node}\n# The experiments.")
    start = "      - start: {reference: robot, with: {rate_hz: 20}}\n"
    edit(lab, "      - start: {student: talker}\n", f"{start}      - start: {{student: talker}}\n")
    own = "check: checks/mine.py:always\n        with: {topic: /chatter, least: 3}"
    check = f"      - id: talker.mine\n        points: 0\n        session: talking\n        {own}\n"
    with (lab / "rubric.yaml").open("a", encoding="utf-8") as rubric:
        rubric.write(check)
    return lab


def test_a_new_lab_is_in_order(new: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A new lab has its folder's name, is complete in itself, and has no mistakes."""
    plain = yaml.safe_load((new / "rubric.yaml").read_text(encoding="utf-8"))
    assert plain["lab"]["id"] == "08-03"
    assert {path.name for path in new.iterdir()} >= {
        "README.md",
        "rubric.yaml",
        "rubric.schema.json",
        "solution",
        "fixtures",
    }
    schema = json.loads((new / "rubric.schema.json").read_text(encoding="utf-8"))
    assert schema == json_schema(rubric_kinds())
    status, output, _ = run(capsys, "check", new)
    assert (status, "are in order. Points: 10, checks: 2." in output) == (0, True)
    assert "`grade lab try` does it" in output


def test_nothing_is_overwritten(new: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder that is not empty, and a folder without a rubric, are wrong usage."""
    status, _, errors = run(capsys, "new", new)
    assert (status, "this folder exists and is not empty" in errors) == (2, True)
    status, _, errors = run(capsys, "check", new.parent)
    assert (status, "there is no rubric.yaml in it" in errors) == (2, True)


#: File, change and message. The message has the line of the change, if a line of the rubric is at
#: fault.
MISTAKES = [
    (
        "rubric.yaml",
        "solution: solution",
        "solution: solutoin",
        "lab.solution: there is no folder 'solutoin'",
    ),
    (
        "rubric.yaml",
        "{reference: robot, with: {rate_hz: 20}}",
        "{reference: robot, with: {rate_hz: 2000}}",
        "at most 1000",
    ),
    ("rubric.yaml", "least: 3}", "least: 300}", "least is at most 100"),
    (
        "reference/robot.py",
        "import sys\n",
        "import sys, nowhere\n",
        "reference/robot.py, line 1: ModuleNotFoundError",
    ),
    (
        "reference/robot.py",
        "def play(",
        "stop = 1 / 0\ndef play(",
        "reference/robot.py, line 16: ZeroDivisionError",
    ),
    (
        "checks/mine.py",
        "@dataclass\n",
        "undefined\n@dataclass\n",
        "checks/mine.py, line 6: NameError",
    ),
    ("checks/mine.py", "def always", "API_VERSION = 9\ndef always", "written for version 9"),
    (
        "checks/mine.py",
        "def always",
        "raise SystemExit\ndef always",
        "checks/mine.py, line 16: SystemExit",
    ),
    (
        "fixtures/too_slow/expected.yaml",
        "outcome: failed,",
        "outcome: failed, earned: [1, x],",
        "the least and the most",
    ),
    (
        "fixtures/too_slow/expected.yaml",
        "about:",
        "without: [gone.py]\nabout:",
        "there is no file 'gone.py'",
    ),
    (
        "fixtures/too_slow/expected.yaml",
        "about:",
        "with_files_of: gone\nabout:",
        "there is no folder 'gone'",
    ),
    (
        "fixtures/too_slow/expected.yaml",
        "talker.rate:",
        "talker.rte:",
        "expected.yaml:9: criteria.talker.checks.talker.rte",
    ),
    (
        "fixtures/too_slow/expected.yaml",
        "sessions: [talking]",
        "sessions: [walking]",
        "did you mean 'talking'?",
    ),
    (
        "fixtures/too_slow/expected.yaml",
        "outcome: failed",
        "outcome: fail",
        "did you mean 'failed'?",
    ),
    ("fixtures/too_slow/expected.yaml", "about:", "abuot:", "unknown key; did you mean 'about'?"),
]


@pytest.mark.parametrize(
    ("file", "old", "wrong", "words"), MISTAKES, ids=[f"{m[0]} {m[2]:.30}" for m in MISTAKES]
)
def test_what_only_the_files_tell_is_found(
    new: Path, capsys: pytest.CaptureFixture[str], file: str, old: str, wrong: str, words: str
) -> None:
    """Mistakes inside files are found: refused settings, broken imports, unknown expectations."""
    if "reference" in file or "reference" in old:
        pytest.importorskip("rclpy")
    with_code(new)
    assert run(capsys, "check", new)[0] == 0
    line = edit(new, old, wrong, file)
    status, _, errors = run(capsys, "check", new)
    found = [each for each in errors.splitlines() if words in each]
    assert (status, len(found)) == (4, 1), errors
    if file == "rubric.yaml":
        place = f"rubric.yaml:{line}: "
    elif "fixtures" in file:
        place = "expected.yaml:"
    else:
        place = "rubric.yaml:"
    assert place in found[0]


def test_what_a_check_of_its_own_names_is_for_itself_to_call(
    new: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another function in its parameters is none that the grader calls."""
    pytest.importorskip("rclpy")
    with_code(new)
    edit(
        new, "    least: int = 1\n", "    least: int = 1\n    helper: str = ''\n", "checks/mine.py"
    )
    edit(new, "least: 3}", 'least: 3, helper: "checks/mine.py:expected"}')
    assert run(capsys, "check", new)[0] == 0


def test_interfaces_of_its_own_are_no_mistake(
    new: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A lab's own interfaces are built for a reference node that imports them.

    Each imported name must be there.
    """
    pytest.importorskip("rclpy")
    with_code(new)
    (new / "interfaces/our_msgs/msg").mkdir(parents=True)
    (new / "interfaces/our_msgs/msg/Beat.msg").write_text("int32 count\n", encoding="utf-8")
    edit(new, "# The experiments.", "interfaces: interfaces\n\n# The experiments.")
    edit(new, "import sys\n", "import sys\nfrom our_msgs.msg import Beat\n", "reference/robot.py")
    assert run(capsys, "check", new)[0] == 0
    if not lacking_toolchain():
        edit(new, "import Beat", "import Beet", "reference/robot.py")
        status, _, errors = run(capsys, "check", new)
        assert (status, "line 2: ImportError: cannot import name 'Beet'" in errors) == (4, True)
    edit(new, "our_msgs.msg", "their_msgs.msg", "reference/robot.py")
    assert run(capsys, "check", new)[0] == 4


def test_what_the_grader_brings_is_no_mistake(
    new: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A reference node may import transforms at its top, as it does where it runs."""
    pytest.importorskip("rclpy")
    with_code(new)
    line = "from tf2_msgs.msg import TFMessage\nfrom tf2_ros import TransformBroadcaster\n"
    edit(new, "import sys\n", f"import sys\n{line}", "reference/robot.py")
    assert run(capsys, "check", new)[0] == 0


def recorded(lab: Path, recording: Path) -> None:
    """Put a recording at the place of the solution's recording by `grade lab try`."""
    recordings = lab / "tried/solution/recordings"
    shutil.copytree(recording, recordings)
    shutil.copy(lab / "rubric.yaml", recordings)


@pytest.fixture
def arm_lab(tmp_path: Path) -> Path:
    """Copy the lab that travels with the grader, with a recording of its solution."""
    lab = tmp_path / "arm"
    shutil.copytree(lab_folder() / "reference", lab / "reference")
    shutil.copy(lab_folder() / "rubric.yaml", lab)
    recorded(lab, ROOT / "tests/recordings/solution")
    return lab


def test_the_solutions_recording_shows_sound_checks(
    arm_lab: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every check passes on it, and none where nothing happens."""
    status, output, _ = run(capsys, "check", arm_lab)
    assert (status, "every check passes, and where nothing happens none does" in output) == (
        0,
        True,
    ), output


def test_checks_that_nobody_can_fail_or_pass_are_named(
    arm_lab: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the recording of the solution; once the sessions have changed it says nothing any more."""
    edit(arm_lab, "rate_hz: 100, full_within", "rate_hz: 200, full_within")
    (arm_lab / "checks").mkdir()
    (arm_lab / "checks/mine.py").write_text(CHECKS, encoding="utf-8")
    edit(arm_lab, "criteria:\n", "criteria:\n" + FREE)
    edit(arm_lab, "points: 100\n", "points: 102\n")
    status, output, _ = run(capsys, "check", arm_lab)
    assert status == 0
    assert "! publisher.rate does not pass on the solution's recording: " in output
    assert (
        "! free.always earns 2 points also where nothing happens: let it require a check that fails then"
        in output
    )
    assert output.count("!") == 3
    edit(
        arm_lab,
        "return passed(",
        "context.messages(p.topic).sent_s[0]\n    return passed(",
        "checks/mine.py",
    )
    output = run(capsys, "check", arm_lab)[1]
    assert (
        "! free.always fails with an error where nothing happens, so that it costs nobody: The lab's own"
        in output
    )
    edit(arm_lab, "observe: {duration_s: 9.5", "observe: {duration_s: 10")
    output = run(capsys, "check", arm_lab)[1]
    assert "The sessions have changed since the solution was recorded" in output


def test_checks_of_the_bonus_are_examined_too(
    arm_lab: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Checks of the bonus are examined if the solution holds their subject.

    A message says so if it does not.
    """
    (arm_lab / "checks").mkdir()
    (arm_lab / "checks/mine.py").write_text(CHECKS, encoding="utf-8")
    edit(arm_lab, "bonus:\n", "bonus:\n" + FREE)
    status, output, _ = run(capsys, "check", arm_lab)
    assert (status, output.count("!")) == (0, 2), output
    assert (
        "The solution holds nothing of the bonus trajectory, controller, lifecycle, composed, so"
        in output
    )
    assert "! free.always earns 2 points also where nothing happens" in output


FREE = """\
  - id: free
    title: Free
    points: 2
    checks:
      - id: free.always
        points: 2
        session: publisher
        check: checks/mine.py:always
        with: {topic: /joint_commands}
"""


def judged(lab: Path, made: Session) -> CheckResult:
    """Judge a recording of the lab's session by the last check of its rubric."""
    made.record.session = "talking"
    rubric = read_rubric(lab / "rubric.yaml")
    found = judge(Recordings(submission(talker="talker.py"), {"talking": made.recorded()}), rubric)
    return found.checks[-1]


def with_check(lab: Path, source: str, words: str) -> None:
    """Add a check of its own to a lab."""
    (lab / "checks").mkdir()
    (lab / "checks/mine.py").write_text(source, encoding="utf-8")
    with (lab / "rubric.yaml").open("a", encoding="utf-8") as rubric:
        rubric.write(f"      - {{id: talker.mine, points: 0, session: talking, {words}}}\n")


@pytest.mark.parametrize(
    ("numbers", "outcome"),
    [
        (range(1, 21), "passed"),
        (range(1, 11), "passed"),
        ([1, 2, 2, *range(3, 20)], "failed"),
        ([" ", "x", "\u0661\u00b2", "9" * 5000], "failed"),
    ],
)
def test_the_check_in_its_readme_works(
    new: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    numbers: Iterable[object],
    outcome: str,
) -> None:
    """The check in the README works as written: right, just enough, wrong, and without a number."""
    text = (new / "README.md").read_text(encoding="utf-8")
    source = textwrap.dedent(text.partition("  ```python\n")[2].partition("  ```\n")[0])
    with_check(new, source, "check: checks/mine.py:counts_up, with: {topic: /chatter}")
    assert run(capsys, "check", new)[0] == 0
    greetings = [f"Hello {number}" for number in numbers]
    made = (
        Session(tmp_path, "talking")
        .process("talker")
        .texts("/chatter", greetings, evenly(10, 10)[: len(greetings)])
    )
    found = judged(new, made)
    assert found.outcome.value == outcome, found.reason


@pytest.mark.parametrize(
    ("nearest", "outcome"), [(0.4, "passed"), (0.3, "passed"), (0.2, "failed")]
)
def test_the_check_in_the_documentation_of_own_checks_works(
    new: Path, tmp_path: Path, nearest: float, outcome: str
) -> None:
    """As it is written there, on ranges of a laser."""
    text = str(own_checks.__doc__)
    source = textwrap.dedent(
        text[text.index("    from dataclasses") : text.index("- The second argument")]
    )
    with_check(
        new, source, "check: checks/mine.py:keeps_away, with: {topic: /scan, window: window}"
    )
    scans = [{"ranges": [1.0, nearest, 2.0]}] * 10
    made = Session(tmp_path, "talking").process("talker").window(0.5, 5.0)
    made.typed("/scan", "sensor_msgs/msg/LaserScan", scans, evenly(10, 0.9))
    found = judged(new, made)
    assert found.outcome.value == outcome, found.reason


@pytest.mark.live
def test_the_new_lab_gets_its_verdicts(new: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A new lab gives its solution all points and its fixture the expected losses.

    Each of its checks can fail.
    """
    pytest.importorskip("rclpy")
    for _ in range(2):  # A second time over the results of the first.
        status, output, errors = run(capsys, "try", new)
        assert (status, "2 of 2 as expected" in output) == (0, True), output + errors
    assert (new / "tried/solution/report.html").is_file()
    output = run(capsys, "check", new)[1]
    assert (
        "On the solution's recording every check passes, and where nothing happens none does."
        in output
    )


@pytest.mark.live
def test_a_submission_is_graded_by_a_labs_folder(
    new: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`--lab` takes the folder; with a node of the lab's own and its own check beside the student's."""
    pytest.importorskip("rclpy")
    with_code(new)
    (new / "reference/robot.py").write_text(NODE.replace("    pass\n", PLAY), encoding="utf-8")
    assert main(["--lab", str(new), str(new / "solution"), "-o", str(tmp_path / "results")]) == 0
    assert "10 / 10" in " ".join(capsys.readouterr().out.split())


PLAY = """\
    import time
    from std_msgs.msg import String
    from grader.reference_node import sleep_until
    with reference_node("robot") as reference:
        publisher = reference.open_publisher(String, configuration.name("/beat"), 10)
        print("ready", flush=True)
        while not stop:
            publisher.publish(String(data="beat"))
            sleep_until(time.monotonic_ns() + round(1e9 / settings.rate_hz), stop)
"""
