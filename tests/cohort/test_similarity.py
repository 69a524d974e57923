"""Similarity of submissions: disguised copies are found; code that was given to all does not count."""

from __future__ import annotations

import random
import re
import time
from collections import Counter
from itertools import chain, combinations
from pathlib import Path

import pytest

from grader.classroom.expectations import fixtures_in
from grader.cohort.similarity import (
    LEAST_NODES,
    LENGTH,
    MOST_NODES,
    MOST_SPANS,
    Program,
    Similarity,
    copies_of,
    nodes_of,
    pairs_of,
    program_of,
)
from grader.recording.submission import FileFact, SubmissionRecord
from tests.cohort.disguises import DISGUISES, Files

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("correct_asyncio", "correct_single_module", "correct_typed_dataclass")
#: As many equal lines, that neither the lab gave out nor a tenth of the class has, were written once.
WRITTEN_ONCE = 15


def program(name: str, texts: Files, files: list[FileFact] | None = None) -> Program:
    """Return the compared parts of texts."""
    return program_of(SubmissionRecord(name, sha256=name, texts=texts, files=files or []))


def files_of(folder: Path) -> Files:
    """Give the Python files of a folder."""
    found = {}
    for path in sorted(folder.rglob("*.py")):
        found[str(path.relative_to(folder))] = path.read_text(errors="replace")
    return found


@pytest.fixture(scope="module")
def common() -> list[Files]:
    """Return the code that was given to all."""
    return [files_of(ROOT / "reference" / name) for name in ("handout", "solution")]


@pytest.fixture(scope="module")
def class_of_fixtures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Files]:
    """Give the Python files of all fixtures but for the extensions, which are copies of a few files by intent."""
    target = tmp_path_factory.mktemp("class")
    fixtures = []
    for fixture in fixtures_in(ROOT / "fixtures"):
        if not fixture.name.startswith(("extension", "fresh")):
            fixtures.append(fixture)
    return {fixture.name: files_of(fixture.lay_out(target)) for fixture in fixtures}


@pytest.fixture(scope="module")
def programs(class_of_fixtures: dict[str, Files]) -> dict[str, Program]:
    """Give the fixtures as they are compared."""
    return {name: program(name, texts) for name, texts in class_of_fixtures.items()}


@pytest.fixture(scope="module")
def given(common: list[Files]) -> list[Program]:
    """Return the code that was given to all, as it is compared."""
    return [program("given", texts) for texts in common]


# -- precision and recall ----------------------------------------------------------------------


@pytest.mark.parametrize("disguise", DISGUISES)
@pytest.mark.parametrize("name", COPIED)
def test_disguised_copy_is_found(
    name: str,
    disguise: str,
    class_of_fixtures: dict[str, Files],
    programs: dict[str, Program],
    given: list[Program],
) -> None:
    """After each of 22 disguises, two thirds of a copy's own or copied code are still recognized."""
    copied = program("copy", DISGUISES[disguise](class_of_fixtures[name]))
    found = []
    for pair in pairs_of([programs[name], copied], given):
        if set(pair.names) == {name, "copy"}:
            found.append(pair)
    assert len(found) == 1
    assert max(found[0].shares) >= 0.66


def test_copies_in_a_class_are_those_that_are_shown(
    class_of_fixtures: dict[str, Files],
    common: list[Files],
    programs: dict[str, Program],
    given: list[Program],
) -> None:
    """The pairs with shared lines of their own are shown, among 125 fixtures of one origin."""
    pairs = {frozenset(pair.names) for pair in pairs_of(list(programs.values()), given)}
    lines = {name: _lines(texts) for name, texts in class_of_fixtures.items()}
    held = Counter(chain.from_iterable(lines.values()))
    usual = {line for line, number in held.items() if number > len(lines) / 10}
    own = {name: found - usual - set().union(*map(_lines, common)) for name, found in lines.items()}
    alike = set()
    for a, b in combinations(own, 2):
        if len(own[a] & own[b]) >= WRITTEN_ONCE:
            alike.add(frozenset((a, b)))
    assert len(pairs & alike) >= 0.9 * len(alike)
    assert len(pairs & alike) >= 0.9 * len(pairs)


def _lines(texts: Files) -> set[str]:
    """Give the lines that are long enough not to be alike by chance."""
    found = set()
    for text in texts.values():
        for line in text.splitlines():
            if len(line.strip()) > 12:
                found.add(line.strip())
    return found


# -- counted code ------------------------------------------------------------------------------


def _own(number: int) -> str:
    """Give a function of an own structure, of some 70 nodes."""
    steps = []
    for k in range(8):
        steps.append(
            f"    if x > {k}:\n        y = [x, {k}] if y else g(x, {k})"
            if number >> k & 1
            else f"    for k in h({k}):\n        y += k * x"
        )
    return "def f(x, y):\n" + "\n".join(steps) + "\n    return y\n"


def test_without_common_ground_the_given_code_counts() -> None:
    """Two submissions of the given code have nothing of their own in common, and everything if no code counts as given."""
    text = _own(0b10110010) + _own(0b01011101)
    both = [program("ada", {"a.py": text}), program("bob", {"b.py": text.replace("y", "other")})]
    assert len(pairs_of(both)) == 1
    assert pairs_of(both)[0].shares == (1.0, 1.0)
    assert pairs_of(both, [program("given", {"x.py": text})]) == []


def test_code_that_many_have_does_not_count() -> None:
    """Code of eleven in a small class is usual in such a lab; ten can have it from one another."""
    text = _own(0b10110010) + _own(0b01011101)
    assert pairs_of([program(f"student {n}", {"a.py": text}) for n in range(11)]) == []
    assert len(pairs_of([program(f"student {n}", {"a.py": text}) for n in range(10)])) == 45


def test_lines_stand_side_by_side() -> None:
    """The spans name the lines on both sides, with their texts, wherever they stand."""
    shared, mine = _own(0b10110010) + _own(0b01011101), "import os\n\nPATHS = os.environ\n\n\n"
    (pair,) = pairs_of(
        [program("ada", {"a.py": shared}), program("bob", {"deep/b.py": mine + shared})]
    )
    ((one, other),) = pair.spans
    length = shared.count("\n")
    assert (one.path, one.first, one.last) == ("a.py", 1, length)
    assert (other.path, other.first, other.last) == ("deep/b.py", 6, length + 5)
    assert one.texts == other.texts == tuple(shared.splitlines())
    assert pair.lines[0] == pair.lines[1] <= length


def test_little_in_common_is_not_shown() -> None:
    """A function of 70 nodes that two have is no pair."""
    text = _own(0b10110010)
    assert LENGTH < len(nodes_of(text)) < LEAST_NODES
    assert pairs_of([program("ada", {"a.py": text}), program("bob", {"b.py": text})]) == []


def test_same_files_are_found_but_those_given() -> None:
    """Equal files of any kind are listed, except small ones and files of the common ground."""
    picture, small, sheet = (
        FileFact("a.png", 900, "p"),
        FileFact("__init__.py", 0, "i"),
        FileFact("s.pdf", 999, "s"),
    )
    class_ = [
        program("ada", {}, [picture, small, sheet]),
        program("bob", {}, [FileFact("b.png", 900, "p"), small, sheet]),
    ]
    (copies,) = copies_of(class_, [program("given", {}, [sheet])])
    assert copies.found == (("ada", "a.png"), ("bob", "b.png"))


def test_clusters_are_what_pairs_connect() -> None:
    """Three that two pairs connect are one group; two are none."""
    one = _own(0b10110010) + _own(0b01011101)
    other = (
        one.replace("if x >", "while x <")
        .replace("for k in", "with")
        .replace("y += k * x", "del y[k]")
    )
    text = {0: one, 1: other.replace(" if y else ", " or ")}
    both = {"a.py": text[0], "b.py": text[1]}
    class_ = [
        program("ada", {"a.py": text[0]}),
        program("bob", both),
        program("cleo", {"c.py": text[1]}),
    ]
    found = Similarity({}, {}, (), tuple(pairs_of([*class_, program("dan", {"x.py": "pass"})])), ())
    assert {pair.names for pair in found.pairs} == {("ada", "bob"), ("bob", "cleo")}
    assert found.clusters == (("ada", "bob", "cleo"),)


# -- any submission ----------------------------------------------------------------------------

HOSTILE = {
    "deep": "(" * 50_000,
    "nested": "\n".join(" " * n + "if x:" for n in range(1_000)),
    "one line": "x = [" + "1, " * 100_000 + "]",
    "same": "f(x)\n" * 50_000,
    "no Python": "\x00\x01\ud800 ñ " * 10_000,
    "empty": "",
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_any_text_is_compared(text: str) -> None:
    """Unusual text costs a bounded time, and never an error."""
    one, other = program("ada", {"a.py": text}), program("bob", {"a.py": text, "b.py": "x = 1"})
    assert len(one.kinds) <= MOST_NODES
    for pair in pairs_of([one, other]):
        assert pair.nodes <= MOST_NODES


def _fragments(between: str, number: int = 6000) -> str:
    """Give a long file of short runs that are the same in two of them, with other code and many lines between."""
    chosen = random.Random(1)
    runs = (
        "\n".join(chosen.choices(("x = 1", "del x", "f(x)", "assert x"), k=7))
        for _ in range(number)
    )
    return "".join(f"{run}\n{between}\n\n\n\n\n" for run in runs)


def test_thousands_of_places_cost_no_more_than_those_that_are_shown() -> None:
    """Ten students with such common files would use up the time of the whole class."""
    pair = []
    for n, between in (("ada", "while x: y"), ("bob", "for x in y: z")):
        pair.append(program(n, {"a.py": _fragments(between)}))
    began_s = time.process_time()
    (found,) = pairs_of(pair)
    assert len(found.spans) == MOST_SPANS
    assert time.process_time() - began_s < 10.0


def test_too_much_is_cut_from_the_largest_file() -> None:
    """Handwritten files are compared even if a file beside them is too large."""
    own = _own(0b10110010) + _own(0b01011101)
    padded = program("ada", {"own.py": own, "large.py": "f(x)\n" * MOST_NODES})
    assert padded.cut
    assert len(pairs_of([padded, program("bob", {"b.py": own})])) == 1


def test_a_disguised_copy_in_c_is_found() -> None:
    """Other names, numbers and comments hide nothing; a program of another author shares nothing."""
    folder = ROOT / "tests/compiled_lab/submissions"
    text = (folder / "correct/c_talker/src/talker.c").read_text(encoding="utf-8")
    other = (folder / "needs_rclcpp/c_talker/src/talker.cpp").read_text(encoding="utf-8")
    disguised = re.sub(r"//.*", "", text)
    for name, renamed in {"count": "number_of_all", "stop": "ends", "20": "31"}.items():
        disguised = disguised.replace(name, renamed)
    disguised = f"/* My own work. */\n{disguised}".replace("  ", "\t")
    programs = [
        program("ann", {"src/talker.c": text}),
        program("ben", {"src/main.cpp": disguised}),
        program("cem", {"src/talker.cpp": other}),
    ]
    (pair,) = pairs_of(programs)
    assert pair.names == ("ann", "ben")
    assert min(pair.shares) > 0.9


def test_kinds_of_two_languages_differ() -> None:
    """The same number of a kind in another grammar is another kind."""
    python = {kind for kind, _ in nodes_of("def f(a):\n    return a + 1\n")}
    c = {kind for kind, _ in nodes_of("int f(int a) { return a + 1; }", language="cpp")}
    assert python
    assert c
    assert python.isdisjoint(c)
