"""Files that `colcon build` would install into share folders, read by parsing alone."""

from __future__ import annotations

import pytest

from grader.submission.packages.cmake_script import installs_of
from grader.submission.packages.colcon import find_packages
from grader.submission.packages.setup_script import data_files_of_setup

PATHS = [
    "package.xml",
    "setup.py",
    "launch/a.launch.py",
    "launch/b.launch.xml",
    "launch/sub/c.launch.py",
    "config/p.yaml",
]
HEAD = "import os\nfrom glob import glob\nfrom setuptools import setup\nname = 'arm'\n"


@pytest.mark.parametrize(
    "data_files",
    [
        "[('share/arm/launch', ['launch/a.launch.py', 'launch/b.launch.xml'])]",
        "[('share/' + name + '/launch', glob('launch/*.*'))]",
        "[(os.path.join('share', name, 'launch'), glob(os.path.join('launch', '*launch.[pxy][yma]*')))]",
        "[(f'share/{name}/launch', sorted(glob('launch/*')))]",
        "[('share/arm/launch', glob('launch/*.py') + glob('launch/*.xml'))]",
    ],
)
def test_data_files_are_found_however_they_are_written(data_files: str) -> None:
    """Literals, constants, joins and patterns give the same files."""
    found = data_files_of_setup(f"{HEAD}setup(name=name, data_files={data_files})", PATHS)
    assert found == {
        "share/arm/launch/a.launch.py": "launch/a.launch.py",
        "share/arm/launch/b.launch.xml": "launch/b.launch.xml",
    }


@pytest.mark.parametrize(
    "text",
    [
        f"{HEAD}setup(data_files=list_files('launch'))",
        f"{HEAD}files = []\nfiles.append(('share/arm', ['package.xml']))\nsetup(data_files=files)",
        f"{HEAD}files = []\nfor f in ():\n    files += [f]\nsetup(data_files=files)",
        f"{HEAD}setup(**settings)",
        f"{HEAD}setup(data_files=[('share/%s' % name, ['package.xml'])])",
        f"{HEAD}setup(data_files=['x'])",
        f"{HEAD}setup(data_files=[('share/%1000000000d' % 1, [])])",
        f"{HEAD}a = 'x'\n"
        + "".join(f"a{i} = a{i - 1} + a{i - 1}\n" for i in range(1, 40))
        + "setup(data_files=a39)",
        f"{HEAD}a = a + a\nsetup(data_files=a)",
        "setup(",
        "",
    ],
)
def test_what_only_running_would_tell_is_not_known(text: str) -> None:
    """Nothing is made up, and nothing takes long."""
    assert data_files_of_setup(text, PATHS) is None


def test_a_setup_without_data_files_installs_none() -> None:
    """An absent keyword is an answer."""
    assert data_files_of_setup(f"{HEAD}setup(name=name)", PATHS) == {}


def installed_by_cmake(text: str) -> dict[str, str] | None:
    """Return the files installed by all commands, None if any command is not recognised."""
    found: dict[str, str] = {}
    for _, files in installs_of(text, "arm", PATHS):
        if files is None:
            return None
        found.update(files)
    return found


def test_cmake_installs_folders_and_files() -> None:
    """A folder keeps its name unless it ends with a slash."""
    text = "project(arm)\ninstall(DIRECTORY launch DESTINATION share/${PROJECT_NAME})\n"
    text += "install(DIRECTORY config/ DESTINATION share/arm/settings/) # install(FILES x DESTINATION y)\n"
    text += "install(FILES package.xml DESTINATION share/${PROJECT_NAME})"
    found = installed_by_cmake(text)
    assert found is not None
    assert found["share/arm/launch/sub/c.launch.py"] == "launch/sub/c.launch.py"
    assert found["share/arm/settings/p.yaml"] == "config/p.yaml"
    assert found["share/arm/package.xml"] == "package.xml"
    assert installed_by_cmake("install(FILES ${MORE} DESTINATION share/arm)") is None
    automatic = installed_by_cmake("ament_auto_package(INSTALL_TO_SHARE config)")
    assert automatic == {"share/arm/config/p.yaml": "config/p.yaml"}


def test_a_launch_file_that_is_not_installed_is_reported_with_the_line_to_add() -> None:
    """The package's problem names the file, the command that fails, and the entry."""
    manifest = (
        "<package><name>arm</name><export><build_type>ament_python</build_type></export></package>"
    )
    scripts = "entry_points={'console_scripts': ['a = arm.a:main']}"
    texts = {
        "package.xml": manifest,
        "setup.py": f"{HEAD}setup({scripts}, data_files=[('share/arm', ['no.txt'])])",
    }
    (package,) = find_packages(texts, [*texts, "launch/a.launch.py"])
    assert package.shared == {}
    assert package.problems == [
        "setup.py installs no.txt, which is not there",
        "setup.py does not install launch/a.launch.py, so `ros2 launch arm a.launch.py` does not find it; "
        "add ('share/arm/launch', ['launch/a.launch.py']) to data_files",
    ]


def test_data_files_that_are_not_followed_are_reported() -> None:
    """Then everything counts as installed, and the package's problem says so; a broken file has its own problem."""
    manifest = (
        "<package><name>arm</name><export><build_type>ament_python</build_type></export></package>"
    )
    scripts = "entry_points={'console_scripts': ['a = arm.a:main']}"
    texts = {"package.xml": manifest, "setup.py": f"{HEAD}setup({scripts}, data_files=made())"}
    (package,) = find_packages(texts, [*texts, "launch/a.launch.py"])
    assert package.shared is None
    assert len(package.problems) == 1
    assert "does not follow" in package.problems[0]
    (broken,) = find_packages({**texts, "setup.py": "setup("}, [*texts])
    assert len(broken.problems) == 1
    assert "cannot be read" in broken.problems[0]
