"""Changes that make a second grading necessary, and changes that do not."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from grader.classroom import fingerprint
from grader.judging.rubrics import read_overrides, read_rubric
from grader.lab.rubric import Rubric
from grader.pipeline import Options
from grader.submission.extraction import Intake, SubmissionSource, open_submission

ROOT = Path(__file__).parents[2]
OPTIONS = Options(Path(sys.executable))


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


def submission(folder: Path) -> str:
    """Hash a submission as it is graded: extracted first."""
    with open_submission(folder) as intake:
        return fingerprint.submission_sha256(intake)


def rename(folder: Path) -> None:
    """Call a file something else."""
    (folder / "talker.py").rename(folder / "speaker.py")


CHANGES: dict[str, Callable[[Path], object]] = {
    "contents": lambda folder: (folder / "talker.py").write_text("pass\n"),
    "a name": rename,
    "one more file": lambda folder: (folder / "more.py").write_text(""),
    "one file less": lambda folder: (folder / "README.md").unlink(),
    "what is left out": lambda folder: (folder / "link.py").symlink_to("/etc/passwd"),
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_change_of_the_submission_is_seen(tmp_path: Path, what: str) -> None:
    """Whatever a student changes makes another submission of it."""
    folder = tmp_path / "ann"
    folder.mkdir()
    (folder / "talker.py").write_text("print()\n")
    (folder / "README.md").write_text("# Talker\n")
    before = submission(folder)
    CHANGES[what](folder)
    assert submission(folder) != before


def test_the_same_files_are_the_same_submission(tmp_path: Path) -> None:
    """Neither its place, name, times nor form, folder or archive, makes another submission."""
    folder = tmp_path / "ann"
    shutil.copytree(ROOT / "submissions/alice", folder)
    again = tmp_path / "elsewhere" / "bob"
    shutil.copytree(folder, again, copy_function=shutil.copy)
    archive = Path(shutil.make_archive(str(tmp_path / "cem"), "zip", folder))
    assert submission(folder) == submission(again) == submission(archive)


def test_names_and_contents_cannot_be_mixed_up(tmp_path: Path) -> None:
    """Files that would follow each other in the same bytes are told apart."""
    hashes = set()
    for number, files in enumerate(
        ({"a": "bc"}, {"ab": "c"}, {"a": "b", "c": ""}, {"a": "", "b": "c"})
    ):
        folder = tmp_path / str(number)
        folder.mkdir()
        for name, text in files.items():
            (folder / name).write_text(text)
        hashes.add(fingerprint.submission_sha256(Intake(folder, SubmissionSource("ann", ()))))
    assert len(hashes) == 4


def test_the_rubric_with_all_its_programs_counts(tmp_path: Path, rubric: Rubric) -> None:
    """A changed rubric, reference node, import of one, or oracle makes another lab."""
    lab = tmp_path / "lab"
    lab.mkdir()
    shutil.copy(rubric.folder / "rubric.yaml", lab)
    shutil.copytree(rubric.folder / "reference", lab / "reference")
    here = read_rubric(lab / "rubric.yaml")
    assert here.folder == lab
    whole = fingerprint.lab_sha256(here)
    assert whole == fingerprint.lab_sha256(rubric)
    assert {"reference/arm.py", "reference/arm_model.py", "reference/oracles.py"} <= set(
        fingerprint.lab_files(here)
    )
    for name in ("arm.py", "arm_model.py", "oracles.py"):
        path = lab / "reference" / name
        text = path.read_text(encoding="utf-8")
        path.write_text(text + "\n# changed\n", encoding="utf-8")
        assert fingerprint.lab_sha256(here) != whole, name
        path.write_text(text, encoding="utf-8")
    assert fingerprint.lab_sha256(here) == whole
    assert fingerprint.lab_sha256(here.model_copy(update={"text": here.text + "\n"})) != whole


def test_words_points_and_checks_need_no_other_recordings(rubric: Rubric) -> None:
    """Words, points and checks do not change a recording's key.

    Sessions, programs and wanted files do.
    """
    whole = fingerprint.recording_sha256(rubric)
    words = rubric.text.replace("hint:", "hint: Look here.").replace("Lab 09-01", "Lab 9-1")
    assert words != rubric.text
    for change in ({"text": words}, {"criteria": rubric.criteria[:2]}, {"bonus": ()}):
        assert fingerprint.recording_sha256(rubric.model_copy(update=change)) == whole or (
            "bonus" in change
        )
    name, session = next(iter(rubric.sessions.items()))
    artifact = next(iter(rubric.artifacts))
    others: list[dict[str, Any]] = [
        {"sessions": {**rubric.sessions, name: session.model_copy(update={"steps": ()})}},
        {"artifacts": {k: v for k, v in rubric.artifacts.items() if k != artifact}},
        {"reference": {}},
    ]
    for change in others:
        assert fingerprint.recording_sha256(rubric.model_copy(update=change)) != whole, change


def test_of_the_rubrics_own_folder_not_everything_counts(tmp_path: Path, rubric: Rubric) -> None:
    """With programs right beside the rubric, the folders there, such as submissions, are no part of the lab."""
    for name in ("arm.py", "arm_model.py", "oracles.py"):
        shutil.copy(rubric.folder / "reference" / name, tmp_path)
    (tmp_path / "submissions").mkdir()
    (tmp_path / "submissions" / "ann.py").write_text("")
    specs = {
        name: spec.model_copy(update={"file": "arm.py"}) for name, spec in rubric.reference.items()
    }
    atomic_replacement = rubric.model_copy(update={"folder": tmp_path, "reference": specs})
    assert set(fingerprint.lab_files(atomic_replacement)) == {
        "arm.py",
        "arm_model.py",
        "oracles.py",
    }


@pytest.mark.parametrize(
    "options",
    [
        replace(OPTIONS, sessions=["publisher"]),
        replace(OPTIONS, seed=7),
        replace(OPTIONS, launch="native"),
        replace(OPTIONS, interpreter=Path("/usr/bin/env")),
    ],
)
def test_options_that_matter(options: Options) -> None:
    """Other sessions, seeds, interpreters and launch files' evaluations are other gradings."""
    assert fingerprint.options_sha256(options) != fingerprint.options_sha256(OPTIONS)


def test_options_that_do_not_matter() -> None:
    """The number of gradings side by side does not change the key of the options."""
    assert fingerprint.options_sha256(replace(OPTIONS, jobs=3)) == fingerprint.options_sha256(
        OPTIONS
    )


def test_decisions_of_people_concern_those_whom_they_name(tmp_path: Path, rubric: Rubric) -> None:
    """An override makes another policy for its submission alone; so does another time of submission."""
    override = "{submission: ann, bonus: 1, reason: a tip, who: me, when: 2026-11-21}"
    (tmp_path / "overrides.yaml").write_text(f"overrides:\n  - {override}\n", encoding="utf-8")
    decided = replace(OPTIONS, overrides=read_overrides(None, tmp_path, rubric))

    def policy(options: Options, name: str, submission_time: str = "") -> str:
        return fingerprint.judging_sha256(options, name, submission_time, "lab")

    assert policy(decided, "ann") != policy(OPTIONS, "ann")
    assert policy(decided, "bob") == policy(OPTIONS, "bob")
    assert policy(OPTIONS, "ann", "2026-11-21T10:00:00+00:00") != policy(OPTIONS, "ann")
    assert policy(decided, "ann") == policy(replace(decided, jobs=2), "ann")


def test_the_engine_is_the_same_until_it_changes() -> None:
    """Two looks at the same grader give the same hash."""
    assert fingerprint.engine_sha256() == fingerprint.engine_sha256()


def test_seeds_differ_between_submissions_and_runs_alone() -> None:
    """The seed depends on the submission's files and the class's own number, and on nothing else."""
    one, other = "a" * 64, "b" * 64
    seeds = set()
    for sha256 in (one, other):
        for run in (1, 2):
            seeds.add(fingerprint.seed_for(sha256, run))
    assert len(seeds) == 4
    for seed in seeds:
        assert 0 <= seed < 2**31
    assert fingerprint.seed_for(one, 1) == fingerprint.seed_for(one, 1)
