"""Several files of one artifact's name: contents, the lab's package and completeness decide which is graded."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric
from grader.recording.submission import ArtifactFact
from grader.submission.artifacts import read_submission_folder

TALKER = "import rclpy\nself.create_publisher(AckermannDriveStamped, 'drive', 10)\n"
RELAY = "self.create_subscription(AckermannDriveStamped, 'drive', self.heard, 10)  # drive_relay\n"
TUTORIAL = "self.create_publisher(String, 'topic', 10)\n"
LAUNCH = "def generate_launch_description(): ...\n"


@pytest.fixture
def rubric(tmp_path: Path) -> Rubric:
    """Give a lab with a package and three files."""
    return lab(tmp_path)


def lab(folder: Path, package: str | None = "lab1_pkg", **talker: object) -> Rubric:
    """Write a rubric."""
    known = {"package": package} if package else {}
    words = ["create_publisher", "AckermannDriveStamped"]
    plain = {
        "lab": {"id": "f1", "title": "One", "points": 1, **known},
        "artifacts": {
            "talker": {"file": "talker.py", "executable": "talker", "contains": words, **talker},
            "relay": {"file": "relay.py", "executable": "relay", "contains": ["drive_relay"]},
            "launch": {"file": "lab1_launch.py", "find": ["**/lab1_launch.py", "**/*launch.py"]},
        },
        "criteria": [
            {
                "id": "all",
                "title": "All",
                "points": 1,
                "checks": [{"id": "written", "points": 1, "by": "person"}],
            }
        ],
    }
    (folder / "lab").mkdir()
    (folder / "lab/rubric.yaml").write_text(yaml.safe_dump(plain, sort_keys=False))
    return read_rubric(folder / "lab/rubric.yaml")


def facts(folder: Path, rubric: Rubric, files: dict[str, str]) -> dict[str, ArtifactFact]:
    """Read a submission of some files; an empty text of a package.xml names the package of its folder."""
    for name, text in files.items():
        path = folder / "ann" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        named = f"<package><name>{path.parent.name}</name></package>"
        path.write_text(text or (named if path.name == "package.xml" else "\n"))
    record = read_submission_folder(folder / "ann", rubric)
    return {fact.name: fact for fact in record.artifacts}


SHALLOW = {"demo/demo/talker.py": TUTORIAL, "demo/package.xml": ""}
WORK = {
    "ws/src/lab1_pkg/package.xml": "",
    "ws/src/lab1_pkg/lab1_pkg/talker.py": TALKER,
    "ws/src/lab1_pkg/lab1_pkg/relay.py": RELAY,
    "ws/src/lab1_pkg/launch/lab1_launch.py": LAUNCH,
}
NEW = {"new/talker.py": TALKER, "new/relay.py": RELAY, "new/lab1_launch.py": LAUNCH}
CASES = {
    "a tutorial beside the work": (
        SHALLOW | WORK,
        "ws/src/lab1_pkg/lab1_pkg/talker.py",
        "asks for",
    ),
    "a tutorial in the root": (
        {"talker.py": TUTORIAL} | WORK,
        "ws/src/lab1_pkg/lab1_pkg/talker.py",
        "asks for",
    ),
    "the work in the root": (
        {"talker.py": TALKER, "relay.py": RELAY, "old/talker.py": TALKER + "# 1\n"},
        "talker.py",
        "holds 2 of the lab's files, old/ 1",
    ),
    "a tutorial with two names of the lab's": (
        SHALLOW | {"demo/demo/relay.py": TUTORIAL} | WORK,
        "ws/src/lab1_pkg/lab1_pkg/talker.py",
        "asks for",
    ),
    "both hold the words, one is in the package": (
        {
            "try/talker.py": TALKER + "# 1\n",
            "ws/lab1_pkg/package.xml": "",
            "ws/lab1_pkg/lab1_pkg/talker.py": TALKER,
        },
        "ws/lab1_pkg/lab1_pkg/talker.py",
        "the lab's package",
    ),
    "old beside new": (
        {"old/talker.py": TALKER + "# 1\n", "old/relay.py": RELAY + "# 1\n"} | NEW,
        "new/talker.py",
        "new/ holds 3 of the lab's files, old/ 2",
    ),
    "a word is missing in the newer version": (
        {"a/talker.py": TALKER + "# 1\n", "a/relay.py": RELAY + "# 1\n", "b/talker.py": "x\n"}
        | {"b/relay.py": RELAY, "b/lab1_launch.py": LAUNCH, "b/package.xml": ""},
        "a/talker.py",
        "asks for",
    ),
    "two complete ones, one of which says that it is old": (
        {f"old/{Path(name).name}": f"{text}# 1\n" for name, text in NEW.items()} | NEW,
        "new/talker.py",
        "the other lies in old/",
    ),
}


@pytest.mark.parametrize("beside", ["handout", "demo", "lab1 - Kopie", "lab1 copy", "tests"])
def test_a_folder_of_examples_or_copies_comes_last(
    tmp_path: Path, rubric: Rubric, beside: str
) -> None:
    """A file in a folder of examples or copies loses against an equally good file elsewhere."""
    files = {f"{beside}/talker.py": TALKER + "# 1\n", "work/talker.py": TALKER}
    fact = facts(tmp_path, rubric, files)["talker"]
    assert (fact.path, fact.is_open) == ("work/talker.py", False)
    assert fact.why == f"the other lies in {beside}/"


def test_the_launch_file_is_the_one_of_the_labs_programs(tmp_path: Path, rubric: Rubric) -> None:
    """Between launch files of one name, the one that starts the lab's programs is graded."""
    starts = LAUNCH + "# talker, relay\n"
    files = {"demo/lab1_launch.py": LAUNCH + "# turtle\n", "launch/lab1_launch.py": starts}
    fact = facts(tmp_path, rubric, files | {"talker.py": TALKER, "relay.py": RELAY})["launch"]
    assert (fact.path, fact.is_open) == ("launch/lab1_launch.py", False)
    assert fact.why == "it names 2 of the lab's programs, the other 0"


def test_the_launch_file_is_the_installed_one(tmp_path: Path, rubric: Rubric) -> None:
    """A launch file in a folder that setup.py names is graded, not a copy among the modules."""
    copy = {"lab1_pkg/lab1_pkg/launch/lab1_launch.py": LAUNCH + "# an earlier one\n"}
    package = {}
    for name, text in WORK.items():
        package[name.removeprefix("ws/src/")] = text
    package["lab1_pkg/setup.py"] = "data = [('share/lab1_pkg/launch', glob('launch/*.py'))]\n"
    fact = facts(tmp_path, rubric, copy | package)["launch"]
    assert (fact.path, fact.is_open) == ("lab1_pkg/launch/lab1_launch.py", False)
    assert fact.why == "only this one is installed by the build files of its package"


@pytest.mark.parametrize("case", CASES)
def test_contents_package_and_completeness_decide(
    tmp_path: Path, rubric: Rubric, case: str
) -> None:
    """The file is the one of the work, the other is named, and the reason is told."""
    files, wanted, why = CASES[case]
    fact = facts(tmp_path, rubric, files)["talker"]
    assert (fact.path, fact.is_open) == (wanted, False)
    assert why in fact.why
    others = {name for name in files if name.endswith("talker.py")} - {wanted}
    assert set(fact.passed_over) == others


def test_all_files_of_a_version_are_taken_together(tmp_path: Path, rubric: Rubric) -> None:
    """No program of one version runs beside another version's, unless its own version lacks it."""
    old = {"old/talker.py": TALKER + "# 1\n", "old/relay.py": RELAY + "# 1\n"}
    found = facts(tmp_path, rubric, old | NEW)
    assert {fact.path for fact in found.values()} == set(NEW)


def test_two_complete_versions_are_for_a_person(tmp_path: Path, rubric: Rubric) -> None:
    """One version is taken for all files, and the README's remarks about folders decide nothing."""
    other = {name.replace("new/", "b/"): f"{text}# 1\n" for name, text in NEW.items()}
    readme = {"README.md": "The final version is in `new/`.\n"}
    found = facts(tmp_path, rubric, other | NEW | readme)
    assert [fact.path for fact in found.values()] == list(other)
    assert all(fact.is_open for fact in found.values())


def test_copies_are_no_others(tmp_path: Path, rubric: Rubric) -> None:
    """The same file in two folders is one, so that nothing has to be said."""
    fact = facts(tmp_path, rubric, {"copy/talker.py": TALKER} | WORK)["talker"]
    assert (fact.passed_over, fact.why, fact.is_open) == ([], "", False)


def test_files_that_only_lie_apart_have_no_others(tmp_path: Path, rubric: Rubric) -> None:
    """A workspace of several packages is one work."""
    files = {"a/talker.py": TALKER, "b/relay.py": RELAY, "c/lab1_launch.py": LAUNCH}
    found = facts(tmp_path, rubric, files)
    assert [(fact.path, fact.passed_over) for fact in found.values()] == [
        (path, []) for path in files
    ]


def test_of_misspelt_names_the_work_is_taken_too(tmp_path: Path, rubric: Rubric) -> None:
    """A near miss of a name lies in several folders as well."""
    files = {"demo/talkr.py": TUTORIAL} | WORK
    files["ws/src/lab1_pkg/lab1_pkg/talkr.py"] = files.pop("ws/src/lab1_pkg/lab1_pkg/talker.py")
    fact = facts(tmp_path, rubric, files)["talker"]
    assert (fact.path, fact.found_by) == ("ws/src/lab1_pkg/lab1_pkg/talkr.py", "near miss")


def test_another_launch_file_is_no_rival_of_the_one_that_is_asked_for(
    tmp_path: Path, rubric: Rubric
) -> None:
    """Only files of the same name are told of; by a looser pattern, both are."""
    files = WORK | {"ws/src/lab1_pkg/launch/sensors_launch.py": LAUNCH + "# 1\n"}
    assert facts(tmp_path, rubric, files)["launch"].passed_over == []
    two = {"x/a_launch.py": LAUNCH, "x/b_launch.py": LAUNCH + "# 1\n", "x/talker.py": TALKER}
    (tmp_path / "b").mkdir()
    launch = facts(tmp_path / "b", rubric, two)["launch"]
    assert (launch.path, launch.passed_over, launch.is_open) == (
        "x/a_launch.py",
        ["x/b_launch.py"],
        True,
    )


def test_a_pattern_with_a_folder_matches_as_written(tmp_path: Path) -> None:
    """`**/pkg/x.py` is the file in a folder of that name, at any depth, and no other."""
    rubric = lab(tmp_path, find=["**/lab1_pkg/talker.py"], contains=[])
    found = facts(tmp_path, rubric, SHALLOW | WORK)
    assert found["talker"].path == "ws/src/lab1_pkg/lab1_pkg/talker.py"
    assert found["talker"].passed_over == []


def test_the_right_name_counts_among_files_beside_each_other(tmp_path: Path) -> None:
    """A complete copy under another name in the same folder is no other version of the work."""
    rubric = lab(tmp_path, find=["talker.py", "*talker.py"])
    files = {
        "talker.py": "print('not finished')\n",
        "backup_talker.py": TALKER,
        "relay.py": RELAY,
        "lab1_launch.py": LAUNCH,
    }
    assert facts(tmp_path, rubric, files)["talker"].path == "talker.py"
