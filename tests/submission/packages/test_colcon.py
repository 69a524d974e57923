"""ROS packages, read by parsing alone."""

from __future__ import annotations

import pytest

from grader.recording.submission import PackageFact
from grader.submission.packages.colcon import find_packages

MANIFEST = (
    "<package><name>arm_lab</name><export><build_type>ament_python</build_type></export></package>"
)
SETUP = "from setuptools import setup\nname = 'arm_lab'\nsetup(name=name, entry_points={})\n"


def package(texts: dict[str, str], *more: str) -> PackageFact:
    """Find the only package."""
    (only,) = find_packages(texts, [*texts, *more])
    return only


def with_scripts(points: str) -> PackageFact:
    """Find a package with these entry points in its setup.py."""
    return package(
        {
            "package.xml": MANIFEST,
            "setup.py": SETUP.replace("entry_points={}", f"entry_points={points}"),
        }
    )


def test_without_a_manifest_there_is_no_package() -> None:
    """Bare files are no package."""
    assert find_packages({"talk.py": "", "setup.py": SETUP}, ["talk.py", "setup.py"]) == []


@pytest.mark.parametrize(
    "points",
    [
        "{'console_scripts': ['talk = arm_lab.talk:main']}",
        "{'console_scripts': ('talk=arm_lab.talk:main',)}",
        "{'console_scripts': [f'talk = {name}.talk:main']}",
        "{'console_scripts': ['talk = ' + name + '.talk:main']}",
        "{'console_scripts': ['talk = arm_lab.talk:main'] + []}",
        "'[console_scripts]\\ntalk = arm_lab.talk:main'",
    ],
)
def test_console_scripts_are_found_however_they_are_written(points: str) -> None:
    """Literals, f-strings, sums of constants and the text form are understood."""
    found = with_scripts(points)
    assert found.executables == {"talk": "arm_lab.talk:main"}
    assert found.problems == []


@pytest.mark.parametrize(
    "points",
    ["read_points()", "{'console_scripts': [read() for _ in range(3)]}", "POINTS", "dict(a=[])"],
)
def test_scripts_that_only_running_would_tell_are_all_that_could_be_meant(points: str) -> None:
    """Computed entry points in setup.py are noted, and not held against a student."""
    setup = SETUP.replace("entry_points={}", f"entry_points={points}").replace(
        "name = ", "POINTS = []\nname = "
    )
    setup = setup.replace("setup(name", "POINTS.append('x')\nsetup(name")
    found = package(
        {"package.xml": MANIFEST, "setup.py": setup},
        "arm_lab/__init__.py",
        "arm_lab/talk.py",
        "a_launch.py",
    )
    assert found.executables == {"talk.py": "arm_lab/talk.py", "talk": "arm_lab/talk.py"}
    assert "does not follow" in found.problems[0]


def test_scripts_of_setup_cfg_are_found() -> None:
    """The declarative form is read as well."""
    config = "[options.entry_points]\nconsole_scripts =\n    talk = arm_lab.talk:main\n    hear = arm_lab.hear:main\n"
    found = package({"a/package.xml": MANIFEST, "a/setup.cfg": config})
    assert found.executables == {"talk": "arm_lab.talk:main", "hear": "arm_lab.hear:main"}
    assert found.path == "a"


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ("{'console_scripts': ['talk']}", "not of the form"),
        ("{'console_scripts': ['talk = arm_lab/talk.py']}", "not of the form"),
        ("{'console_scripts': ['.. = arm_lab.talk:main']}", "not of the form"),
        ("{'console_scripts': []}", "no console_scripts"),
        ("{'gui_scripts': ['talk = arm_lab.talk:main']}", "no console_scripts"),
    ],
)
def test_scripts_that_name_nothing_are_problems(points: str, words: str) -> None:
    """Entry points that `ros2 run` would not find are reported."""
    assert words in with_scripts(points).problems[0]


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        ({"package.xml": MANIFEST}, "no setup.py"),
        ({"package.xml": MANIFEST, "setup.py": "setup("}, "cannot be read"),
        ({"package.xml": MANIFEST, "setup.py": "x = " + "(" * 500}, "cannot be read"),
        ({"package.xml": MANIFEST, "setup.py": "\0"}, "cannot be read"),
        ({"package.xml": "<package>"}, "not valid XML"),
        ({"package.xml": ""}, "not valid XML"),
        ({"package.xml": "<!DOCTYPE x [<!ENTITY a 'b'>]>" + MANIFEST}, "declares entities"),
        (
            {"package.xml": MANIFEST.replace("arm_lab", "../x"), "setup.py": SETUP},
            "no valid package name",
        ),
        (
            {"package.xml": MANIFEST.replace("arm_lab", ""), "setup.py": SETUP},
            "no valid package name",
        ),
        ({"package.xml": "<package><name>arm_lab</name></package>"}, "no CMakeLists.txt"),
    ],
)
def test_broken_packages_are_problems_and_no_crash(texts: dict[str, str], words: str) -> None:
    """Each kind of damage is told, and the package keeps a usable name."""
    found = package(texts)
    assert any(words in problem for problem in found.problems), found.problems
    assert found.name.replace("_", "").isalnum()


def test_programs_of_cmake_packages_are_found() -> None:
    """Installed programs are executables, and those that are not there are problems."""
    cmake = "project(arm_lab)\n# install(PROGRAMS old.py DESTINATION lib)\n"
    cmake += "install(PROGRAMS\n  scripts/talk.py\n  scripts/none.py\n  DESTINATION lib/${PROJECT_NAME}\n)\n"
    texts = {"p/package.xml": "<package><name>arm_lab</name></package>", "p/CMakeLists.txt": cmake}
    found = package(texts, "p/scripts/talk.py")
    assert found.build_type == "ament_cmake"
    assert found.executables == {"talk.py": "p/scripts/talk.py"}
    assert found.problems == ["CMakeLists.txt installs scripts/none.py, which is not there"]


@pytest.mark.parametrize(
    "cmake",
    [
        "install(PROGRAMS scripts/talk.py DESTINATION lib/${PROJECT_NAME})",
        'set(NODES\n  scripts/talk.py # the only one\n)\ninstall(PROGRAMS ${NODES} DESTINATION "lib/${PROJECT_NAME}")',
        "install(DIRECTORY scripts/ DESTINATION lib/${PROJECT_NAME} USE_SOURCE_PERMISSIONS)",
        "install(DIRECTORY scripts/ DESTINATION lib/arm_lab)\ninstall(FILES ${DATA} DESTINATION share/arm_lab)",
    ],
)
def test_programs_are_found_however_they_are_named(cmake: str) -> None:
    """Variables and folders name the same program."""
    texts = {"package.xml": "<package><name>arm_lab</name></package>", "CMakeLists.txt": cmake}
    found = package(texts, "scripts/talk.py")
    assert found.executables == {"talk.py": "scripts/talk.py"}
    assert found.problems == []


@pytest.mark.parametrize(
    "cmake",
    [
        "install(PROGRAMS ${FOUND} DESTINATION lib/arm_lab)",
        "file(GLOB NODES scripts/*.py)\ninstall(PROGRAMS ${NODES} DESTINATION lib/arm_lab)",
        "foreach(node IN ITEMS talk)\n  install(PROGRAMS scripts/${node}.py DESTINATION lib/arm_lab)\nendforeach()",
        "set(NODES a.py)\nlist(APPEND NODES scripts/talk.py)\ninstall(PROGRAMS ${NODES} DESTINATION lib/arm_lab)",
    ],
)
def test_programs_that_only_cmake_could_tell_are_all_that_could_be_meant(cmake: str) -> None:
    """Programs from loops, patterns or other files are noted, and not held against the student."""
    texts = {"package.xml": "<package><name>arm_lab</name></package>", "CMakeLists.txt": cmake}
    found = package(texts, "scripts/talk.py")
    assert found.executables["talk.py"] == "scripts/talk.py"
    assert "does not follow" in found.problems[0]


def test_a_program_may_be_installed_under_another_name() -> None:
    """RENAME gives an executable its name."""
    texts = {
        "package.xml": "<package><name>arm_lab</name></package>",
        "CMakeLists.txt": "install(PROGRAMS scripts/talk.py DESTINATION lib/arm_lab RENAME talker)",
    }
    assert package(texts, "scripts/talk.py").executables == {"talker": "scripts/talk.py"}


def test_several_packages_are_found_in_order() -> None:
    """Each manifest is a package."""
    texts = {f"{name}/package.xml": MANIFEST.replace("arm_lab", name) for name in ("b", "a")}
    assert [found.name for found in find_packages(texts, list(texts))] == ["a", "b"]


def test_setup_py_is_never_executed() -> None:
    """Code at module level has no effect on us."""
    setup = "raise SystemExit('executed')\n" + SETUP.replace(
        "{}", "{'console_scripts': ['a = b:c']}"
    )
    assert package({"package.xml": MANIFEST, "setup.py": setup}).executables == {"a": "b:c"}


def test_the_same_mistake_in_a_thousand_entry_points_is_not_reported_a_thousand_times() -> None:
    """A few are named, and how many more there are."""
    problems = with_scripts("{'console_scripts': " + repr(["talk"] * 1000) + "}").problems
    assert len(problems) < 30
    assert "more" in problems[-1]
