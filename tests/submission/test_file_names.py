"""Names by people, tools and attackers: kept and refused parts."""

from __future__ import annotations

import unicodedata

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from grader.submission.file_names import (
    UnfitError,
    clean_parts,
    collision_key,
    differ,
    displayed,
    is_compiled,
    is_litter,
    slashed,
    tool_folder,
    without_archive_suffix,
)


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("joint_publisher.py", ("joint_publisher.py",)),
        ("./src//pkg/./node.py", ("src", "pkg", "node.py")),
        ("src\\pkg\\node.py", ("src", "pkg", "node.py")),
        ("Übung 9/Größe.py", ("Übung 9", "Größe.py")),
        (unicodedata.normalize("NFD", "Größe.py"), ("Größe.py",)),
        ("实验九/节点.py", ("实验九", "节点.py")),
        ("لابراتوار/گره\u200cها.py", ("لابراتوار", "گره\u200cها.py")),
        (".github/workflows/ci.yml", (".github", "workflows", "ci.yml")),
        ("lab 9 /node.py. .", ("lab 9", "node.py")),
        ("node\u202eyp.exe", ("nodeyp.exe",)),
        ("no\u200bde.py\r", ("node.py",)),
        ("\x1b[2Jnode.py", ("[2Jnode.py",)),
        ("caf\udce9.py", ("café.py",)),
        ("na\udcc3\udcafve.py", ("naïve.py",)),
        ("\udc81\udc8d.py", ("\ufffd\ufffd.py",)),
        ("\ud800.py", ("?.py",)),
        ("...hidden", ("...hidden",)),
    ],
)
def test_a_name_is_kept_as_its_student_meant_it(name: str, parts: tuple[str, ...]) -> None:
    """Letters of any script stay; invisible characters and forbidden ones of other systems go."""
    assert clean_parts(name) == parts


@pytest.mark.parametrize(
    "name",
    [
        *("../x.py", "a/../../x.py", "a/..", "..", "..\\..\\x.py"),
        *("/etc/passwd", "\\\\host\\share\\x.py", "C:\\x.py", "c:x.py", "\u200bC:/x.py"),
        *("", ".", "/", "\u202e", ". .", "a/\x00/b", ".\u200b./x.py"),
        *("x" * 201, "é" * 101, "/".join(["abcdefghi"] * 60), "y" * 100_000),
    ],
)
def test_a_name_that_leads_elsewhere_or_nowhere_is_refused(name: str) -> None:
    """A name that leads outside, is too long, or shows nothing is not extracted."""
    with pytest.raises(UnfitError):
        clean_parts(name)


NAMES = st.text(
    st.characters(exclude_categories=[]) | st.sampled_from("/\\.: \u202e\u200b\udce9\ud800\x00\r")
)


@given(NAMES)
@example("a\u0344/\u212b. /\uf900")
def test_any_name_is_fit_or_refused(name: str) -> None:
    """Whatever the name, its parts are fit for a path and for the screen, and cleaning them again changes nothing."""
    try:
        parts = clean_parts(name)
    except UnfitError:
        return
    assert parts
    for part in parts:
        assert part not in ("", ".", "..")
        assert part == part.rstrip(". ")
        assert not set(part) & set("/\\")
        assert 0 < len(part.encode("utf-8")) <= 200
        hidden = set()
        for c in part:
            if unicodedata.category(c) in {"Cc", "Cf", "Cs", "Cn", "Zl", "Zp"}:
                hidden.add(c)
        assert hidden <= set("\u200c\u200d")
    assert clean_parts("/".join(parts)) == parts


@given(NAMES)
def test_any_name_can_be_displayed(name: str) -> None:
    """The displayed name is one short line, in characters of every encoding."""
    shown = displayed(name)
    assert shown.isprintable()
    assert len(shown) <= 160 * 10
    shown.encode("utf-8")


def test_names_that_other_systems_cannot_keep_apart_have_one_key() -> None:
    """Case and the form of letters make no difference, another letter does."""
    keys = {collision_key((name,)) for name in ("Straße.py", "STRASSE.PY", "strasse.py")}
    assert len(keys) == 1
    assert collision_key(("a", "b.py")) != collision_key(("a", "c.py"))


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("src/x.py", False),
        ("./src\\x.py", False),
        ("src/x.py ", True),
        ("x\u202e.py", True),
        ("caf\udce9.py", True),
    ],
)
def test_a_changed_name_is_noticed(name: str, changed: bool) -> None:
    """Another separator of folders is no change; a missing character is one."""
    assert differ(name, clean_parts(name)) is changed


@pytest.mark.parametrize(
    ("path", "folder"),
    [
        ("build/p/x.py", "build"),
        ("ws/install/lib/p/x.py", "ws/install"),
        ("env/lib/python3/site-packages/numpy/x.py", "env/lib/python3/site-packages"),
        ("src/log.py", None),
        ("src/build", None),
    ],
)
def test_folders_of_tools_are_reported(path: str, folder: str | None) -> None:
    """The outermost folder that a tool has made is named; a file of such a name is a file."""
    assert tool_folder(tuple(path.split("/"))) == folder


def test_litter_and_compiled_code_are_reported_by_name() -> None:
    """Litter of file managers and products of compilers are recognised, and nothing else."""
    assert all(map(is_litter, (".DS_Store", "Thumbs.db", "._joint_publisher.py", "desktop.ini")))
    assert not any(map(is_litter, ("joint_publisher.py", ".gitignore", "icon.png")))
    assert all(map(is_compiled, ("x.pyc", "libx.so", "libx.so.1.2", "X.DLL", "a.exe")))
    assert not any(map(is_compiled, ("x.py", "photo.png", "mesh.obj", "report.pdf", "also.md")))


def test_an_archive_is_called_as_what_is_in_it() -> None:
    """Suffixes of archives go, other dots stay."""
    named = {
        "alice.zip": "alice",
        "bob.tar.gz": "bob",
        "lab.v2.TGZ": "lab.v2",
        "a.b": "a.b",
        ".zip": ".zip",
    }
    assert {name: without_archive_suffix(name) for name in named} == named


def test_members_are_found_by_one_way_of_writing() -> None:
    """Backslashes and a leading dot make no other name."""
    assert {slashed(name) for name in ("a/b.py", "./a/b.py", ".//./a\\b.py")} == {"a/b.py"}
