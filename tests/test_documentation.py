"""Truth of the documentation: commands, options, files, and examples of a rubric and of Python."""

from __future__ import annotations

import ast
import contextlib
import io
import re
import shlex
from functools import cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from rich.console import Console

from grader.commands import COMMANDS
from grader.errors import RubricError
from grader.judging.rubrics import read_rubric
from tests.documentation import PAGES, ROOT, blocks, command_lines, inline

#: Options of other programs, which pages name in sentences.
OTHERS = {
    "--privileged",
    "--security-opt",
    "--user",
    "--memory",
    "--cpus",
    "--nthreads",
    "--exclusive",
    "--strict",
}
OTHERS |= {"--scheduler-file", "--plain", "--network"}
#: Folders of the repository; a path into one of them, set as code, must exist.
FOLDERS = (
    "confine",
    "grader",
    "launch_plan",
    "ros_bag",
    "reference",
    "fixtures",
    "submissions",
    "ci",
    "docs",
    "bench",
    "tests",
    "tools",
    "labs",
)
_OPTION = re.compile(r"(?<![\w-])--?[a-zA-Z][a-z-]*")

named = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())


@cache
def said_by(*command: str) -> str:
    """Give the help of a command of `grade`, such as `lab new`."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        import_module(f"grader.commands.{command[0]}").run([*command[1:], "--help"], Console())
    return said.getvalue()


def options(*command: str) -> set[str]:
    """Give the options that a command names in its help."""
    return set(_OPTION.findall(said_by(*command)))


def wrong_options(line: str) -> set[str]:
    """Return the options of a command line with `grade` that do not exist."""
    words = shlex.split(line, comments=True)[1:]
    if words[:1] and words[0] in COMMANDS:
        command = words[:1]
    else:
        command = ["grade"]
    # A command may have commands of its own, which argparse lists.
    if words[1:] and re.search(
        rf"^    {re.escape(words[1])} {{2,}}", said_by(*command), re.MULTILINE
    ):
        command = words[:2]
    return {
        word.partition("=")[0] for word in words if word.startswith("-") and word != "-"
    } - options(*command)


def test_an_option_that_there_is_not_is_found() -> None:
    """The tests below can fail."""
    assert wrong_options("grade submissions/ --resume --rubric x.yaml  # --no-option") == set()
    assert wrong_options("grade regrade results/ --resume -j 2") == {"--resume"}


@named
def test_commands_have_the_options_that_pages_give_them(page: Path) -> None:
    """Each line of a shell block, and each command in a sentence."""
    said = [line for line in [*command_lines(page), *inline(page)] if re.match(r"grade( |$)", line)]
    assert {line: wrong for line in said if (wrong := wrong_options(line))} == {}


@named
def test_options_in_sentences_are_those_of_some_command(page: Path) -> None:
    """`--rubric` by itself is an option of a command, or known to be another program's."""
    known = OTHERS.union(*(options(command) for command in ("grade", *COMMANDS)))
    said = set()
    for text in inline(page):
        if text.startswith("-"):
            for match in re.findall(r"^--?[a-z][a-z-]*", text):
                said.add(match)
    assert said - known == set()


@named
def test_targets_of_make_are_there(page: Path) -> None:
    """`make alice`, in a block or a sentence."""
    targets = set(
        re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    )
    said = set()
    for text in [*command_lines(page), *inline(page)]:
        for m in re.findall(r"^make ([a-z-]+)", text):
            said.add(m)
    assert said - targets == set()


@named
def test_files_that_pages_name_are_there(page: Path) -> None:
    """`grader/checks/` is a folder of the repository."""
    pattern = rf"(?:{'|'.join(FOLDERS)})(?:/[\w.-]+)+/?"
    said = {text.rstrip("/") for text in inline(page) if re.fullmatch(pattern, text)}
    missing = set()
    for text in said:
        if not (ROOT / text).exists() and not (ROOT / "docs" / text).exists():
            missing.add(text)
    assert missing == set()


def test_every_room_of_the_house_is_in_the_layout() -> None:
    """Each package and module of `grader/`, and each package of its live half."""
    grader, said = ROOT / "grader", set(inline(ROOT / "docs/developers.md"))
    rooms = set()
    for path in grader.iterdir():
        if path.suffix == ".py" or path.is_dir():
            rooms.add(path.name + "/" * path.is_dir())
    rooms |= {f"live/{path.parent.name}/" for path in grader.glob("live/*/__init__.py")}
    rooms |= {f"{path.parent.name}/" for path in ROOT.glob("*/__init__.py")} - {"grader/"}
    assert {name for name in rooms if not name.startswith("__")} - said == set()


#: A Python file, and the names that a page gives from it: `grader/result.py`: `Finding`, `Score`.
_NAMED = re.compile(r"`([\w./-]+\.py)`: (`[\w.]+`(?:, `[\w.]+`)*)")


def defined_in(file: Path) -> set[str]:
    """Return the classes and functions of a file, methods as `Class.method`."""
    names = set()
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if not isinstance(node, (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            continue
        names.add(node.name)
        for part in node.body:
            if isinstance(part, (ast.FunctionDef, ast.AsyncFunctionDef)):
                names.add(f"{node.name}.{part.name}")
    return names


def test_names_of_the_code_that_developers_are_shown_are_there() -> None:
    """The tree of processes and the way of a message name functions where they stand."""
    text = (ROOT / "docs/developers.md").read_text(encoding="utf-8")
    found = _NAMED.findall(text)
    missing = []
    for file, names in found:
        there = defined_in(ROOT / file)
        missing += [f"{file}: {name}" for name in re.findall(r"[\w.]+", names) if name not in there]
    assert len(found) > 15
    assert missing == []


@named
def test_examples_in_python_and_yaml_can_be_read(page: Path) -> None:
    """The examples are valid as printed."""
    for block in blocks(page, "python"):
        ast.parse(block.text)
    for block in blocks(page, "yaml"):
        list(yaml.safe_load_all(block.text))


def test_the_parts_of_the_example_are_a_rubric(tmp_path: Path) -> None:
    """The blocks of "Writing a rubric", put together, have no mistake."""
    parts: dict[str, object] = {}
    for block in blocks(ROOT / "docs/rubric.md", "yaml"):
        parts |= {
            key: value
            for key, value in (yaml.safe_load(block.text) or {}).items()
            if key != "reference"
        }
    (tmp_path / "rubric.yaml").write_text(yaml.safe_dump(parts), encoding="utf-8")
    rubric = read_rubric(tmp_path / "rubric.yaml")
    assert [check.id for check in rubric.checks()] == ["talker.publishes", "talker.rate"]


def test_the_examples_of_a_labs_code_can_be_named_by_a_rubric(tmp_path: Path) -> None:
    """Parameters of the check and settings of the reference node are found as the page has them."""
    page = ROOT / "docs/lab-code.md"
    for block in blocks(page):
        if block.title:
            (tmp_path / block.title).parent.mkdir(exist_ok=True)
            (tmp_path / block.title).write_text(block.text, encoding="utf-8")
    named, parts = (yaml.safe_load(block.text) for block in blocks(page, "yaml"))
    parts["sessions"]["listening"]["steps"] += [
        {"wait_for": {"publisher": "/scan", "type": "sensor_msgs/msg/LaserScan"}},
        {"observe": {"duration_s": 1}, "label": "window"},
    ]
    criterion = {
        "id": "c",
        "title": "C",
        "points": 1,
        "checks": [{"id": "d", "points": 1, "session": "listening", **named}],
    }
    rest = {
        "lab": {"id": "x", "title": "X", "points": 1},
        "artifacts": {"listener": {"file": "listener.py"}},
    }
    rubric = tmp_path / "rubric.yaml"
    rubric.write_text(yaml.safe_dump({**rest, **parts, "criteria": [criterion]}), encoding="utf-8")
    assert next(iter(read_rubric(rubric).checks())).parameters.model_dump()["least_m"] == 0.3
    rubric.write_text(
        rubric.read_text(encoding="utf-8").replace("rate_hz", "rate_hzz"), encoding="utf-8"
    )
    with pytest.raises(RubricError) as found:
        read_rubric(rubric)
    assert "did you mean 'rate_hz'" in found.value.mistakes[0]


def test_the_example_of_an_oracle_gives_what_it_says() -> None:
    """The example is called as a check calls it."""
    (block,) = (
        block
        for block in blocks(ROOT / "docs/lab-code.md", "python")
        if "def doubled" in block.text
    )
    names: dict[str, object] = {}
    exec(block.text, names)
    stream = SimpleNamespace(source_ns=np.array([10, 20]), values=np.array([[1.5], [2.0]]))
    found = names["doubled"]({"input": stream}, {}, 0)  # type: ignore[operator]
    assert [(span["start_ns"], span["value"]) for span in found] == [(10, 3.0), (20, 4.0)]


@pytest.mark.parametrize(
    "picture", ["report.png", "report-dark.png", "report-de.png", "report-es.png"]
)
def test_the_pictured_report_has_the_points_of_the_first_run(picture: str) -> None:
    """The points that `tools/site-pictures` notes in a picture stand in start.md too."""
    shown = re.search(r"^ +alice: .* ([\d.]+) / 100$", (ROOT / "docs/start.md").read_text(), re.M)
    assert shown is not None
    content = (ROOT / "docs/images" / picture).read_bytes()
    pictured = re.search(rb"tEXtPoints\0([\d.]+)", content)
    assert pictured is not None
    assert pictured[1].decode() == shown[1]
