"""Interfaces built for real, in real sandboxes; and definitions that mean harm."""

from __future__ import annotations

import fcntl
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from confine.interpreters import OWN_INTERPRETER
from confine.isolation import Isolation, Level
from grader.judging.rubrics import read_rubric
from grader.live.interfaces.build import Built, lacking_toolchain, provide
from grader.live.interfaces.needs import Needed, provide_interfaces
from grader.live.sandbox.environment import own_ros, with_prefixes
from grader.live.sandbox.probing import probe_isolation
from grader.recording.submission import SubmissionRecord
from ros_bag.interfaces import InterfacePackage
from tests.thorough import THOROUGH

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(bool(lacking_toolchain()), reason=f"not here: {lacking_toolchain()}"),
]

LABS = InterfacePackage(
    "lab_msgs",
    {
        "msg/Reading.msg": "# What a sensor read.\nuint8 OK=0\nstring UNIT = metre per second\n"
        "std_msgs/Header header\nfloat64 value 1.5\nfloat64[3] scale [1.0, 2.0, 3.0]\n",
        "srv/Add.srv": "int64 a\nint64 b\n---\nint64 sum\n",
        "action/Count.action": "int32 order\n---\nReading last\n---\nint32[] so_far\n",
    },
)
STUDENTS = InterfacePackage(
    "team_msgs", {"msg/Pair.msg": "lab_msgs/Reading[2] readings\nstring name 'both'\n"}
)

USE = """
import json
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.type_support import check_for_type_support
from lab_msgs.action import Count
from lab_msgs.msg import Reading
from lab_msgs.srv import Add
from team_msgs.msg import Pair
for kind in (Reading, Add, Add.Request, Count, Count.Impl.SendGoalService, Pair):
    check_for_type_support(kind)
pair = Pair()
pair.readings[1].header.frame_id = "x"
pair.readings[1].value = 7.25
back = deserialize_message(serialize_message(pair), Pair)
print(json.dumps([back.readings[0].value, list(back.readings[1].scale), back.readings[1].value, back.name,
    Reading.UNIT, Reading.OK, back == pair]))
"""


@pytest.fixture(scope="module")
def isolation() -> Isolation:
    """Give the isolation available on this machine."""
    return probe_isolation(OWN_INTERPRETER)


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Give a cache of this module's own."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder


def built(folder: Path, isolation: Isolation, *packages: InterfacePackage) -> tuple[Built, float]:
    """Provide packages in a folder of their own, and return how long that took in s."""
    folder.mkdir()
    began_s = time.monotonic()
    return provide(packages, folder, isolation), time.monotonic() - began_s


def run(program: str, found: Built) -> str:
    """Run a program with the built packages on its path, like a student's program."""
    environment = with_prefixes(own_ros(), [str(prefix) for prefix in found.prefixes.values()])
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        cwd="/",
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


class Said(Exception):
    """Something was said."""


def test_one_that_waits_for_others_says_so(tmp_path: Path, cache: Path) -> None:
    """One grading builds at a time; a class gives up one that says nothing, which is not to be for another's work."""

    def say() -> None:
        raise Said

    lock = cache / "grade/interfaces/.lock"
    lock.parent.mkdir(parents=True, exist_ok=True)
    with lock.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(Said):
            provide(
                [InterfacePackage("slow_msgs", {"msg/A.msg": "int8 x\n"})],
                tmp_path,
                Isolation(Level.NONE),
                None,
                say,
            )


def test_messages_services_and_actions_are_built_once(tmp_path: Path, isolation: Isolation) -> None:
    """With defaults, constants, and types of another package; the second time they come from the cache."""
    first, took_s = built(tmp_path / "1", isolation, STUDENTS, LABS)
    assert (first.missing, first.invalid) == ({}, {})
    assert json.loads(run(USE, first)) == [
        1.5,
        [1.0, 2.0, 3.0],
        7.25,
        "both",
        "metre per second",
        0,
        True,
    ]
    again, _ = built(tmp_path / "2", isolation, STUDENTS, LABS)
    assert 0 < first.took_s <= took_s
    assert again.took_s == 0
    assert json.loads(run(USE, again))[0] == 1.5


def test_two_gradings_build_the_same_once(tmp_path: Path, isolation: Isolation) -> None:
    """The second grading waits, and takes the packages that the first one has built."""
    package = InterfacePackage("both_msgs", {"msg/Both.msg": "int8 x\n"})
    with ThreadPoolExecutor(2) as threads:
        several = list(
            threads.map(lambda n: built(tmp_path / str(n), isolation, package)[0], range(2))
        )
    assert sorted(found.took_s > 0 for found in several) == [False, True]
    for found in several:
        assert run("from both_msgs.msg import Both; print(Both().x)", found) == "0\n"


def test_a_change_of_what_a_package_uses_builds_it_anew(
    tmp_path: Path, isolation: Isolation
) -> None:
    """A package is built anew after a change of one it uses, because its code contains both."""
    other = InterfacePackage("lab_msgs", {"msg/Reading.msg": "float64 value 4.5\n"})
    found, _ = built(tmp_path / "1", isolation, STUDENTS, other)
    assert run("from team_msgs.msg import Pair; print(Pair().readings[0].value)", found) == "4.5\n"


#: Each closes the C comment, the text or the line into which rosidl would put it.
_CODE = "__attribute__((constructor)) void hostile_code(void) { __builtin_trap(); }"
HARMLESS = [
    f"int8 x # */ {_CODE} /*\n",
    f"# */ {_CODE} /*\nint8 X=1\nint8 x\n",
    f"# */\n# {_CODE}\n# /*\n\nint8 x\n",
    'int8 x # \\\\"); }; }; module hostile_code { //\n',
    f"int8 x # \\n {_CODE} \\x2a/ {_CODE}\n",
]


def test_comments_do_not_reach_the_compiler(tmp_path: Path, isolation: Isolation) -> None:
    """Generated code contains no comments; the grader's own recorder would execute it."""
    harm = InterfacePackage(
        "harm_msgs", {f"msg/Harm{n}.msg": text for n, text in enumerate(HARMLESS)}
    )
    found, _ = built(tmp_path / "1", isolation, harm)
    assert run(
        "import harm_msgs.msg; print([getattr(harm_msgs.msg, f'Harm{n}')().x for n in range(5)])",
        found,
    ) == ("[0, 0, 0, 0, 0]\n")
    made = []
    for path in found.prefixes["harm_msgs"].rglob("*"):
        if path.is_file() and path.suffix != ".msg":
            made.append(path)
    assert made
    assert not [path for path in made if b"hostile_code" in path.read_bytes()]


NOT_BUILT = {
    "text that ends": ("string x \"a'; import os; '\"\n", "characters"),
    "text with a backslash": (r'string X="a\\"; hostile"' + "\n", "characters"),
    "text of two lines": (r"string x 'a\nimport os'" + "\n", "characters"),
    "texts in an array": ('string[] x ["a{b}", "c"]\n', "characters"),
    "more than there is room for": ("uint8[1000000000] x\n", "bytes"),
    "nested beyond all bounds": ("sensor_msgs/BatteryState[60000] x\n", "bytes"),
    "a package that is not here": ("octomap_msgs/Octomap x\n", "not installed"),
}
INVALID = {
    "no type": ("int x\n", "Harm.msg"),
    "a name that is none": ("int8 X-y\n", "Harm.msg"),
    "a type that the package has not": ("std_msgs/Nothing x\n", "has no message"),
    "a circle": ("Harm[2] x\n", "holds itself"),
}


@pytest.mark.parametrize(("text", "word"), NOT_BUILT.values(), ids=NOT_BUILT)
def test_what_the_grader_does_not_build_is_nobodys_fault(
    text: str, word: str, tmp_path: Path, isolation: Isolation
) -> None:
    """A package refused by the grader alone is missing, with the reason, and a person decides."""
    found, _ = built(
        tmp_path / "1", isolation, InterfacePackage("harm_msgs", {"msg/Harm.msg": text})
    )
    assert word in found.missing["harm_msgs"]
    assert not found.prefixes


@pytest.mark.parametrize(("text", "word"), INVALID.values(), ids=INVALID)
def test_what_colcon_would_refuse_is_a_mistake(
    text: str, word: str, tmp_path: Path, isolation: Isolation
) -> None:
    """A package that colcon would refuse is a mistake, and so is each package that uses it."""
    harm = InterfacePackage("harm_msgs", {"msg/Harm.msg": text})
    user = InterfacePackage("user_msgs", {"msg/Use.msg": "harm_msgs/Harm x\n"})
    found, _ = built(tmp_path / "1", isolation, harm, user)
    assert word in found.invalid["harm_msgs"]
    assert "harm_msgs" in found.invalid["user_msgs"]


def test_packages_that_cannot_be_built_use_up_the_time_for_all(
    tmp_path: Path, isolation: Isolation
) -> None:
    """A failed build counts as long as it takes; once the time for all packages is used up, none is begun."""
    text, _ = INVALID["a circle"]
    first, second = (InterfacePackage(f"h{n}_msgs", {"msg/Harm.msg": text}) for n in range(2))
    found, took_s = built(tmp_path / "1", isolation, first)
    assert 0 < found.took_s <= took_s
    found.took_s = 300.0
    assert "that all may take" in provide([second], tmp_path, isolation, found).missing["h1_msgs"]


@pytest.mark.parametrize("name", ["std_msgs", "numpy", "json", "grader"])
def test_what_is_installed_counts(name: str, tmp_path: Path, isolation: Isolation) -> None:
    """Nobody's package takes the place of one that the grader uses."""
    found, _ = built(
        tmp_path / "1", isolation, InterfacePackage(name, {"msg/String.msg": "int8 data\n"})
    )
    assert "counts" in found.missing[name]


def test_a_mistake_of_the_labs_is_not_a_students(tmp_path: Path, isolation: Isolation) -> None:
    """A mistake in the lab's package blames no student for it or for packages that depend on it.

    Both packages are missing, and the record names them.
    """
    wrong = InterfacePackage("lab_msgs", {"msg/Reading.msg": "float64 Value\n"})
    record = SubmissionRecord("s", absent_modules=[])
    needed = Needed([wrong], [], [STUDENTS])
    lacking = provide_interfaces(
        needed, read_rubric(None), record, tmp_path, isolation, OWN_INTERPRETER
    )
    assert (
        set(record.not_built or {}) == set(record.absent_modules or ()) == {"lab_msgs", "team_msgs"}
    )
    assert lacking == {}, "no session of this lab needs it"


def test_the_first_of_a_name_counts(tmp_path: Path, isolation: Isolation) -> None:
    """A lab's package stands before a student's of its name."""
    mine = InterfacePackage("lab_msgs", {"msg/Reading.msg": "int8 forged\n"})
    found, _ = built(tmp_path / "1", isolation, LABS, mine)
    assert (
        run("from lab_msgs.msg import Reading; print(hasattr(Reading(), 'forged'))", found)
        == "False\n"
    )


@pytest.mark.skipif(not THOROUGH, reason="it waits for the end of the time that reading may take")
def test_definitions_that_take_for_ever_are_given_up(tmp_path: Path, isolation: Isolation) -> None:
    """The pattern for names of constants that rosidl has tries every way to split a long one."""
    text = f"int8 {'A' * 60}_!=1\nint8 x\n"
    found, _ = built(
        tmp_path / "1", isolation, InterfacePackage("harm_msgs", {"msg/Harm.msg": text})
    )
    assert "harm_msgs" in {**found.missing, **found.invalid}


def test_without_a_compiler_it_is_missing(
    tmp_path: Path, isolation: Isolation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a compiler a new package is missing and blames nobody; cached packages are used."""
    built(tmp_path / "1", isolation, LABS)
    monkeypatch.setenv("PATH", str(tmp_path))
    found, _ = built(
        tmp_path / "2", isolation, LABS, InterfacePackage("new_msgs", {"msg/New.msg": "int8 x\n"})
    )
    assert list(found.prefixes) == ["lab_msgs"]
    assert "cc" in found.missing["new_msgs"]


def test_links_that_a_build_leaves_are_not_followed(tmp_path: Path) -> None:
    """A link among the outputs of a build is not followed: only plain files leave the sandbox."""
    from grader.live.interfaces import build

    made = tmp_path / "made"
    made.mkdir()
    (made / "x.py").symlink_to("/etc/passwd")
    with pytest.raises(Exception, match="not what is expected"):
        build._take(made, tmp_path / "target")
    assert not (tmp_path / "target").exists()


@pytest.mark.parametrize("is_idle_later", [False, True])
def test_what_takes_too_long_is_built_once_more(
    is_idle_later: bool, tmp_path: Path, isolation: Isolation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A busy machine may have time for it at the second try; if not, it is missing, and nobody's mistake."""
    from grader.live.interfaces import build

    package = InterfacePackage(f"late{is_idle_later:d}_msgs", {"msg/A.msg": "int8 x\n"})
    # In this time, no interpreter starts.
    monkeypatch.setattr(build, "_MOST_EACH_S", 0.001)
    tries = 0

    def say() -> None:
        nonlocal tries
        tries += 1
        if is_idle_later and tries == 2:
            monkeypatch.setattr(build, "_MOST_EACH_S", 100.0)

    found = provide([package], tmp_path, isolation, on_progress=say)
    assert tries == 2
    assert found.invalid == {}
    if is_idle_later:
        expected = {}
    else:
        expected = {package.name: "it took too long to build"}
    assert (found.missing, len(found.prefixes)) == (expected, int(is_idle_later))
