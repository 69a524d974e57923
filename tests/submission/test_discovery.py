"""Paths on the command line: one submission, a folder of submissions, or a download of a class."""

from __future__ import annotations

import os
import shutil
import subprocess
import tarfile
import zipfile
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grader.errors import SubmissionError
from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric
from grader.submission.artifacts import read_submission
from grader.submission.discovery import Discovery, Shape, find_submissions
from grader.submission.extraction import Piece, SubmissionSource, open_submission
from tests.thorough import examples, part

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
FIVE = (
    "joint_publisher.py",
    "joint_subscriber.py",
    "robot_service.py",
    "robot_launch.py",
    "qos_comparison.py",
)


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


def lay_out(folder: Path, names: Iterable[str]) -> Path:
    """Write files that hold their own names; a name with a slash at its end is an empty folder."""
    for name in names:
        path = folder / name
        (path if name.endswith("/") else path.parent).mkdir(parents=True, exist_ok=True)
        if not name.endswith("/"):
            path.write_text(name)
    return folder


def pack(folder: Path, archive: Path) -> Path:
    """Pack a folder's contents as a zip or tar, by the suffix."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    if archive.suffix == ".zip":
        with zipfile.ZipFile(archive, "w") as packed:
            for path in files:
                packed.write(path, path.relative_to(folder))
    else:
        with tarfile.open(archive, "w") as packed_tar:
            for path in files:
                packed_tar.add(path, f"./{path.relative_to(folder)}")
    return archive


def in_folders(tree: Mapping[str, Iterable[str]]) -> list[str]:
    """Spell out folder -> names."""
    found = []
    for folder, names in tree.items():
        for name in names:
            found.append(f"{folder}/{name}")
    return found


def found_in(path: Path, rubric: Rubric, shape: Shape = Shape.AUTO) -> list[str]:
    """Return the names of the submissions in a path."""
    return [source.name for source in find_submissions([path], rubric, shape=shape).submissions]


def files_of(source: SubmissionSource) -> set[str]:
    """Give the files of a submission as the grader gets them."""
    with open_submission(source) as intake:
        found = set()
        for path in intake.folder.rglob("*"):
            if path.is_file():
                found.add(path.relative_to(intake.folder).as_posix())
        return found


OF_FRAMES = ("camera_mount.py", "arm_broadcaster.py", "target_listener.py", "frames_launch.py")

ONE = {
    "bare files": FIVE,
    "a file is missing": FIVE[:1],
    "packages in src": in_folders(
        {"src/pkg_a": FIVE[:2], "src/pkg_b": FIVE[2:], "src/pkg_c": FIVE[:1]}
    ),
    "packages side by side": in_folders({"pkg_a": FIVE[:2], "pkg_b": FIVE[2:]}),
    "packages with launch files of their own": in_folders(
        {"a": (FIVE[0], "a.launch.py"), "b": (*FIVE[1:], "b.launch.py")}
    ),
    "a package": ["package.xml", *in_folders({"nodes": FIVE[:3], "my_launch": FIVE[3:]})],
    "a workspace with a copy": in_folders({"ros2_ws/src/p": FIVE, "old": FIVE}),
    "two workspaces": in_folders({"ros2_ws/src/p": FIVE, "old_ws/src/p": FIVE}),
    "a wrapped workspace": in_folders({"lab/ros2_ws/src/p/p": FIVE}),
    "tasks": in_folders({"task1": FIVE, "task2": FIVE}),
    "a build beside it": in_folders(
        {"src/p": FIVE, "build/p": FIVE, "install/p": FIVE, ".git": ["HEAD"]}
    ),
    "packages, one with the launch files": in_folders(
        {
            "nodes_pkg": (*FIVE[:3], "package.xml", "all.launch.py"),
            "sim_pkg": ("sim.launch.py", "x.py", "package.xml"),
        }
    ),
    "a folder of launch files": in_folders(
        {"arm": FIVE, "bringup": ("a.launch.py", "b.launch.py")}
    ),
    "a demonstration, told in a README": [
        "README.md",
        *in_folders({"arm": FIVE, "demo": ("demo.launch.py", "x.py")}),
    ],
    "an archive": ["lab.zip"],
    "an archive and a report": ["lab.zip", "report.pdf"],
    "an archive beside the files": ["README.md", *in_folders({"lab": FIVE}), "lab.zip"],
    "nothing of interest": ["notes.txt", "a/b.txt"],
    "old and new": in_folders({"old": FIVE, "new": FIVE}),
    "versions by words": in_folders({"lab9_draft": FIVE, "lab9_final": FIVE}),
    "one and its copy": in_folders({"arm": FIVE, "arm (copy)": FIVE}),
    "a tutorial beside the work": in_folders({"arm": FIVE, "turtle_tutorial": FIVE[:2]}),
    "packages with the same files in src": in_folders({"ws/src/a": FIVE, "ws/src/b": FIVE}),
    "a workspace of doubled packages": in_folders({"src/a": FIVE, "src/b": FIVE}),
    "a repository with two solutions": in_folders({".git": ["HEAD"], "mine": FIVE, "hers": FIVE}),
}
EACH: dict[str, tuple[dict[str, Iterable[str]], list[str]]] = {
    "two students": ({"alice": FIVE, "bob": FIVE}, ["alice", "bob"]),
    "students with little in common": (
        {"alice": FIVE[:3], "bob": FIVE[2:], "eve": ["misnamed.py"]},
        ["alice", "bob", "eve"],
    ),
    "students with workspaces": (
        {"alice/ws/src/p/p": FIVE, "bob/lab": FIVE, "cem": FIVE},
        ["alice", "bob", "cem"],
    ),
    "fixtures": (
        {"one/submission": FIVE[:1], "two/submission": FIVE[:1], "two": ["expected.yaml"]},
        ["one", "two"],
    ),
    "a wrapped class": ({"lab9/alice": FIVE, "lab9/bob": FIVE}, ["alice", "bob"]),
    "with tables and litter": (
        {
            "alice": FIVE,
            "bob": FIVE,
            ".": ["grades.csv", ".DS_Store", "Thumbs.db"],
            "__MACOSX/alice": FIVE,
        },
        ["alice", "bob"],
    ),
    "with results": (
        {"alice": FIVE, "bob": FIVE, "results/alice/recordings": ["submission.json"]},
        ["alice", "bob"],
    ),
    "with an empty one": ({"alice": FIVE, "bob": FIVE, "eve": ["/"]}, ["alice", "bob", "eve"]),
    "one of each lab": ({"one": FIVE, "two": OF_FRAMES}, ["one", "two"]),
    "of each lab, one a package": (
        {"one": FIVE, "two": (*OF_FRAMES, "package.xml")},
        ["one", "two"],
    ),
    "all of another lab": ({"one": OF_FRAMES, "two/ws/src/p": OF_FRAMES}, ["one", "two"]),
    "archives": ({".": ["alice.zip", "bob.tar.gz", "grades.csv"]}, ["alice", "bob"]),
    "a folder and an archive": ({"alice": FIVE, ".": ["bob.zip"]}, ["alice", "bob"]),
}


@pytest.mark.parametrize("tree", ONE)
@pytest.mark.parametrize("form", ["folder", ".zip", ".tar"])
def test_one_submission(tree: str, form: str, rubric: Rubric, tmp_path: Path) -> None:
    """A student's files are one submission, in whatever folders they lie; its name is the path's."""
    folder = lay_out(tmp_path / "alice", ONE[tree])
    if form == "folder":
        path = folder
    else:
        path = pack(folder, tmp_path / f"alice{form}")
    found = find_submissions([path], rubric)
    assert [(source.name, source.pieces[0].member) for source in found.submissions] == [
        ("alice", "")
    ]
    assert found.understood == (f"{path}: one submission",)
    assert found.not_understood == ()


@pytest.mark.parametrize("tree", EACH)
@pytest.mark.parametrize("form", ["folder", ".zip", ".tar"])
def test_a_folder_of_submissions(tree: str, form: str, rubric: Rubric, tmp_path: Path) -> None:
    """Folders and archives of students are one submission each, also when they are packed together."""
    laid_out, names = EACH[tree]
    folder = lay_out(tmp_path / "group", in_folders(laid_out))
    if form == "folder":
        path = folder
    else:
        path = pack(folder, tmp_path / f"group{form}")
    found = find_submissions([path], rubric)
    if form == "folder":
        expected = names
    else:
        expected = [name for name in names if name != "eve" or tree != "with an empty one"]
    assert [source.name for source in found.submissions] == expected
    named = [line.rsplit(": ", 2)[1:] for line in found.not_understood]
    assert named == (
        [["results", "results of an earlier grading"]] if tree == "with results" else []
    )
    assert f"{len(expected)} submissions" in found.understood[0]


@pytest.mark.parametrize("form", ["folder", ".zip", ".tar"])
def test_each_gets_its_own_files(form: str, rubric: Rubric, tmp_path: Path) -> None:
    """Each submission can be extracted, and holds the files of one student alone."""
    folder = lay_out(tmp_path / "group", in_folders({"lab/alice": FIVE, "lab/bob/src/p": FIVE}))
    if form == "folder":
        path = folder
    else:
        path = pack(folder, tmp_path / f"group{form}")
    alice, bob = find_submissions([path], rubric).submissions
    assert files_of(alice) == set(FIVE)
    assert files_of(bob) == {f"src/p/{name}" for name in FIVE}
    with open_submission(bob) as intake:
        assert read_submission(intake, rubric).name == "bob"


WRAPPERS = (
    "lab9_submissions",
    "Lab 9",
    "Abgaben",
    "submissions",
    "archive",
    "old",
    "final",
    "backup",
    "lab9",
    "task2",
    "tests",
    "code",
    "a/b/c/d/e/f",
    "Lab_09-01_Abgaben/Abgaben",
)
#: Names of the only folder and of the archive; every run tries a quarter of the pairs.
NAMED = part(
    [(wrapper, packed) for wrapper in WRAPPERS for packed in ("lab9_submissions", "export")], 4
)


@pytest.mark.parametrize("shape", [Shape.AUTO, Shape.EACH])
@pytest.mark.parametrize(("wrapper", "packed"), NAMED)
def test_a_single_folder_is_a_wrapper(
    wrapper: str, packed: str, shape: Shape, rubric: Rubric, tmp_path: Path
) -> None:
    """Whatever the only folder and the archive are called, a class in it is the class of the unpacked folder."""
    tree = in_folders({f"{wrapper}/alice": FIVE, f"{wrapper}/bob": FIVE[:3]})
    folder = lay_out(tmp_path / packed, tree)
    archive = pack(folder, tmp_path / f"{packed}.zip")
    inner = folder / wrapper
    for path in (folder, archive, inner, pack(inner, tmp_path / "inner.zip")):
        found = find_submissions([path], rubric, shape=shape)
        assert [source.name for source in found.submissions] == ["alice", "bob"], path
        assert files_of(found.submissions[1]) == set(FIVE[:3])
        assert found.doubts == ()


@pytest.mark.parametrize("shape", [Shape.AUTO, Shape.EACH])
def test_the_only_one_of_a_class_keeps_the_name(
    shape: Shape, rubric: Rubric, tmp_path: Path
) -> None:
    """With a single submission, the folder in the class's folder counts, however it is packed."""
    folder = lay_out(tmp_path / "export", in_folders({"Lab 9/Abgaben/alice/ws/src/p": FIVE}))
    for path in (folder, pack(folder, tmp_path / "export.zip")):
        (alice,) = find_submissions([path], rubric, shape=Shape.AUTO).submissions
        assert (alice.name, files_of(alice)) == ("alice", {f"ws/src/p/{name}" for name in FIVE})
    flat = lay_out(tmp_path / "flat", in_folders({"Lab 9/alice": FIVE}))
    (alice,) = find_submissions([flat], rubric, shape=Shape.EACH).submissions
    assert (alice.name, files_of(alice)) == ("alice", set(FIVE))


def test_a_large_class_in_a_wrapper_is_seen_whole(rubric: Rubric, tmp_path: Path) -> None:
    """A wrapped folder with more names than one submission has holds all of its students."""
    names = [f"s{number:03}" for number in range(60)]
    extra = [f"data/{number}.txt" for number in range(110)]
    tree = in_folders({f"lab/{name}": (FIVE[0], *extra) for name in names})
    assert found_in(lay_out(tmp_path / "export", tree), rubric) == names


MANIFEST = '<?xml version="1.0"?><package format="3"><name>{}</name></package>'


def test_packages_with_the_same_file_are_one_submission(rubric: Rubric, tmp_path: Path) -> None:
    """A package named as its folder is no student: a tutorial's package beside the work's stays part of it."""
    folder = lay_out(tmp_path / "alice", in_folders({"arm_lab/arm_lab": FIVE, "turtle": FIVE[:1]}))
    for name in ("arm_lab", "turtle"):
        (folder / name / "package.xml").write_text(MANIFEST.format(name))
    for path in (folder, pack(folder, tmp_path / "alice.zip")):
        found = find_submissions([path], rubric)
        assert [source.name for source in found.submissions] == ["alice"]
        (doubt,) = found.doubts
        assert "arm_lab/ and turtle/" in doubt
        assert "--each" in doubt
    (folder / "turtle/package.xml").write_text(MANIFEST.format("turtlesim_tutorial"))
    assert found_in(folder, rubric) == ["alice"], "one package and one folder share nothing else"


@pytest.mark.parametrize("around", ["src", "ws/src", "lab09/src", "ros2_ws"])
@pytest.mark.parametrize("inner", ["", "/physical_ai_textbook"])
def test_doubled_folders_in_a_workspace_are_told(
    around: str, inner: str, rubric: Rubric, tmp_path: Path
) -> None:
    """A group's workspace is one submission, with the doubled folders named; the remedy makes each of them one."""
    tree = in_folders({f"{around}/anna{inner}": FIVE, f"{around}/ben{inner}": FIVE[:2]})
    folder = lay_out(tmp_path / "lab", tree)
    for path in (folder, pack(folder, tmp_path / "lab.zip")):
        found = find_submissions([path], rubric)
        assert [source.name for source in found.submissions] == ["lab"]
        (doubt,) = found.doubts
        inside = around.removeprefix("lab09/")
        assert f"{inside}/anna/ and {inside}/ben/ in it hold the same file" in doubt
        assert "--each" in doubt
        assert found_in(path, rubric, Shape.EACH) == ["anna", "ben"]


@pytest.mark.parametrize("form", ["old and new", "versions by words"])
def test_versions_are_not_told_as_doubled(form: str, rubric: Rubric, tmp_path: Path) -> None:
    """Folders named as versions of one work are no students', below a workspace too."""
    wrapped = [f"ws/src/{name}" for name in ONE["old and new"]]
    for tree in (ONE[form], wrapped):
        found = find_submissions([lay_out(tmp_path / str(len(tree[0])), tree)], rubric)
        assert len(found.submissions) == 1
        assert found.doubts == ()


def test_sections_of_a_class_are_told(rubric: Rubric, tmp_path: Path) -> None:
    """A folder among submissions that holds a class itself is named, and its versions of one work are not."""
    sections = {
        "Group 1/ann": FIVE,
        "Group 1/bob": FIVE,
        "Group 2": FIVE,
        "cy/old": FIVE,
        "cy/new": FIVE,
    }
    folder = lay_out(tmp_path / "class", in_folders(sections))
    for path in (folder, pack(folder, tmp_path / "class.zip")):
        found = find_submissions([path], rubric)
        assert [source.name for source in found.submissions] == ["cy", "Group_1", "Group_2"]
        (doubt,) = found.doubts
        assert "Group 1" in doubt.partition(": taken as one submission")[0]
        assert "ann/ and bob/ in it look like submissions" in doubt


def test_students_whose_folders_are_packages_are_a_class(rubric: Rubric, tmp_path: Path) -> None:
    """Whole packages, or packages of the lab's name in folders of students, are one submission each."""
    group = lay_out(tmp_path / "group", in_folders({"alice": FIVE, "bob": FIVE}))
    for name in ("alice", "bob"):
        (group / name / "package.xml").write_text(MANIFEST.format(name))
    assert found_in(group, rubric) == ["alice", "bob"]
    group = lay_out(tmp_path / "other", in_folders({"alice": FIVE[:1], "bob": FIVE[:2]}))
    for name in ("alice", "bob"):
        (group / name / "package.xml").write_text(MANIFEST.format("student_lab"))
    assert found_in(group, rubric) == ["alice", "bob"]


def test_a_class_of_which_nobody_is_on_the_list_stops(rubric: Rubric, tmp_path: Path) -> None:
    """A list of another class, or submissions told apart wrongly, end with the question which of both it is."""
    group = lay_out(tmp_path / "group", in_folders({"alice": FIVE, "bob": FIVE}))
    (tmp_path / "class.csv").write_text("name\nzoe\nyann\n", encoding="utf-8")
    for shape in (Shape.AUTO, Shape.ONE):
        with pytest.raises(SubmissionError, match="nobody on the class list") as caught:
            find_submissions([group], rubric, shape=shape, class_list=tmp_path / "class.csv")
        assert "--each" in caught.value.remedy
    (tmp_path / "class.csv").write_text("name\nzoe\nbob\n", encoding="utf-8")
    found = find_submissions([group], rubric, class_list=tmp_path / "class.csv")
    assert found.missing == ("zoe",)


def test_a_path_called_submissions_holds_submissions(rubric: Rubric, tmp_path: Path) -> None:
    """The folder's name tells a class, even if only one student has submitted yet."""
    for name in ("submissions", "lab-09-submissions", "Students (2)"):
        assert found_in(lay_out(tmp_path / name, in_folders({"alice": FIVE})), rubric) == ["alice"]
        assert found_in(lay_out(tmp_path / f"{name}/more", ["x.txt"]).parent, rubric) == [
            "alice",
            "more",
        ]
    assert found_in(lay_out(tmp_path / "submission", in_folders({"lab": FIVE})), rubric) == [
        "submission"
    ]


def test_what_the_user_says_goes_first(rubric: Rubric, tmp_path: Path) -> None:
    """One is one however it looks, and each is each."""
    group = lay_out(tmp_path / "group", in_folders({"alice": FIVE, "bob": FIVE}))
    assert found_in(group, rubric, Shape.ONE) == ["group"]
    parts = lay_out(tmp_path / "parts", in_folders({"pkg_a": FIVE[:2], "pkg_b": FIVE[2:]}))
    assert found_in(parts, rubric, Shape.EACH) == ["pkg_a", "pkg_b"]


def test_this_projects_own_folders(rubric: Rubric) -> None:
    """The sample is one submission in a folder of such, and the fixtures are many."""
    assert found_in(ROOT / "submissions", rubric) == ["alice"]
    assert found_in(ROOT / "submissions/alice", rubric) == ["alice"]
    assert found_in(ROOT / "reference/solution", rubric) == ["solution"]
    fixtures = {path.parent.name for path in (ROOT / "fixtures").glob("*/expected.yaml")}
    assert fixtures <= set(found_in(ROOT / "fixtures", rubric))


def test_what_is_not_understood_is_reported(rubric: Rubric, tmp_path: Path) -> None:
    """A file among students' folders belongs to nobody, and is named."""
    group = lay_out(
        tmp_path / "group", ["stray.py", "\x1b[2J.py", *in_folders({"alice": FIVE, "bob": FIVE})]
    )
    found = find_submissions([group], rubric)
    assert len(found.submissions) == 2
    assert len(found.not_understood) == 2
    assert all(line.isprintable() for line in found.not_understood)


def test_a_path_that_is_not_there_stands_for_itself(rubric: Rubric, tmp_path: Path) -> None:
    """A missing path is refused at its grading, and does not stop the others."""
    lay_out(tmp_path / "alice", FIVE)
    os.mkfifo(tmp_path / "pipe")
    found = find_submissions([tmp_path / "alice", tmp_path / "bob", tmp_path / "pipe"], rubric)
    assert [source.name for source in found.submissions] == ["alice", "bob", "pipe"]
    for source in found.submissions[1:]:
        with pytest.raises(SubmissionError), open_submission(source):
            pass


# -- downloads of learning-management systems ----------------------------------------------------------


def download(tmp_path: Path, form: str, names: Iterable[str]) -> Path:
    """Lay a download out as a folder, or as the zip that it comes as; zips in it hold a file."""
    folder = lay_out(tmp_path / "export", names)
    for path in [path for path in folder.rglob("*") if path.suffix == ".zip"]:
        with zipfile.ZipFile(path, "w") as packed:
            packed.writestr("lab/joint_publisher.py", path.name)
    if form == "folder":
        return folder
    return pack(folder, tmp_path / "export.zip")


def by_name(found: Discovery) -> dict[str, SubmissionSource]:
    """Give the submissions by their names."""
    return {source.name: source for source in found.submissions}


@pytest.mark.parametrize("form", ["folder", "zip"])
@pytest.mark.parametrize("folders", [True, False])
def test_moodles_download(form: str, folders: bool, rubric: Rubric, tmp_path: Path) -> None:
    """Each student is one submission, even two of one name; typed text belongs to it."""
    slash = "/" if folders else ""
    names = [
        f"Ann Müller_11_assignsubmission_file_{slash}lab.zip",
        f"Ann Müller_11_assignsubmission_onlinetext_{slash}onlinetext.html",
        f"Ann Müller_12_assignsubmission_file_{slash}joint_publisher.py",
        f"Ann Müller_12_assignsubmission_file_{slash}README.md",
        f"Group 3-Bob_13_assignsubmission_file_{slash}lab.zip",
        "grades.csv",
    ]
    found = find_submissions([download(tmp_path, form, names)], rubric)
    students = by_name(found)
    assert list(students) == ["Ann_Müller_11", "Ann_Müller_12", "Group_3-Bob_13"]
    assert [source.student_id for source in students.values()] == ["11", "12", "13"]
    assert files_of(students["Ann_Müller_11"]) == {"lab/joint_publisher.py", "onlinetext.html"}
    assert files_of(students["Ann_Müller_12"]) == {"joint_publisher.py", "README.md"}
    assert "Moodle's download of 3 submissions" in found.understood[0]
    assert found.not_understood == ()


@pytest.mark.parametrize("form", ["folder", "zip"])
def test_canvas_download(form: str, rubric: Rubric, tmp_path: Path) -> None:
    """Loose files of a student are one submission, under the names that the student gave them."""
    names = [
        "annmueller_67_890_lab.zip",
        "bobvan_der_berg_LATE_68_891_joint_publisher-2.py",
        "bobvan_der_berg_LATE_68_892_robot_1_2_service.py",
        "bobvan_der_berg_LATE_68_893_a.py",
        "bobvan_der_berg_LATE_68_894_a-1.py",
        "cem_69_text.html",
        "anon_Xy3zA_900_lab.zip",
        "stray.pdf",
    ]
    found = find_submissions([download(tmp_path, form, names)], rubric)
    students = by_name(found)
    assert list(students) == ["annmueller_67", "anon_Xy3zA", "bobvan_der_berg_68", "cem_69"]
    bob = students["bobvan_der_berg_68"]
    assert (bob.student_id, bob.student, bob.marked_late_by) == ("68", "bobvan_der_berg", "Canvas")
    assert files_of(bob) == {"joint_publisher.py", "robot_1_2_service.py", "a.py", "a-1.py"}
    assert students["annmueller_67"].marked_late_by == ""
    assert files_of(students["annmueller_67"]) == {"lab/joint_publisher.py"}
    assert files_of(students["cem_69"]) == {"text.html"}
    assert len(found.not_understood) == 1
    assert "stray.pdf" in found.not_understood[0]


@pytest.mark.parametrize("form", ["folder", "zip"])
def test_blackboards_download(form: str, rubric: Rubric, tmp_path: Path) -> None:
    """The last attempt counts, with its time; earlier ones are told."""
    names = [
        "Lab 9_ann1_attempt_2026-03-01-12-00-00.txt",
        "Lab 9_ann1_attempt_2026-03-01-12-00-00_joint_publisher.py",
        "Lab 9_ann1_attempt_2026-03-02-23-41-05.txt",
        "Lab 9_ann1_attempt_2026-03-02-23-41-05_robot_service.py",
        "Lab 9_bob2_attempt_2026-03-02-08-00-00.txt",
    ]
    found = find_submissions([download(tmp_path, form, names)], rubric)
    ann, bob = found.submissions
    assert (ann.name, ann.student_id) == ("ann1", "ann1")
    assert ann.submitted_at == datetime(2026, 3, 2, 23, 41, 5)
    assert files_of(ann) == {"robot_service.py"}
    assert len(found.not_understood) == 2
    with pytest.raises(SubmissionError, match="empty"), open_submission(bob):
        pass


def test_nobody_of_a_large_class_is_lost(rubric: Rubric, tmp_path: Path) -> None:
    """A download of thousands of loose files is understood to its last student."""
    names = []
    for student in range(1, 1201):
        for file in range(5):
            names.append(f"student{student}_{student}_{file}_f{file}.py")
    found = find_submissions([lay_out(tmp_path / "export", names)], rubric)
    assert len(found.submissions) == 1200
    assert all(len(source.pieces) == 5 for source in found.submissions)


def test_github_classrooms_clones(rubric: Rubric, tmp_path: Path) -> None:
    """Repositories beside each other are one submission each; the last commit proves no time of submission."""
    folder = tmp_path / "lab-09-submissions"
    for number, name in enumerate(("alice", "bob")):
        clone = lay_out(folder / f"lab-09-{name}", FIVE)
        commit(clone, f"2026-03-0{number + 1}T12:00:00+01:00")
    found = find_submissions([folder], rubric)
    assert [(source.name, source.student_id) for source in found.submissions] == [
        ("lab-09-alice", "alice"),
        ("lab-09-bob", "bob"),
    ]
    zone = timezone(timedelta(hours=1))
    assert [source.last_commit for source in found.submissions] == [
        datetime(2026, 3, 1, 12, tzinfo=zone),
        datetime(2026, 3, 2, 12, tzinfo=zone),
    ]
    assert [source.submission_time.at for source in found.submissions] == [None, None]
    assert files_of(found.submissions[0]) == set(FIVE)
    alone = find_submissions([folder / "lab-09-bob"], rubric).submissions[0]
    assert alone.last_commit == datetime(2026, 3, 2, 12, tzinfo=zone)


def commit(folder: Path, time: str) -> None:
    """Make a folder a repository with one commit."""
    environment = {"PATH": os.environ["PATH"], "HOME": str(folder), "GIT_CONFIG_NOSYSTEM": "1"}
    environment |= {"GIT_AUTHOR_DATE": "2020-01-01T00:00:00+00:00", "GIT_COMMITTER_DATE": time}
    who = ("-c", "user.name=ann", "-c", "user.email=ann@example.org")
    for command in (("init", "-q"), ("add", "."), (*who, "commit", "-q", "-m", "hand in")):
        subprocess.run(["git", *command], cwd=folder, env=environment, check=True)


# -- as other systems and other teachers lay them out ------------------------------------------------------


@pytest.mark.parametrize("form", ["folder", "zip"])
def test_brightspaces_download(form: str, rubric: Rubric, tmp_path: Path) -> None:
    """A folder for each time that a student handed in: the last one counts, with its time; the index is nobody's."""
    names = [
        "index.html",
        "67-900 - Mary-Ann O'Brien - Mar 1, 2026 1159 PM/lab.zip",
        "67-900 - Mary-Ann O'Brien - Mar 2, 2026 121 PM/lab.zip",
        "68-900 - Anne - Marie Smith - Feb 28, 2026 900 AM/lab.zip",
    ]
    found = find_submissions([download(tmp_path, form, names)], rubric)
    students = by_name(found)
    assert list(students) == ["Anne_-_Marie_Smith_68", "Mary-Ann_O_Brien_67"]
    mary = students["Mary-Ann_O_Brien_67"]
    assert (mary.student, mary.student_id) == ("Mary-Ann O'Brien", "67")
    assert mary.submitted_at == datetime(2026, 3, 2, 13, 21)
    assert files_of(mary) == {"lab/joint_publisher.py"}
    assert "Brightspace's download of 2 submissions" in found.understood[0]
    assert [line.rpartition(": ")[2] for line in found.not_understood] == ["an earlier attempt"]


@pytest.mark.parametrize("form", ["folder", "zip"])
def test_a_single_student_of_brightspace(form: str, rubric: Rubric, tmp_path: Path) -> None:
    """The index beside a folder shows that the folder is the first student of a class."""
    names = ["index.html", "67-900 - Ann Smith - 1 mars, 2026 2359/lab.zip"]
    (ann,) = find_submissions([download(tmp_path, form, names)], rubric).submissions
    assert (ann.name, ann.submitted_at) == ("Ann_Smith_67", None)


@pytest.mark.parametrize("form", ["folder", "zip"])
def test_sakais_download(form: str, rubric: Rubric, tmp_path: Path) -> None:
    """Names and ids come from the folders, times from the files beside the attachments."""
    names = [
        "Lab 9/grades.csv",
        "Lab 9/Müller, Ann(ann1)/Submission attachment(s)/lab.zip",
        "Lab 9/O'Brien, Bob(bob2)/Submission attachment(s)/joint_publisher.py",
        "Lab 9/Çelik, Cem(cem3)/Submission attachment(s)/lab.zip",
    ]
    folder = download(tmp_path, "folder", names)
    (folder / "Lab 9/Müller, Ann(ann1)/timestamp.txt").write_text("20260302224105123")
    (folder / "Lab 9/O'Brien, Bob(bob2)/timestamp.txt").write_text("2026-03-02T22:41:05Z\n")
    (folder / "Lab 9/Çelik, Cem(cem3)/timestamp.txt").write_text("yesterday")
    if form == "folder":
        path = folder
    else:
        path = pack(folder, tmp_path / "export.zip")
    students = by_name(find_submissions([path], rubric))
    assert list(students) == ["Müller_Ann_ann1", "O_Brien_Bob_bob2", "Çelik_Cem_cem3"]
    told = datetime(2026, 3, 2, 22, 41, 5, tzinfo=UTC)
    assert [source.submitted_at for source in students.values()] == [told, told, None]
    assert "Submission attachment(s)/joint_publisher.py" in files_of(students["O_Brien_Bob_bob2"])
    assert "lab/joint_publisher.py" in files_of(students["Müller_Ann_ann1"])


GRADESCOPE = """\
submission_101:
  :submitters:
  - :name: Ann Smith
    :sid: '0012'
    :email: ann@example.org
  :created_at: 2026-03-02 22:41:05.123456789 Z
  :score: 85.0
  :results:
    :tests:
    - :name: Mallory
      :output: "submission_102:\\n  :submitters:\\n"
submission_102:
  :submitters:
  - :name: Bob Jones
    :email: bob@example.org
  - :name: "Cem \\u00c7elik"
    :sid: '0014'
  :created_at: 2026-03-02 14:41:05 -08:00
submission_103:
  :submitters: []
"""


@pytest.mark.parametrize("form", ["folder", "zip"])
def test_gradescopes_export(form: str, rubric: Rubric, tmp_path: Path) -> None:
    """Names and times come from the export's table; all members of a group are named."""
    names = []
    for n in (101, 102, 103):
        for file in FIVE:
            names.append(f"assignment_7_export/submission_{n}/{file}")
    folder = download(tmp_path, "folder", names)
    (folder / "assignment_7_export/submission_metadata.yml").write_text(
        GRADESCOPE, encoding="utf-8"
    )
    if form == "folder":
        path = folder
    else:
        path = pack(folder, tmp_path / "export.zip")
    found = find_submissions([path], rubric)
    students = by_name(found)
    assert list(students) == [
        "Ann_Smith_0012",
        "Bob_Jones_Cem_Çelik_submission_102",
        "submission_103",
    ]
    ann, both, nobody = students.values()
    assert (ann.student, ann.student_id) == ("Ann Smith", "0012")
    assert ann.submitted_at == datetime(2026, 3, 2, 22, 41, 5, 123456, tzinfo=UTC)
    assert (both.student_id, both.submitted_at) == (
        None,
        datetime(2026, 3, 2, 22, 41, 5, tzinfo=UTC),
    )
    assert nobody.submitted_at is None
    assert files_of(ann) == set(FIVE)
    assert found.not_understood == ()


def test_a_download_of_one_is_reported_beside_tables(rubric: Rubric, tmp_path: Path) -> None:
    """Where only one has handed in so far, the system's tables of grades do not outnumber the student."""
    names = [f"Ann Lee_11_assignsubmission_file_/{FIVE[0]}", "Grades-Lab 9.csv", "worksheet.xlsx"]
    found = find_submissions([lay_out(tmp_path / "export", names)], rubric)
    assert [(h.name, h.student_id) for h in found.submissions] == [("Ann_Lee_11", "11")]
    assert found.not_understood == ()


def test_user_names_with_underscores_stay_apart(rubric: Rubric, tmp_path: Path) -> None:
    """On Blackboard, a title, a user's name and a group's may hold underscores; nobody is taken for another."""
    names = []
    for who in ("a_smith", "b_smith", "Group 1"):
        names.append(f"Lab_9 (B)_{who}_attempt_2026-03-01-12-00-00_joint_publisher.py")
    found = find_submissions([lay_out(tmp_path / "export", names)], rubric)
    assert [(h.name, h.student_id) for h in found.submissions] == [
        ("a_smith", "a_smith"),
        ("b_smith", "b_smith"),
        ("Group_1", "Group 1"),
    ]
    assert found.not_understood == ()


def test_canvas_marks_lateness_in_each_form(rubric: Rubric, tmp_path: Path) -> None:
    """The mark is no part of a name, neither where there is none nor in small letters."""
    names = ["LATE_anon_Xy3zA_900_lab.zip", "bob_late_68_901_lab.zip", "latelyann_69_902_lab.zip"]
    found = find_submissions([download(tmp_path, "folder", names)], rubric)
    assert {h.name: h.marked_late_by for h in found.submissions} == {
        "anon_Xy3zA": "Canvas",
        "bob_68": "Canvas",
        "latelyann_69": "",
    }


@pytest.mark.parametrize("number", ["09_01", "9_1"])
def test_files_with_the_labs_number_are_one_students(
    number: str, rubric: Rubric, tmp_path: Path
) -> None:
    """Names such as lab_9_1_joint_publisher.py resemble Canvas's names, numbers included."""
    folder = lay_out(tmp_path / "alice", [f"lab_{number}_{name}" for name in FIVE])
    assert found_in(folder, rubric) == ["alice"]


OTHER_CLASSES: dict[str, tuple[Iterable[str], list[str]]] = {
    "an archive in each folder": (
        ["alice/lab.zip", "bob/lab.tar.gz", "cem/x/lab.7z"],
        ["alice", "bob", "cem"],
    ),
    "archives and files": (
        in_folders({"alice": FIVE, "bob": ["lab.zip", "notes.pdf"], "cem": ["lab.zip"]}),
        ["alice", "bob", "cem"],
    ),
    "numbers of students that begin like a section's": (
        in_folders({"V00812345": FIVE, "V00812346": FIVE}),
        ["V00812345", "V00812346"],
    ),
    "workspaces called after students": (
        in_folders({"anna_ws/src/p": FIVE, "bob_ws/src/p": FIVE}),
        ["anna_ws", "bob_ws"],
    ),
    "a table beside the folder of a class": (
        [
            "grades.xlsx",
            *in_folders({"Abgaben/Ann_1": FIVE, "Abgaben/Bob_2": FIVE[:1]}),
            "Abgaben/status.xlsx",
        ],
        ["Ann_1", "Bob_2"],
    ),
}


@pytest.mark.parametrize("tree", OTHER_CLASSES)
@pytest.mark.parametrize("form", ["folder", ".zip"])
def test_other_folders_of_submissions(tree: str, form: str, rubric: Rubric, tmp_path: Path) -> None:
    """A class is recognised even with packed files, or names like parts of a submission."""
    laid_out, names = OTHER_CLASSES[tree]
    folder = lay_out(tmp_path / "group", laid_out)
    if form == "folder":
        path = folder
    else:
        path = pack(folder, tmp_path / "group.zip")
    found = find_submissions([path], rubric)
    assert [source.name for source in found.submissions] == names
    assert found.not_understood == ()


@pytest.mark.parametrize("form", ["folder", ".zip"])
def test_teams_keeps_each_version(form: str, rubric: Rubric, tmp_path: Path) -> None:
    """The last of several versions counts, and the others are reported."""
    tree = [f"Submitted files/Ann Lee/Lab 9/Version {n}/{FIVE[0]}" for n in (1, 2, 10)]
    tree += [
        f"Submitted files/Bob Ray/Lab 9/Version 1/{FIVE[0]}",
        f"Submitted files/Cem/Lab 9/{FIVE[0]}",
    ]
    folder = lay_out(tmp_path / "group", tree)
    found = find_submissions(
        [folder if form == "folder" else pack(folder, tmp_path / "group.zip")], rubric
    )
    assert {h.name: files_of(h) for h in found.submissions} == {
        "Ann_Lee": {FIVE[0]},
        "Bob_Ray": {FIVE[0]},
        "Cem": {f"Lab 9/{FIVE[0]}"},
    }
    assert found.submissions[0].pieces[0].member.endswith("Version 10/" if form == ".zip" else "")
    assert [line.rpartition(": ")[0].rpartition(": ")[2] for line in found.not_understood] == [
        "Version 1",
        "Version 2",
    ]


def test_a_class_that_is_packed_twice_is_no_submission(rubric: Rubric, tmp_path: Path) -> None:
    """An archive within an archive is refused with a remedy if it holds a class.

    One submission is unpacked.
    """
    tree = lay_out(tmp_path / "tree", in_folders({"alice": FIVE, "bob": FIVE}))
    outer = lay_out(tmp_path / "mail", [".DS_Store"])
    pack(tree, outer / "submissions.zip")
    packed = pack(outer, tmp_path / "mail.zip")
    with pytest.raises(SubmissionError, match=r"submissions\.zip") as caught:
        find_submissions([packed], rubric)
    assert "--one" in caught.value.remedy
    assert found_in(packed, rubric, Shape.ONE) == ["mail"]
    pack(tree / "alice", outer / "submissions.zip")
    assert found_in(pack(outer, packed), rubric) == ["mail"]


def test_a_stray_file_of_the_lab_does_not_hide_a_class(rubric: Rubric, tmp_path: Path) -> None:
    """In a folder called submissions, a file of the lab beside the students' folders belongs to nobody."""
    tree = [FIVE[0], *in_folders({"alice": FIVE, "bob": FIVE})]
    found = find_submissions([lay_out(tmp_path / "submissions", tree)], rubric)
    assert [source.name for source in found.submissions] == ["alice", "bob"]
    assert [FIVE[0] in line for line in found.not_understood] == [True]
    assert found_in(lay_out(tmp_path / "alice", tree), rubric) == ["alice"]
    kept = lay_out(tmp_path / "lab-09-submissions", [".git/HEAD", *tree[1:]])
    assert found_in(kept, rubric) == ["alice", "bob"], "an instructor keeps them in a repository"


def test_a_commit_of_tomorrow_tells_no_time(rubric: Rubric, tmp_path: Path) -> None:
    """Where a student's clock was ahead, the time is not known, instead of late."""
    folder = lay_out(tmp_path / "alice", FIVE)
    commit(folder, "2099-03-01T12:00:00+01:00")
    (source,) = find_submissions([folder], rubric).submissions
    assert (source.submitted_at, source.last_commit) == (None, None)


def test_a_list_does_not_tell_namesakes_apart(rubric: Rubric, tmp_path: Path) -> None:
    """Namesakes get no time from the list, and no student with a submission is called missing."""
    export = lay_out(
        tmp_path / "export",
        [
            f"{n}_assignsubmission_file_/{FIVE[0]}"
            for n in ("Ann Müller_11", "Ann Müller_12", "Bo_13")
        ],
    )
    rows = [
        "Ann Müller,100,2026-03-02T23:00Z",
        "Ann Müller,200,2026-03-09T23:00Z",
        "Bo,300,2026-03-01T08:00Z",
    ]
    for listed in (rows, rows[1:]):
        (tmp_path / "class.csv").write_text(
            "\n".join(["name,student_id,submitted_at", *listed]), encoding="utf-8"
        )
        found = find_submissions([export], rubric, class_list=tmp_path / "class.csv")
        assert [(h.student_id, h.submitted_at is None) for h in found.submissions] == [
            ("11", True),
            ("12", True),
            ("300", False),
        ]
        assert found.missing == ()
        assert sum("the name alone does not say" in line for line in found.understood) == 2


def test_a_list_does_not_call_missing_who_handed_in_twice(rubric: Rubric, tmp_path: Path) -> None:
    """Two submissions of one name get marks; that the student is there is known all the same."""
    folder = lay_out(tmp_path / "group", in_folders({"alice": FIVE, "bob": FIVE}))
    pack(folder / "alice", folder / "alice.zip")
    (tmp_path / "class.csv").write_text("name\nalice\nbob\nzoe\n", encoding="utf-8")
    found = find_submissions([folder], rubric, class_list=tmp_path / "class.csv")
    assert [source.name[:6] for source in found.submissions] == ["alice-", "alice-", "bob"]
    assert found.missing == ("zoe",)


def test_a_list_with_a_line_for_each_hand_in(rubric: Rubric, tmp_path: Path) -> None:
    """The last time counts; surnames may come first, and times end with UTC, as other systems write them."""
    rows = [
        "name,student_id,submitted_at",
        '"Müller, Ann",100,2026-03-02 22:00:00 UTC',
        '"Müller, Ann",100,2026-03-03 22:00:00 UTC',
        '"Müller, Ann",100,',
    ]
    (tmp_path / "class.csv").write_text("\n".join(rows), encoding="utf-8")
    export = lay_out(tmp_path / "export", [f"Ann Müller_11_assignsubmission_file_/{FIVE[0]}"])
    found = find_submissions([export], rubric, class_list=tmp_path / "class.csv")
    assert [h.submitted_at for h in found.submissions] == [datetime(2026, 3, 3, 22, tzinfo=UTC)]
    assert found.missing == ()


# -- names and the class list ----------------------------------------------------------------------------


def test_equal_names_are_distinguished_for_good(rubric: Rubric, tmp_path: Path) -> None:
    """Submissions of one name get marks that depend neither on the order nor on the other paths."""
    paths = [lay_out(tmp_path / folder / "alice", FIVE) for folder in "ab"]
    found = find_submissions(paths, rubric)
    for source in found.submissions:
        called = f"called {source.name}, because there is another alice"
        assert f"{source.location}: {called}" in found.understood
        assert source.name.startswith("alice-")
    names = {source.name for source in found.submissions}
    assert len(names) == 2
    paths.append(lay_out(tmp_path / "c" / "Alice", FIVE))
    again = find_submissions([Path(os.path.relpath(path)) for path in reversed(paths)], rubric)
    names_again = {source.name for source in again.submissions}
    assert names < names_again
    assert len(set(map(str.casefold, names_again))) == 3


def test_what_is_given_twice_is_graded_once(rubric: Rubric, tmp_path: Path) -> None:
    """A folder and one of its submissions are no two submissions."""
    group = lay_out(tmp_path / "group", in_folders({"alice": FIVE, "bob": FIVE}))
    found = find_submissions([group, group / "alice", group / "../group/bob"], rubric)
    assert [source.name for source in found.submissions] == ["alice", "bob"]


NAME = st.text(
    st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1, max_size=60
).filter(lambda name: name not in (".", "..") and len(name.encode()) < 250)


@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    deadline=None,
    max_examples=examples(60),
)
@given(names=st.lists(NAME, min_size=1, max_size=6, unique=True))
def test_any_names_become_names_of_folders(
    names: list[str], rubric: Rubric, tmp_path: Path
) -> None:
    """Whatever folders are called, each submission has a name of its own that any file system takes."""
    shutil.rmtree(tmp_path / "group", ignore_errors=True)
    group = lay_out(tmp_path / "group", in_folders(dict.fromkeys(names, FIVE[:1])))
    found = find_submissions([group], rubric, shape=Shape.EACH)
    called = [source.name for source in found.submissions]
    assert len({name.casefold() for name in called}) == len(called)
    for name in called:
        assert name.isprintable()
        assert not set(name) & set('/\\:*?"<>| \t\n')
        assert name.strip("._-") == name or name[-7] == "-"
        assert 0 < len(name.encode()) <= 130
    assert called == [
        source.name for source in find_submissions([group], rubric, shape=Shape.EACH).submissions
    ]


def test_a_class_list_knows_more(rubric: Rubric, tmp_path: Path) -> None:
    """Ids and times come from the list, by name or by id; missing students are reported."""
    rows = [
        "Name;Student ID;submitted_at;group",
        "Alice;2026001;2026-03-02T23:41:00+01:00;1",
        "bob;;;1",
        ";69;2026-03-03T08:00:00Z;2",
        "Eve;2026004;;2",
    ]
    (tmp_path / "class.csv").write_text("\n".join(rows), encoding="utf-8-sig")
    group = lay_out(tmp_path / "group", in_folders({"alice": FIVE, "bob": FIVE}))
    export = lay_out(tmp_path / "export", ["cem_69_1_joint_publisher.py"])
    found = find_submissions([group, export], rubric, class_list=tmp_path / "class.csv")
    students = by_name(found)
    assert students["alice"].student_id == "2026001"
    assert students["alice"].submitted_at == datetime(2026, 3, 2, 22, 41, tzinfo=UTC)
    assert (students["bob"].student_id, students["bob"].submitted_at) == (None, None)
    assert students["cem_69"].submitted_at == datetime(2026, 3, 3, 8, tzinfo=UTC)
    assert found.missing == ("Eve",)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", 0),
        ("surname,time\n", 1),
        ("name,submitted_at\nann,2026-03-02\nbob,yesterday\n", 3),
        ("name,submitted_at\nann,9999-12-31T23:59:59-14:00\n", 2),
        ("name,student_id\nann,1\n,,\n\n  ,\nbob\n,\n,x\ny\n", None),
        ("name\tstudent_id\tsubmitted_at\nann, b; c\t1\t2026-03-02\n", None),
        ('name\n"ann\n', None),
        ("name,submitted_at\n,2026-03-02\n", 2),
    ],
)
def test_a_class_list_with_mistakes(
    text: str, line: int | None, rubric: Rubric, tmp_path: Path
) -> None:
    """The first line that is wrong is named; empty lines and missing columns are not wrong."""
    (tmp_path / "class.csv").write_text(text)
    if line is None:
        find_submissions([], rubric, class_list=tmp_path / "class.csv")
        return
    with pytest.raises(SubmissionError) as caught:
        find_submissions([], rubric, class_list=tmp_path / "class.csv")
    assert caught.value.location == f"{tmp_path / 'class.csv'}:{line}"
    assert "submitted_at" in caught.value.remedy


def test_a_class_list_that_is_none(rubric: Rubric, tmp_path: Path) -> None:
    """A missing class list, or one that is no text, ends with a description of the form."""
    (tmp_path / "class.csv").write_bytes(b"\xff\xfe\x00")
    for name in ("class.csv", "none.csv"):
        with pytest.raises(SubmissionError, match="cannot be read"):
            find_submissions([], rubric, class_list=tmp_path / name)


def test_pieces_are_what_a_scheduler_can_send(rubric: Rubric, tmp_path: Path) -> None:
    """A submission names files of this machine and nothing else."""
    (source,) = find_submissions([lay_out(tmp_path / "alice", FIVE)], rubric).submissions
    assert source.pieces == (Piece(tmp_path / "alice"),)
