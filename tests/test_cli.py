"""The `grade` command without a live graph: its messages about mistakes, and its exit statuses."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest
import yaml

from grader import __version__
from grader.checks.registry import REGISTRY
from grader.cli import main
from grader.lab.kept_lab import lab_folder
from grader.result_folder import RECORDINGS, REPORT_FILE, RESULT_FILE, RUBRIC_COPY

pytestmark = pytest.mark.usefixtures("judged_before")

ROOT = Path(__file__).resolve().parents[1]
SHIPPED = lab_folder() / "rubric.yaml"


def results_of(name: str, folder: Path) -> Path:
    """Lay out a results folder with kept recordings."""
    shutil.copytree(ROOT / "tests/recordings" / name, folder / name / RECORDINGS)
    shutil.copy(SHIPPED, folder / name / RECORDINGS / RUBRIC_COPY)
    return folder / name


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    """Run the command in this process; returns exit status, output and errors."""
    try:
        status = main([str(argument) for argument in arguments])
    except SystemExit as end:  # argparse
        status = int(end.code or 0)
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return status, captured.out, captured.err


# -- submissions -----------------------------------------------------------------------------------


def test_no_such_submission(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A missing path ends with 3, and the message names paths that exist."""
    (tmp_path / "alice").mkdir()
    status, _, errors = run(capsys, tmp_path / "alcie", "-o", tmp_path / "results")
    assert status == 3
    assert "there is no such submission" in errors
    assert "alice" in errors
    assert not (tmp_path / "results").exists()


def test_an_empty_submission(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder without files ends with 3, and the message has a remedy."""
    (tmp_path / "ann").mkdir()
    status, _, errors = run(capsys, tmp_path / "ann", "-o", tmp_path / "results")
    assert (status, "the submission is empty" in errors) == (3, True)
    assert len(errors.strip().splitlines()) == 2


def test_a_folder_of_something_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder without any artifact ends with 3."""
    (tmp_path / "notes.txt").write_text("hello")
    status, _, errors = run(capsys, tmp_path, "-o", tmp_path / "results")
    assert (status, "nothing in it looks like a submission" in errors) == (3, True)


def test_a_file_in_place_of_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file that is called an archive and is none ends with 3."""
    (tmp_path / "ann.zip").write_bytes(b"PK")
    status, _, errors = run(capsys, tmp_path / "ann.zip", "-o", tmp_path / "results")
    assert (status, "this is not a zip or tar archive" in errors) == (3, True)


def test_one_file_of_several_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file in place of its folder gives a note; the folder, or the only file, gives none."""
    (tmp_path / "no-folder").touch()
    for name in ("joint_publisher.py", "robot_service.py"):
        (tmp_path / name).write_text("import rclpy\n")
    said = []
    for path in (tmp_path / "joint_publisher.py", tmp_path):
        status, output, _ = run(capsys, path, "--one", "-o", tmp_path / "no-folder/results")
        assert status == 70
        said.append(output)
    assert (
        f"Only joint_publisher.py is graded; for all files of the lab: grade {tmp_path}" in said[0]
    )
    assert said[1] == ""


def test_names_of_folders_cannot_steer_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Escape sequences in a path are shown, not obeyed."""
    status, _, errors = run(capsys, tmp_path / "\x1b[2Jann", "-o", tmp_path / "results")
    assert status == 3
    assert "\x1b" not in errors


def test_a_defect_of_the_grader_is_no_low_score(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An exception that nobody expected ends with 70, since 1 means a score below --fail-under."""

    def fail(*_arguments: object, **_options: object) -> int:
        raise RecursionError("too deep")

    monkeypatch.setattr("grader.commands.grade.run", fail)
    assert main(["ann"]) == 70
    assert "a defect of the grader" in capsys.readouterr().err


def test_a_reader_that_leaves_changes_no_result(tmp_path: Path) -> None:
    """With `grade ... | head` the results are written, and the exit status is the grading's."""
    results = results_of("wrong_topic", tmp_path)
    command = [sys.executable, "-m", "grader.cli", "regrade", str(results)]
    reader, writer = os.pipe()
    os.close(reader)
    run = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, cwd=ROOT, check=False)
    os.close(writer)
    assert (run.returncode, run.stderr) == (0, b"")
    assert (results / REPORT_FILE).exists()
    assert (results / RESULT_FILE).exists()


# -- rubrics ---------------------------------------------------------------------------------------


def test_a_broken_rubric_ends_with_all_its_lines(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each mistake is a line with file and number, before anything is run."""
    text = SHIPPED.read_text(encoding="utf-8")
    broken = text.replace("points: 100", "points: 99").replace(
        "check: topic_rate", "check: topic_rat"
    )
    shutil.copytree(lab_folder() / "reference", tmp_path / "reference")
    (tmp_path / "mine.yaml").write_text(broken, encoding="utf-8")
    status, _, errors = run(capsys, ROOT / "submissions/alice", "--rubric", tmp_path / "mine.yaml")
    assert status == 4
    assert [line for line in errors.splitlines() if "mine.yaml:" in line and "topic_rat" in line]
    assert [line for line in errors.splitlines() if "mine.yaml:" in line and "add up to" in line]


def test_a_rubric_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A wrong path of a rubric ends with 4."""
    status, _, errors = run(capsys, ROOT / "submissions/alice", "--rubric", tmp_path / "none.yaml")
    assert (status, "Check --rubric" in errors) == (4, True)


@pytest.mark.parametrize("option", ["--lab", "--rubric"])
@pytest.mark.parametrize("command", [[], ["regrade"], ["report"]])
def test_a_lab_that_is_not_there_is_blamed_on_the_option_that_names_it(
    command: list[str], option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The two are names of one option; the message has the one that was used."""
    status, _, errors = run(capsys, *command, tmp_path, option, tmp_path / "nosuch")
    assert status == 4
    assert f"{tmp_path / 'nosuch'}: the rubric cannot be read" in errors
    assert f"Check {option}." in errors


def test_a_file_that_cannot_be_written_has_its_own_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The name under which an export is written first means nothing to anybody."""
    results = results_of("wrong_topic", tmp_path)
    assert run(capsys, "regrade", results)[0] == 0
    target = tmp_path / "gone/x.xml"
    status, _, errors = run(capsys, "export", results, "--to", "junit", "-o", target)
    assert (status, errors.splitlines()[0]) == (70, f"grade: {target}: No such file or directory")


#: Environments of terminals with fewer signs than the grader's texts.
TERMINALS = {
    "latin-1": {"PYTHONIOENCODING": "latin-1"},
    "ascii": {"PYTHONIOENCODING": "ascii"},
    "c": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", TERMINALS)
def test_any_terminal_can_show_a_result(name: str, tmp_path: Path) -> None:
    """Signs that it does not have are replaced; an export on the standard output stays UTF-8."""
    results = results_of("wrong_topic", tmp_path)
    (tmp_path / "Änne").mkdir()
    results = results.rename(tmp_path / "Änne/wrong_topic")
    grade = [str(Path(sys.executable).with_name("grade"))]
    environment = {**os.environ, **TERMINALS[name]}

    def said(*arguments: str | Path) -> subprocess.CompletedProcess[bytes]:
        command = [*grade, *map(str, arguments)]
        return subprocess.run(command, env=environment, capture_output=True, check=False)

    done = said("regrade", results)
    assert (done.returncode, b"Traceback" in done.stderr) == (0, False)
    assert re.search(rb"-> .*\n", done.stdout)
    assert re.search(rb"\n x +\S", done.stdout)
    missing = said("regrade", tmp_path / "Änne/nobody…")
    assert (missing.returncode, b"Traceback" in missing.stderr) == (6, False)
    assert b"nobody" in missing.stderr
    export = said("export", results, "--to", "github-summary", "-o", "-")
    assert not export.stdout.decode("utf-8").isascii()


def test_a_session_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A session that the rubric does not have is wrong usage, and the known ones are named."""
    out = tmp_path / "results"
    status, _, errors = run(
        capsys, ROOT / "submissions/alice", "--sessions", "publisher, sevrice", "-o", out
    )
    assert (status, out.exists()) == (2, False)
    assert "there is no session 'sevrice'" in errors
    assert "publisher, subscriber, service, launch, qos" in errors


# -- usage -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--colour"],
        ["ann", "--seed", "x"],
        ["ann", "--fail-under", "all"],
        ["ann", "--fail-under", "nan"],
        ["ann", "--fail-under", "-inf"],
        ["ann", "-j", "0"],
        ["regrade"],
        ["regrade", "x", "-j", "1"],
        ["checks", "x"],
    ],
)
def test_wrong_usage(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Wrong arguments end with 2 and the usage."""
    status, _, errors = run(capsys, *arguments)
    assert (status, "usage: grade" in errors) == (2, True)


def test_no_such_interpreter(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An interpreter that is not there ends with 5."""
    status, _, errors = run(capsys, ROOT / "submissions/alice", "--python", tmp_path / "python")
    assert (status, "Check --python" in errors) == (5, True)


def test_no_such_installation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An installation that is not there ends with 5, also if the lab names it; the option has priority."""
    pytest.importorskip("rclpy")
    alice = ROOT / "submissions/alice"
    status, _, errors = run(capsys, alice, "--ros", tmp_path / "option", "-o", tmp_path / "out")
    assert (status, f"{tmp_path}/option: there is no rclpy" in errors) == (5, True)
    lab = shutil.copytree(ROOT / "labs/talker-relay", tmp_path / "lab")
    text = (lab / "rubric.yaml").read_text(encoding="utf-8")
    named = text.replace("lab: {", f'lab: {{environment: "{tmp_path}/named", ', 1)
    (lab / "rubric.yaml").write_text(named, encoding="utf-8")
    status, _, errors = run(capsys, alice, "--lab", lab, "-o", tmp_path / "out")
    assert (status, f"{tmp_path}/named: there is no rclpy" in errors) == (5, True)
    status, _, errors = run(capsys, alice, "--lab", lab, "--ros", tmp_path / "option")
    assert (status, f"{tmp_path}/option: there is no rclpy" in errors) == (5, True)


def test_an_interpreter_without_ros(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """An interpreter that cannot import rclpy ends with 5, before any submission fails for it."""
    pytest.importorskip("rclpy")
    out = tmp_path / "results"
    status, _, errors = run(capsys, ROOT / "submissions/alice", "--python", "/bin/true", "-o", out)
    assert (status, out.exists()) == (5, False)
    assert "/bin/true: this interpreter cannot run students' nodes" in errors


def test_help_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    """Help names the other commands and all exit statuses."""
    status, output, _ = run(capsys, "--help")
    assert status == 0
    assert "grade regrade" in output
    assert all(f"{number} " in output for number in range(8))
    assert run(capsys, "--version")[:2] == (0, f"grade {__version__}\n")


def test_checks_lists_each_check_with_its_parameters(capsys: pytest.CaptureFixture[str]) -> None:
    """All checks of the registry are listed, and each of their parameters."""
    status, output, _ = run(capsys, "checks")
    assert status == 0
    for name, check in REGISTRY.items():
        assert f"{name}:" in output
        assert all(f"    {key}: " in output for key in check.parameters.model_fields)
    assert "    rate_hz: number, required." in output
    assert "    topics: list (mapping each), required." in output
    assert "        type: text, required. A message type." in output
    assert not re.search(r": (str|float|int|tuple|Mapping|Optional|grader)\b", output)
    # The value of a parameter may be of any type.
    assert set(re.findall(r"(\w+): any value", output)) == {"value", "other"}


# -- regrading -------------------------------------------------------------------------------------


def test_regrading_writes_result_and_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Kept recordings are judged, and the points are printed."""
    results = results_of("solution", tmp_path)
    status, output, errors = run(capsys, "regrade", results)
    assert (status, errors) == (0, "")
    assert "100 / 100" in output
    assert json.loads((results / RESULT_FILE).read_text())["score"]["earned"] == 100
    assert (results / REPORT_FILE).read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_fail_under(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A score below the limit ends with 1, one at it with 0."""
    results = results_of("missing_service_file", tmp_path)
    assert run(capsys, "regrade", results)[0] == 0
    earned = json.loads((results / RESULT_FILE).read_text())["score"]["earned"]
    assert run(capsys, "regrade", results, "--fail-under", str(earned))[0] == 0
    assert run(capsys, "regrade", results, "--fail-under", str(earned + 0.1))[0] == 1


def test_several_results_are_regraded_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One below the limit is enough to end with 1, and all are judged."""
    folders = [results_of(name, tmp_path) for name in ("missing_service_file", "wrong_topic")]
    status, output, _ = run(capsys, "regrade", *folders, "--fail-under", "20")
    assert status == 1
    assert "wrong_topic: Lab 09-01" in output
    assert all((folder / RESULT_FILE).is_file() for folder in folders)


@pytest.mark.parametrize("what", ["nothing", "no record", "damaged"])
def test_recordings_that_cannot_be_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], what: str
) -> None:
    """A folder without recordings, or with damaged ones, ends with 6 and says where."""
    results = tmp_path / "empty"
    if what != "nothing":
        results = results_of("solution", tmp_path)
        if what == "no record":
            (results / RECORDINGS / "submission.json").unlink()
        else:
            (results / RECORDINGS / "qos/session.json").write_text("{")
    status, _, errors = run(capsys, "regrade", results)
    assert status == 6
    assert errors.startswith(f"grade: {results}")
    assert not (results / RESULT_FILE).exists()


def test_the_installed_command_is_this_one(tmp_path: Path) -> None:
    """The `grade` script ends as `main` does."""
    script = Path(sys.executable).parent / "grade"
    if not script.exists():
        pytest.skip("the package is not installed here")
    ended = subprocess.run(
        [script, "regrade", tmp_path], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 6
    assert "Traceback" not in ended.stderr


# -- rubrics ---------------------------------------------------------------------------------------


def test_a_rubric_is_checked_without_grading(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The lab's rubric is in order; a mistyped window ends with the exit status of a wrong rubric, and its line."""
    assert run(capsys, "rubric")[0] == 0
    text = (lab_folder() / "rubric.yaml").read_text(encoding="utf-8")
    mine = tmp_path / "mine.yaml"
    mine.write_text(
        text.replace("window: window, rate_hz", "window: windw, rate_hz"), encoding="utf-8"
    )
    status, _, errors = run(capsys, "rubric", mine)
    line = text[: text.index("window: window, rate_hz")].count("\n") + 1
    assert (status, errors.count("mine.yaml:")) == (4, 1 + 1)
    assert f"mine.yaml:{line}: " in errors
    assert "did you mean 'window'?" in errors


def test_the_schema_takes_the_labs_rubric_and_finds_mistakes(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The shipped JSON Schema for editors is made of the models that read rubrics."""
    schema = json.loads(run(capsys, "rubric", "--schema")[1])
    shipped = json.loads((ROOT / "rubric.schema.json").read_text(encoding="utf-8"))
    assert schema == shipped, "run .venv/bin/python tools/write-schemas"
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    text = (lab_folder() / "rubric.yaml").read_text(encoding="utf-8")
    assert list(validator.iter_errors(yaml.safe_load(text))) == []
    for right, wrong in (
        ("check: topic_rate", "check: topic_rte"),
        ("full_within: 2%", "full_within: 2 percent"),
        ("kind: rate", "kind: rte"),
        ("- interrupt:", "- interupt:"),
        ("typical_s: 11", "typical_s: soon"),
        ("reliability: best_effort", "reliability: besteffort"),
    ):
        assert right in text
        assert list(validator.iter_errors(yaml.safe_load(text.replace(right, wrong, 1)))), wrong
