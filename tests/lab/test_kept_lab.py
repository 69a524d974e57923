"""A lab of one's own: code for judging travels with the recordings, and runs only if trusted."""

from __future__ import annotations

import json
import py_compile
import shutil
import sys
from importlib.util import cache_from_source
from pathlib import Path
from typing import Any

import pytest

from grader.cli import main
from grader.cohort.entries import entries_in
from grader.cohort.statistics import Need, summarise
from grader.evidence.oracle import load_oracle
from grader.judging.rubrics import read_rubric
from grader.lab.kept_lab import KEPT, files_of, identity_of, kept_files, lab_folder, sha256s
from grader.result_folder import RECORDINGS, RESULT_FILE, RUBRIC_COPY
from tests.plain_results import checks_of

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("judged_before")]

UNCHECKED = py_compile.PycInvalidationMode.UNCHECKED_HASH
ROOT = Path(__file__).resolve().parents[2]
#: In an oracle's file: shows that it was executed.
MARKS = "\nimport pathlib\npathlib.Path(__file__).with_name('executed').touch()\npathlib.Path({!r}).touch()\n"

#: Appended to an oracle's file: expects twice as much.
OTHERWISE = """
_right = tracking_plateaus
FACTOR = 2

def tracking_plateaus(streams, parameters, seed):
    return [{**span, "value": FACTOR * span["value"]} for span in _right(streams, parameters, seed)]
"""


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """Write another lab, with the file names of the grader's own but a different oracle."""
    folder = tmp_path / "lab"
    shutil.copytree(
        lab_folder() / "reference", folder / "reference", ignore=shutil.ignore_patterns("solution")
    )
    text = (
        (lab_folder() / "rubric.yaml")
        .read_text(encoding="utf-8")
        .replace('id: "09-01"', 'id: "other"')
    )
    assert 'id: "other"' in text
    (folder / "rubric.yaml").write_text(text, encoding="utf-8")
    with (folder / "reference/oracles.py").open("a", encoding="utf-8") as oracles:
        oracles.write(OTHERWISE)
    return folder


def record(lab: Path, results: Path) -> Path:
    """Lay out the files of `grade` for a recording by a lab, without the result."""
    rubric, recordings = read_rubric(lab / "rubric.yaml"), results / RECORDINGS
    shutil.copytree(ROOT / "tests/recordings/signed_mean_statistics", recordings)
    (recordings / RUBRIC_COPY).write_text(rubric.text, encoding="utf-8")
    files = files_of(rubric)
    for name, text in files.items():
        (recordings / KEPT / name).parent.mkdir(parents=True, exist_ok=True)
        (recordings / KEPT / name).write_text(text, encoding="utf-8")
    path = recordings / "submission.json"
    plain = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(
        json.dumps({**plain, "lab_folder": str(lab), "lab_files": sha256s(files)}), encoding="utf-8"
    )
    return results


@pytest.fixture
def results(lab: Path, tmp_path: Path) -> Path:
    """Give a recording by the other lab."""
    return record(lab, tmp_path / "results/ann")


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Be on a machine that knows no lab but the grader's own."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state-elsewhere"))


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    """Run the command in this process; returns exit status, output and errors with single spaces."""
    status = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return status, " ".join(captured.out.split()), " ".join(captured.err.split())


def result(results: Path) -> Any:
    """Read a result."""
    return json.loads((results / RESULT_FILE).read_text(encoding="utf-8"))


def checks(results: Path) -> dict[str, str]:
    """Give the measurement of each check of the statistics."""
    found = {}
    for check in checks_of(result(results)):
        found[check["id"]] = f"{check['expected']} {check['measured']}"
    return found


def test_a_recording_is_judged_by_its_own_labs_oracles(
    lab: Path, results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The grader's own are called alike, and judge otherwise; the lab itself is not needed any more."""
    own = record(lab_folder(), tmp_path / "results/bob")
    shutil.rmtree(lab)
    assert [run(capsys, "regrade", folder)[::2] for folder in (results, own)] == [(0, ""), (0, "")]
    other = checks(results)
    assert any(other[name] != measured for name, measured in checks(own).items())
    assert sorted(path.name for path in results.iterdir()) == [
        RECORDINGS,
        "report.html",
        RESULT_FILE,
    ]
    status, output, _ = run(capsys, "regrade", results.parent)
    assert (status, "No points change; 2 submissions judged." in output) == (0, True)


@pytest.mark.usefixtures("elsewhere")
def test_code_that_came_with_recordings_is_not_executed(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By no command, before the user says so; and that is remembered."""
    mark = tmp_path / "executed"
    path = results / RECORDINGS / KEPT / "reference/oracles.py"
    path.write_text(path.read_text(encoding="utf-8") + MARKS.format(str(mark)), encoding="utf-8")
    (results / RESULT_FILE).write_text("{}", encoding="utf-8")
    commands: list[list[str | Path]] = [["regrade", results], ["regrade", results.parent]]
    commands.append(["export", results, "--so-far", "--to", "junit"])
    for command in commands:
        status, _, errors = run(capsys, *command)
        assert (
            status,
            "reference/oracles.py came with the recordings and is not known on this" in errors,
        ) == (6, True)
    assert not mark.exists()
    assert run(capsys, "regrade", results, "--trust-lab")[0] == 0
    assert mark.exists()
    assert run(capsys, "regrade", results)[0] == 0


@pytest.mark.usefixtures("elsewhere")
@pytest.mark.parametrize("place", ["beside the copy", "outside", "a link"])
def test_no_name_leads_to_code_that_is_not_known(
    results: Path, tmp_path: Path, place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Neither files beside the copy of the rubric, nor a path that climbs, nor a link."""
    mark, recordings = tmp_path / "executed", results / RECORDINGS
    shutil.rmtree(recordings / KEPT)
    shutil.copytree(lab_folder() / "reference", recordings / KEPT / "reference")
    evil = tmp_path / "evil/reference"
    shutil.copytree(lab_folder() / "reference", evil)
    with (evil / "oracles.py").open("a", encoding="utf-8") as file:
        file.write(MARKS.format(str(mark)))
    text = (recordings / RUBRIC_COPY).read_text(encoding="utf-8")
    named = "reference/oracles.py:"
    if place == "beside the copy":
        shutil.rmtree(recordings / KEPT)
        shutil.copytree(evil, recordings / "reference")
        text = text.replace('id: "other"', 'id: "09-01"')
    elif place == "outside":
        text = text.replace(named, "../../../../evil/reference/oracles.py:")
    else:
        (recordings / KEPT / "more").symlink_to(evil)
        text = text.replace(named, "more/oracles.py:")
    (recordings / RUBRIC_COPY).write_text(text, encoding="utf-8")
    run(capsys, "regrade", results)
    assert not mark.exists()


@pytest.mark.usefixtures("elsewhere")
def test_bytecode_beside_a_known_file_is_not_executed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python would take it for the file's own, also over a link; nor is any written there, which nobody knows."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    results, mark = record(lab_folder(), tmp_path / "results/ann"), tmp_path / "executed"
    oracles = results / RECORDINGS / KEPT / "reference/oracles.py"
    evil = tmp_path / "evil.py"
    evil.write_text(oracles.read_text(encoding="utf-8") + MARKS.format(str(mark)), encoding="utf-8")
    compiled = Path(cache_from_source(str(oracles)))
    compiled.parent.mkdir()
    py_compile.compile(str(evil), str(tmp_path / "evil.pyc"), invalidation_mode=UNCHECKED)
    compiled.symlink_to(tmp_path / "evil.pyc")
    assert run(capsys, "regrade", results)[0] == 0
    assert not mark.exists()
    compiled.unlink()
    assert [run(capsys, "regrade", results)[0] for _ in range(2)] == [0, 0]
    assert not list(compiled.parent.iterdir())


def test_what_an_oracles_file_imports_is_no_oracle() -> None:
    """Else a rubric from anywhere could call it, with arguments of its own."""
    assert callable(load_oracle(lab_folder(), "reference/oracles.py:expected_reports"))
    with pytest.raises(ValueError, match="no function pairwise"):
        load_oracle(lab_folder(), "reference/oracles.py:pairwise")


def test_a_rubric_that_is_named_brings_its_own_oracles(
    lab: Path, results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A named rubric brings its own oracles; a difference from the recording's is reported once."""
    run(capsys, "regrade", results)
    before = checks(results)
    new = Path(shutil.copytree(lab, tmp_path / "new"))
    oracles = new / "reference/oracles.py"
    oracles.write_text(
        oracles.read_text(encoding="utf-8").replace("FACTOR = 2", "FACTOR = 1"), encoding="utf-8"
    )
    said = "judged by another reference/oracles.py than it was recorded with"
    output = run(capsys, "regrade", results.parent, "--rubric", new / "rubric.yaml")[1]
    assert f"Note: ann: {said}" in output
    output = run(capsys, "regrade", results, "--rubric", new / "rubric.yaml")[1]
    assert f"Note: {said}" in output
    assert checks(results) != before
    # The result is judged by the new oracle from now on, without naming it and without the lab.
    after = result(results)
    shutil.rmtree(new)
    assert run(capsys, "regrade", results)[0] == 0
    assert result(results) == after
    assert "FACTOR = 1" in kept_files(results / RUBRIC_COPY)["reference/oracles.py"]
    run(capsys, "regrade", results, "--rubric", lab / "rubric.yaml")
    assert checks(results) == before
    assert kept_files(results / RUBRIC_COPY) == {}


def test_a_result_names_the_lab_with_all_files_that_it_names(
    lab: Path, results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same rubric with another oracle is another lab: results by the two in one class are not compared."""
    other = Path(shutil.copytree(lab, tmp_path / "new"))
    oracles = other / "reference/oracles.py"
    oracles.write_text(
        oracles.read_text(encoding="utf-8").replace("FACTOR = 2", "FACTOR = 1"), encoding="utf-8"
    )
    record(other, results.with_name("bob"))
    stated = []
    for folder, rubric in (
        (results, read_rubric(lab / "rubric.yaml")),
        (results.with_name("bob"), None),
    ):
        run(capsys, "regrade", folder)
        stated.append(result(folder)["provenance"])
        assert rubric is None or stated[0]["lab_sha256"] == identity_of(rubric)
    assert stated[0]["rubric_sha256"] == stated[1]["rubric_sha256"]
    assert stated[0]["lab_sha256"] != stated[1]["lab_sha256"]
    entries = entries_in(results.parent)
    todos = summarise(entries, read_rubric(lab / "rubric.yaml")).todos
    assert [entries[todo.row].name for todo in todos if todo.need is Need.OTHER_RUBRIC] == ["bob"]


def test_an_oracle_that_was_repaired_in_the_lab_is_pointed_to(
    lab: Path, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The recording's own oracle judges, and a later change in the lab is named."""
    path = lab / "reference/oracles.py"
    path.write_text(path.read_text(encoding="utf-8") + "\n# Corrected.\n", encoding="utf-8")
    status, output, _ = run(capsys, "regrade", results)
    assert status == 0
    assert f"Note: reference/oracles.py in {lab} has changed since it was recorded" in output
    assert "has changed" not in run(capsys, "regrade", results, "--rubric", lab / "rubric.yaml")[1]


def test_an_edited_copy_of_a_rubric_finds_the_oracles_of_the_recording(
    lab: Path, results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An edited copy finds the recording's oracles from any folder, never another lab's.

    Nothing can be graded with such a copy alone.
    """
    run(capsys, "regrade", results)
    before = checks(results)
    text = (lab / "rubric.yaml").read_text(encoding="utf-8")
    shutil.rmtree(lab)
    (tmp_path / "edited.yaml").write_text(text + "\n# Edited.\n", encoding="utf-8")
    status, _, errors = run(capsys, "selftest", "--rubric", tmp_path / "edited.yaml")
    assert (status, "there is no file 'reference/arm.py' beside the rubric" in errors) == (4, True)
    assert run(capsys, "regrade", results, "--rubric", tmp_path / "edited.yaml")[0] == 0
    assert checks(results) == before


def test_a_rubric_of_another_lab_is_refused(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """For one and for a class: points of another lab say nothing."""
    for folder in (results, results.parent):
        status, _, errors = run(capsys, "regrade", folder, "--rubric", lab_folder() / "rubric.yaml")
        assert status == 2
        assert "these are results of Lab other, and the rubric is of Lab 09-01" in errors


@pytest.mark.parametrize("lab_id", ["09-01", "other"])
def test_recordings_of_before_are_judged_as_before(
    results: Path, lab_id: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without files kept beside them, the grader's own lab judges its own recordings, and no others."""
    recordings = results / RECORDINGS
    shutil.rmtree(recordings / KEPT)
    text = (
        (recordings / RUBRIC_COPY)
        .read_text(encoding="utf-8")
        .replace('id: "other"', f'id: "{lab_id}"')
    )
    (recordings / RUBRIC_COPY).write_text(text, encoding="utf-8")
    path = recordings / "submission.json"
    plain = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(
        json.dumps({k: v for k, v in plain.items() if not k.startswith("lab_")}), encoding="utf-8"
    )
    status, _, errors = run(capsys, "regrade", results)
    if lab_id == "09-01":
        assert (status, errors) == (0, "")
    else:
        assert status == 4
        assert "give its rubric by --rubric" in errors


def test_the_lab_that_ships_with_the_grader_is_known_everywhere(
    tmp_path: Path, elsewhere: None, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its recordings need no option on any machine."""
    assert run(capsys, "regrade", record(lab_folder(), tmp_path / "results/bob"))[::2] == (0, "")
