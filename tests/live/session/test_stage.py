"""Staging: the same files as after `colcon build`, and wrappers that run the right file."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import time
from copy import deepcopy
from pathlib import Path
from typing import NamedTuple

import pytest

from grader.evidence.crash.diagnosis import explain
from grader.judging.rubrics import read_rubric
from grader.live.session.built import note_installed
from grader.live.session.program import StudentProgram
from grader.live.session.stage import stage
from grader.recording.session import OutputLine
from grader.recording.submission import ArtifactFact, BuildFact, FileFact, SubmissionRecord
from grader.submission.packages.colcon import find_packages
from grader.submission.texts import decode_text
from tests.ros_packages import write

pytestmark = pytest.mark.slow

SAYS = 'import sys\nprint("{0}", __name__, sys.argv[1:])\n'
MANIFEST = (
    "<package><name>arm_lab</name><export><build_type>ament_python</build_type></export></package>"
)
SETUP = "from setuptools import setup\nsetup(entry_points={'console_scripts': ['talk = arm_lab.talk:main']})\n"


class Workspace(NamedTuple):
    """A staged submission: its folder, and each artifact's program in there."""

    folder: Path
    programs: dict[str, StudentProgram]


def staged(folder: Path, files: dict[str, str | bytes], **artifacts: str) -> Workspace:
    """Stage a submission of these files, with artifacts by the rubric's names."""
    record = SubmissionRecord("ann")
    for path, content in files.items():
        target = folder / "submission" / path
        target.parent.mkdir(parents=True, exist_ok=True)
        data = content.encode() if isinstance(content, str) else content
        target.write_bytes(data)
        record.files.append(FileFact(path, len(data), ""))
        record.texts[path] = decode_text(data)
    record.artifacts = [ArtifactFact(name, path, path, "name") for name, path in artifacts.items()]
    record.packages = find_packages(record.texts, list(files))
    wrappers = stage(
        folder / "submission", record, read_rubric(None), folder / "ws", sys.executable
    )
    return Workspace(folder / "ws", wrappers)


def run(path: Path, *arguments: str) -> str:
    """Run a wrapper; returns its output."""
    ended = subprocess.run([path, *arguments], capture_output=True, text=True, check=False, cwd="/")
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.strip()


def wrapper(workspace: Workspace, artifact: str = "publisher") -> Path:
    """Give the wrapper of an artifact."""
    return workspace.folder / workspace.programs[artifact].path


@pytest.mark.parametrize(
    "content",
    [
        SAYS.format("hello"),
        SAYS.format("hello").replace("\n", "\r\n"),
        "\ufeff" + SAYS.format("hello"),
        "#!/usr/bin/env python\r\n" + SAYS.format("hello"),
    ],
)
def test_a_bare_file_runs_as_the_main_program(tmp_path: Path, content: str) -> None:
    """Executable bits, line ends and byte order marks make no difference."""
    workspace = staged(tmp_path, {"joint_publisher.py": content}, publisher="joint_publisher.py")
    assert run(wrapper(workspace), "a", "b") == "hello __main__ ['a', 'b']"


@pytest.mark.parametrize("text", [SAYS.format("hello"), "def main():\n    print('hello')\n"])
def test_a_file_in_another_encoding_is_refused_as_python_refuses_it(
    tmp_path: Path, text: str
) -> None:
    """Bad bytes in a comment end the program, unless a coding line declares their encoding."""
    latin = f"\n# Größe\n{text}".encode("latin-1")
    name = "joint_publisher.py"
    bad = staged(tmp_path / "bad", {name: latin}, publisher=name)
    ended = subprocess.run([wrapper(bad)], capture_output=True, text=True, check=False)
    said = [OutputLine(0, "stderr", line) for line in ended.stderr.splitlines()]
    diagnosis = explain(said, [name])
    assert diagnosis is not None
    assert (diagnosis.kind, diagnosis.file, diagnosis.line) == ("encoding", name, 2)
    good = staged(tmp_path / "good", {name: b"# coding: latin-1" + latin}, publisher=name)
    assert run(wrapper(good)).startswith("hello")


def test_bare_files_are_executables_of_the_labs_package(tmp_path: Path) -> None:
    """Bare files run under the rubric's name with or without `.py`, in an indexed package."""
    workspace = staged(
        tmp_path, {"joint_publisher.py": SAYS.format("hello")}, publisher="joint_publisher.py"
    )
    package = read_rubric(None).lab.package
    folder = workspace.folder / "install/lib" / package
    assert {"joint_publisher", "joint_publisher.py"} <= {path.name for path in folder.iterdir()}
    assert run(folder / "joint_publisher") == "hello __main__ []"
    assert (
        workspace.folder / "install/share/ament_index/resource_index/packages" / package
    ).is_file()


def test_bare_files_stand_for_a_package_that_their_launch_file_names(tmp_path: Path) -> None:
    """A package name of the student's own in the launch file is installed as well."""
    files: dict[str, str | bytes] = {
        "joint_publisher.py": SAYS.format("hello"),
        "robot_launch.py": "Node(package='my_arm', executable='joint_publisher')",
    }
    workspace = staged(tmp_path, files, publisher="joint_publisher.py", launch="robot_launch.py")
    assert run(workspace.folder / "install/lib/my_arm/joint_publisher") == "hello __main__ []"


def test_a_file_that_only_defines_main_is_called(tmp_path: Path) -> None:
    """Files written for an entry point run their main."""
    content = "def main():\n    print('called')\n"
    workspace = staged(tmp_path, {"joint_publisher.py": content}, publisher="joint_publisher.py")
    assert run(wrapper(workspace)) == "called"


def test_modules_beside_a_file_can_be_imported(tmp_path: Path) -> None:
    """A helper module in the same folder is found, in a bare folder and in a package."""
    bare: dict[str, str | bytes] = {
        "src/joint_publisher.py": "import arm\nprint(arm.X)\n",
        "src/arm.py": "X = 7\n",
    }
    assert run(wrapper(staged(tmp_path / "a", bare, publisher="src/joint_publisher.py"))) == "7"
    inside: dict[str, str | bytes] = {
        "p/lab/joint_publisher.py": "from . import arm\nfrom lab.arm import X\nprint(arm.X, X)\n",
        "p/lab/arm.py": "X = 7\n",
        "p/lab/__init__.py": "",
    }
    assert (
        run(wrapper(staged(tmp_path / "b", inside, publisher="p/lab/joint_publisher.py"))) == "7 7"
    )


def test_a_package_is_installed_with_its_entry_points(tmp_path: Path) -> None:
    """A console script runs its function, under the package's own name."""
    files: dict[str, str | bytes] = {
        "package.xml": MANIFEST,
        "setup.py": SETUP,
        "arm_lab/__init__.py": "",
        "arm_lab/talk.py": "import sys\n\ndef main():\n    print('main', sys.argv[1:])\n",
        "resource/arm_lab": "",
        "launch/robot.launch.py": "",
    }
    workspace = staged(tmp_path, files, publisher="arm_lab/talk.py")
    assert run(workspace.folder / "install/lib/arm_lab/talk", "x") == "main ['x']"
    assert (
        workspace.folder / "install/share/ament_index/resource_index/packages/arm_lab"
    ).is_file()
    assert not (workspace.folder / "install/lib" / read_rubric(None).lab.package).exists()


@pytest.mark.parametrize(
    "inner", ["tools/__init__.py", "python/tools/__init__.py", "../other/tools/__init__.py"]
)
def test_a_program_finds_the_modules_of_all_packages(tmp_path: Path, inner: str) -> None:
    """A script installed by CMake imports modules of all packages, as in a sourced workspace."""
    files: dict[str, str | bytes] = {
        "ws/arm/package.xml": MANIFEST.replace("ament_python", "ament_cmake"),
        "ws/arm/CMakeLists.txt": "install(PROGRAMS scripts/talk.py DESTINATION lib/${PROJECT_NAME})",
        "ws/arm/scripts/talk.py": "from tools import what\n" + SAYS.format("hello"),
        "ws/other/package.xml": MANIFEST.replace("arm_lab", "other"),
        os.path.normpath(f"ws/arm/{inner}"): "what = 1",
    }
    workspace = staged(tmp_path, files, publisher="ws/arm/scripts/talk.py")
    assert run(wrapper(workspace)) == "hello __main__ []"
    assert run(workspace.folder / "install/lib/arm_lab/talk.py") == "hello __main__ []"


def test_a_workspace_can_be_moved(tmp_path: Path) -> None:
    """Wrappers find their files by relative paths."""
    workspace = staged(
        tmp_path, {"joint_publisher.py": SAYS.format("hello")}, publisher="joint_publisher.py"
    )
    relative = workspace.programs["publisher"].path
    workspace.folder.rename(tmp_path / "moved")
    assert run(tmp_path / "moved" / relative) == "hello __main__ []"
    assert str(tmp_path) not in (tmp_path / "moved" / relative).read_text()


def test_only_listed_files_are_copied_and_no_links(tmp_path: Path) -> None:
    """Only files of the submission's record are staged, and no link in place of a listed file."""
    files: dict[str, str | bytes] = {"joint_publisher.py": SAYS.format("hello"), "data.txt": "x"}
    record_folder = tmp_path / "a"
    workspace = staged(record_folder, files, publisher="joint_publisher.py")
    assert sorted(p.name for p in (workspace.folder / "src").iterdir()) == [
        "data.txt",
        "joint_publisher.py",
    ]
    source = tmp_path / "b"
    source.mkdir()
    (source / "joint_publisher.py").symlink_to("/etc/hostname")
    record = SubmissionRecord("ann", files=[FileFact("joint_publisher.py", 1, "")])
    stage(source, record, read_rubric(None), tmp_path / "ws", sys.executable)
    assert not (tmp_path / "ws/src/joint_publisher.py").exists()


def test_names_of_executables_cannot_leave_the_prefix(tmp_path: Path) -> None:
    """A console script named after a path outside is not installed."""
    setup = SETUP.replace("'talk = arm_lab.talk:main'", "'../../../../x = arm_lab.talk:main'")
    files: dict[str, str | bytes] = {
        "package.xml": MANIFEST,
        "setup.py": setup,
        "arm_lab/talk.py": "",
    }
    workspace = staged(tmp_path, files)
    for _, _, names in os.walk(tmp_path):
        assert "x" not in names
    assert workspace.programs == {}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("run", "def run():\n    print('run')\n"),
        (
            "run",
            "class Node:\n    @classmethod\n    def go(cls):\n        print('run')\n\nrun = Node.go\n",
        ),
        ("run", "from arm_lab.base import run\n"),
        (
            "run",
            "def made():\n    def spin():\n        print('run')\n    return spin\n\nrun = made()\n",
        ),
        ("Node.go", "class Node:\n    @staticmethod\n    def go():\n        print('run')\n"),
    ],
)
def test_an_entry_point_may_name_any_function(name: str, text: str, tmp_path: Path) -> None:
    """A file that runs nothing by itself is run as the package's entry point would, however its function is made."""
    files: dict[str, str | bytes] = {
        "package.xml": MANIFEST,
        "setup.py": SETUP.replace("arm_lab.talk:main", f"arm_lab.nodes.talk:{name}"),
        "arm_lab/__init__.py": "",
        "arm_lab/base.py": "def run():\n    print('run')\n",
        "arm_lab/nodes/__init__.py": "",
        "arm_lab/nodes/talk.py": text,
    }
    workspace = staged(tmp_path, files, publisher="arm_lab/nodes/talk.py")
    assert run(wrapper(workspace)) == "run"
    assert run(workspace.folder / "install/lib/arm_lab/talk") == "run"


def test_nodes_in_one_file_are_distinguished_by_their_entry_points(tmp_path: Path) -> None:
    """Each artifact runs the function that the entry point of its name names."""
    points = "['joint_publisher = arm_lab.nodes:send', 'joint_subscriber = arm_lab.nodes:hear']"
    text = "".join(f"def {name}():\n    print('{name}')\n" for name in ("hear", "main", "send"))
    files: dict[str, str | bytes] = {
        "package.xml": MANIFEST,
        "setup.py": SETUP.replace("['talk = arm_lab.talk:main']", points),
        "arm_lab/__init__.py": "",
        "arm_lab/nodes.py": text,
    }
    workspace = staged(tmp_path, files, publisher="arm_lab/nodes.py", subscriber="arm_lab/nodes.py")
    assert [run(wrapper(workspace, name)) for name in ("publisher", "subscriber")] == [
        "send",
        "hear",
    ]


def test_bare_files_are_also_known_by_their_own_names(tmp_path: Path) -> None:
    """A launch file may call a file of another name by that name, with or without its ending."""
    files: dict[str, str | bytes] = {"Joint_Publisher.py": SAYS.format("hello")}
    workspace = staged(tmp_path, files, publisher="Joint_Publisher.py")
    package = workspace.folder / "install/lib" / read_rubric(None).lab.package
    assert {p.name for p in package.iterdir()} == {
        "joint_publisher",
        "Joint_Publisher",
        "Joint_Publisher.py",
    }


def test_another_program_among_bare_files_is_an_executable_too(tmp_path: Path) -> None:
    """A launch file may start an unlisted bare file, such as one process that holds all nodes."""
    files: dict[str, str | bytes] = {
        "joint_publisher.py": SAYS.format("one"),
        "arm.py": SAYS.format("all"),
    }
    workspace = staged(tmp_path, files, publisher="joint_publisher.py")
    folder = workspace.folder / "install/lib" / read_rubric(None).lab.package
    said = [run(folder / name).split()[0] for name in ("joint_publisher", "arm", "arm.py")]
    assert said == ["one", "all", "all"]


def test_data_are_installed_while_there_is_room_and_texts_before_them(tmp_path: Path) -> None:
    """Recordings for each of several packages would fill a session's disk; programs and texts are not among them."""
    launch = "".join(f"Node(package='p{n}')\n" for n in range(12))
    files: dict[str, str | bytes] = {"a.bin": bytes(8_000_000), "robot_launch.py": launch}
    record = SubmissionRecord("ann", texts={"robot_launch.py": launch})
    for path, content in files.items():
        (tmp_path / path).write_bytes(content.encode() if isinstance(content, str) else content)
        record.files.append(FileFact(path, len(content), ""))
    stage(tmp_path, record, read_rubric(None), tmp_path / "ws", sys.executable)
    share = tmp_path / "ws/install/share"
    assert len(list(share.glob("p[0-9]*/launch/robot_launch.py"))) == 12
    assert len(list(share.glob("*/a.bin"))) == 8


@pytest.mark.parametrize("target", ["share", "share/ament_index/resource_index/packages/other"])
def test_what_a_package_installs_keeps_no_other_from_its_place(tmp_path: Path, target: str) -> None:
    """A data file where another package is to be listed, or to have its folder, is left out."""
    files: dict[str, str | bytes] = {
        "arm/package.xml": MANIFEST,
        "arm/setup.py": SETUP.replace("setup(", f"setup(data_files=[('{target}', ['other'])], "),
        "arm/other": "",
        "other/package.xml": MANIFEST.replace("arm_lab", "other"),
    }
    install = staged(tmp_path, files).folder / "install"
    assert (install / "share/ament_index/resource_index/packages/other").is_file()
    assert (install / "share/other").is_dir()


SCRIPT = """#!/nowhere/bin/python
# EASY-INSTALL-ENTRY-SCRIPT: 'arm-lab==0.0.0','console_scripts','talk'
from arm_lab.talk import main

main()
"""
TALK = "def main():\n    print('from the package', __file__.rpartition('/')[2])\n"


def built_record(sources: dict[str, str], installed: list[str]) -> SubmissionRecord:
    """Return the record of a built package."""
    record = SubmissionRecord("ann", texts=dict(sources))
    for path, text in sources.items():
        digest = hashlib.sha256(text.encode()).hexdigest()
        record.files.append(FileFact(path, len(text), digest))
    record.packages = find_packages(record.texts, list(sources))
    record.builds = [BuildFact("arm_lab", "", "built", installed=installed)]
    return record


def built_workspace(folder: Path, installed: dict[str, str]) -> Workspace:
    """Stage a package with the files that a build installed."""
    sources = {"package.xml": MANIFEST, "setup.py": SETUP, "arm_lab/talk.py": TALK}
    write(folder / "submission", sources)
    write(folder / "prefixes/arm_lab", installed)
    record = built_record(sources, list(installed))
    record.artifacts = [ArtifactFact("publisher", "talk.py", "arm_lab/talk.py", "name")]
    wrappers = stage(
        folder / "submission",
        record,
        read_rubric(None),
        folder / "ws",
        sys.executable,
        folder / "prefixes",
    )
    return Workspace(folder / "ws", wrappers)


MODULES = "lib/python3.12/site-packages"
INSTALLED = {
    "lib/arm_lab/talk": SCRIPT,
    f"{MODULES}/arm_lab/talk.py": TALK,
    f"{MODULES}/arm_lab-0.0.0.egg-info/entry_points.txt": "[console_scripts]\ntalk = arm_lab.talk:main\n",
}


def test_a_built_package_runs_from_its_installed_files(tmp_path: Path) -> None:
    """An artifact runs by the installed script, with the students' interpreter; its module is a link to the source."""
    workspace = built_workspace(tmp_path, INSTALLED)
    assert workspace.programs["publisher"] == StudentProgram("install/lib/arm_lab/talk")
    script = wrapper(workspace).read_text(encoding="utf-8")
    assert script == SCRIPT.replace("/nowhere/bin/python", sys.executable)
    module = workspace.folder / "install" / MODULES / "arm_lab/talk.py"
    assert module.resolve() == (workspace.folder / "src/arm_lab/talk.py").resolve()


def test_a_module_that_the_build_left_out_runs_from_its_source(tmp_path: Path) -> None:
    """A program without its installed module is replaced by a wrapper for an artifact, not for `ros2 run`."""
    installed = {path: text for path, text in INSTALLED.items() if not path.endswith("talk.py")}
    workspace = built_workspace(tmp_path, installed)
    assert workspace.programs["publisher"].path == "install/lib/.artifacts/publisher"
    assert run(wrapper(workspace)).startswith("from the package")
    script = workspace.folder / "install/lib/arm_lab/talk"
    assert "EASY-INSTALL" in script.read_text(encoding="utf-8")


def test_an_entry_point_to_a_missing_function_leaves_the_file_to_run(tmp_path: Path) -> None:
    """A slip in setup.py breaks `ros2 run`, and not the node, which runs by its file."""
    entry_points = f"{MODULES}/arm_lab-0.0.0.egg-info/entry_points.txt"
    installed = {**INSTALLED, entry_points: "[console_scripts]\ntalk = arm_lab.talk:mian\n"}
    workspace = built_workspace(tmp_path, installed)
    assert workspace.programs["publisher"].path == "install/lib/.artifacts/publisher"
    assert run(wrapper(workspace)).startswith("from the package")
    assert (workspace.folder / "install/lib/arm_lab/talk").is_file()


def test_an_executable_in_another_folder_gets_a_wrapper(tmp_path: Path) -> None:
    """Without setup.cfg, setuptools installs into bin, and a repaired copy lets the rest be judged."""
    installed = dict(INSTALLED)
    installed["bin/talk"] = installed.pop("lib/arm_lab/talk")
    workspace = built_workspace(tmp_path, installed)
    assert run(workspace.folder / "install/lib/arm_lab/talk").startswith("from the package")


def test_a_build_tells_what_a_package_installs(tmp_path: Path) -> None:
    """Executables, data files and omitted launch files come from the installed files."""
    launch = "def generate_launch_description():\n    return None\n"
    sources = {"package.xml": MANIFEST, "setup.py": "setup(entry_points=made())\n"}
    sources |= {"arm_lab/talk.py": TALK, "launch/a.launch.py": launch, "launch/b.launch.py": ""}
    sources["arm_lab/launch/a.launch.py"] = "# ros2 launch finds the installed one\n"
    installed = {**INSTALLED, "share/arm_lab/launch/a.launch.py": launch}
    record = built_record(sources, list(installed))
    assert "does not follow" in record.packages[0].problems[0]
    write(tmp_path / "arm_lab", installed)
    for _ in range(2):  # a grading of undecided sessions notes it again
        note_installed(record, tmp_path)
    (package,) = record.packages
    assert package.executables == {"talk": "arm_lab.talk:main"}
    assert package.shared == {"share/arm_lab/launch/a.launch.py": "launch/a.launch.py"}
    assert package.problems == [
        "it does not install launch/b.launch.py, so `ros2 launch arm_lab b.launch.py` does not find it; "
        "add ('share/arm_lab/launch', ['launch/b.launch.py']) to data_files in setup.py"
    ]


def test_without_a_build_nothing_counts_as_left_out(tmp_path: Path) -> None:
    """Without installed files, nothing is noted."""
    sources = {"package.xml": MANIFEST, "setup.py": SETUP, "launch/b.launch.py": ""}
    record = built_record(sources, [])
    before = deepcopy(record.packages)
    note_installed(record, tmp_path)
    assert record.packages == before
    assert record.packages[0].shared is None


SCRIPT_OF_CMAKE = "project(arm_lab)\nadd_executable(talk src/text.h src/main.c)\n"


@pytest.mark.parametrize("installed", [{}, {"lib/arm_lab/talk": "\x7fELF"}])
def test_a_compiled_program_runs_if_it_was_built(tmp_path: Path, installed: dict[str, str]) -> None:
    """A source in C has the program that its package compiles from it, and no wrapper of Python."""
    sources = {
        "package.xml": MANIFEST.replace("ament_python", "ament_cmake"),
        "CMakeLists.txt": SCRIPT_OF_CMAKE,
        "src/main.c": "int main(void) { return 0; }",
    }
    write(tmp_path / "submission", sources)
    write(tmp_path / "prefixes/arm_lab", {"share/arm_lab/package.xml": "", **installed})
    record = SubmissionRecord("ann", texts=sources)
    record.artifacts = [ArtifactFact("publisher", "talk.c", "src/main.c", "near miss")]
    record.packages = find_packages(record.texts, list(sources))
    record.builds = [BuildFact("arm_lab", "", "built", installed=list(installed))]
    python = sys.executable
    prefixes = tmp_path / "prefixes"
    programs = stage(
        tmp_path / "submission", record, read_rubric(None), tmp_path / "ws", python, prefixes
    )
    assert bool(programs) == bool(installed)
    if installed:
        program = programs["publisher"]
        assert program == StudentProgram("install/lib/arm_lab/talk", is_compiled=True)
        assert program.command("/ws", Path(python))[-1] == "/ws/install/lib/arm_lab/talk"


def test_a_hostile_list_of_scripts_is_read_soon(tmp_path: Path) -> None:
    """A build can write any text in place of its list of scripts and its programs."""
    sources = {"package.xml": MANIFEST, "setup.py": SETUP}
    installed = {
        f"{MODULES}/a-info/entry_points.txt": "[console_scripts]\nx" + " " * 20_000_000,
        f"{MODULES}/b-info/entry_points.txt/folder": "",
        f"{MODULES}/c-info/entry_points.txt": f"[console_scripts]\n{'n' * 300} = a:b\n.. = a:b\nm = ../a\n",
        "lib/arm_lab/talk": "#!" * 10_000_000,
    }
    record = built_record(sources, list(installed))
    write(tmp_path / "arm_lab", installed)
    started_s = time.process_time()
    note_installed(record, tmp_path)
    assert record.packages[0].executables == {}
    stage(tmp_path, record, read_rubric(None), tmp_path / "ws", sys.executable, tmp_path)
    assert time.process_time() - started_s < 10
