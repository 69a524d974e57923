"""`overrides.yaml`: all its mistakes at once, each with its line; the submission of an entry."""

from __future__ import annotations

from datetime import timedelta
from decimal import Decimal
from pathlib import Path

import pytest

from grader.errors import RubricError
from grader.judging.rubrics import read_rubric
from grader.lab.overrides import Overrides, load_overrides, moment_of
from grader.lab.rubric import Rubric

WHY = "reason: it was so, who: J. Smith, when: 2026-11-21"


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


def load(folder: Path, text: str, rubric: Rubric) -> Overrides:
    """Load overrides from their text."""
    path = folder / "overrides.yaml"
    path.write_text(text, encoding="utf-8")
    return load_overrides(path, rubric)


def mistakes(folder: Path, text: str, rubric: Rubric) -> list[str]:
    """Give the mistakes in a text."""
    with pytest.raises(RubricError) as caught:
        load(folder, text, rubric)
    assert caught.value.exit_status == 4
    return caught.value.mistakes


def entry(text: str) -> str:
    """Give a file of one entry about alice."""
    return f"overrides:\n  - {{submission: alice, {text}}}\n"


# -- what is read ----------------------------------------------------------------------------------


def test_each_kind_of_entry(tmp_path: Path, rubric: Rubric) -> None:
    """Points set and added, excuses, a bonus and times are read as they stand there."""
    text = f"""
    overrides:
      - {{submission: alice, check: publisher.rate, set: 4.5, {WHY}}}
      - {{submission: alice, criterion: launch, add: -1.25, {WHY}}}
      - {{submission: alice, criterion: qos, excused: true, {WHY}}}
      - {{submission: alice, bonus: 3, {WHY}}}
      - {{submission: alice, extension: 1 day 12 h, {WHY}}}
      - {{submission: alice, due: 2026-11-22T23:59:00+01:00, {WHY}}}
      - {{submission: alice, submitted: 2026-11-22 23:59:00Z, {WHY}}}
    """
    found = load(tmp_path, text, rubric).of("alice")

    def given(key: str) -> list[object]:
        values = [getattr(entry, key) for entry in found]
        return [value for value in values if value is not None]

    assert given("set_") == [Decimal("4.5")]
    assert given("add") == [Decimal("-1.25")]
    assert [e.criterion for e in found if e.excused] == ["qos"]
    assert given("bonus") == [Decimal(3)]
    assert given("extension") == [timedelta(hours=36)]
    assert [*map(str, given("due"))] == ["2026-11-22 23:59:00+01:00"]
    assert [*map(str, given("submitted"))] == ["2026-11-22 23:59:00+00:00"]
    assert {(e.reason, e.who, e.when) for e in found} == {("it was so", "J. Smith", "2026-11-21")}


@pytest.mark.parametrize(
    ("when", "kept"),
    [
        ("2026-11-21", "2026-11-21"),
        ("'2026-11-21'", "2026-11-21"),
        ("2026-11-21T10:00:00+01:00", "2026-11-21T10:00+01:00"),
        ("'2026-11-21 10:00'", "2026-11-21T10:00"),
    ],
)
def test_when_may_have_a_time(tmp_path: Path, rubric: Rubric, when: str, kept: str) -> None:
    """A date is enough; a time is kept."""
    text = entry(f"bonus: 1, reason: r, who: w, when: {when}")
    assert [e.when for e in load(tmp_path, text, rubric).of("alice")] == [kept]


def test_whom_an_entry_is_about(tmp_path: Path, rubric: Rubric) -> None:
    """A name, several, a number as a name, or everyone."""
    text = f"""
    overrides:
      - {{submission: [alice, bob], bonus: 1, {WHY}}}
      - {{submission: "*", bonus: 2, {WHY}}}
      - {{submission: 4711, bonus: 3, {WHY}}}
    """
    found = load(tmp_path, text, rubric)
    bonuses = {}
    for name in ("alice", "bob", "eve", "4711"):
        bonuses[name] = [e.bonus for e in found.of(name)]
    assert bonuses == {"alice": [1, 2], "bob": [1, 2], "eve": [2], "4711": [2, 3]}


def test_a_number_is_a_name_as_it_is_written(tmp_path: Path, rubric: Rubric) -> None:
    """Octal, sexagesimal and parted numbers of YAML 1.1 are read as students' numbers."""
    for name in ("0012345", "012", "20260017", "2026_001", "12:30", "0x1F"):
        found = load(tmp_path, f"overrides:\n  - {{submission: {name}, bonus: 1, {WHY}}}\n", rubric)
        assert found.entries[0].submission == (name,)


def test_a_name_may_be_composed_in_either_way(tmp_path: Path, rubric: Rubric) -> None:
    """A name copied from a file manager of macOS equals the submission's name."""
    found = load(
        tmp_path, f"overrides:\n  - {{submission: Mu\u0308ller, bonus: 1, {WHY}}}\n", rubric
    )
    assert found.of("M\u00fcller")
    assert found.remarks(["M\u00fcller"], times_matter=True) == []


def test_words_that_yaml_reads_are_no_names(tmp_path: Path, rubric: Rubric) -> None:
    """A student called no has to be quoted, within a list too; the mistake says so."""
    for name in ("no", "[alice, no]", "1.10"):
        with pytest.raises(RubricError) as caught:
            load(tmp_path, f"overrides:\n  - {{submission: {name}, bonus: 1, {WHY}}}\n", rubric)
        assert "in quotes" in caught.value.mistakes[0]


@pytest.mark.parametrize("text", ["", "# nothing yet\n", "overrides: []\n", "\n  # a\n\n"])
def test_a_file_without_entries(tmp_path: Path, rubric: Rubric, text: str) -> None:
    """Nothing has been decided yet."""
    assert load(tmp_path, text, rubric).entries == ()


def test_the_hash_is_that_of_the_file(tmp_path: Path, rubric: Rubric) -> None:
    """Different texts have different hashes, which the trail records."""
    one, other = (load(tmp_path, entry(f"bonus: {n}, {WHY}"), rubric).sha256 for n in (1, 2))
    assert len(one) == 64
    assert one != other


# -- mistakes --------------------------------------------------------------------------------------


def test_all_mistakes_are_reported_at_once_with_their_lines(tmp_path: Path, rubric: Rubric) -> None:
    """Nothing has to be fixed twice."""
    text = f"""overrides:
  - submission: alice
    check: publisher.rat
    set: 6
    reason: it was so
    who: J. Smith
    when: 2026-11-21
  - submission: bob
    who: [J. Smith]
    criterion: service
    set: 22
    reason: ""
    when: soon
  - {{submission: eve, bonus: 1, colour: red, {WHY}}}
extra: 1
"""
    lines = [line.split(": ")[0] for line in mistakes(tmp_path, text, rubric)]
    assert lines == [f"overrides.yaml:{number}" for number in (3, 9, 11, 12, 13, 14, 15)]


MISTAKES = {
    "an unknown check": ("check: publisher.rat, set: 6", "did you mean 'publisher.rate'?"),
    "an unknown criterion": ("criterion: sevrice, set: 6", "did you mean 'service'?"),
    "more than a check has": (
        "check: publisher.rate, set: 7.5",
        "; bonus gives more",
    ),
    "part of another check": (
        "check: subscriber.reports, set: 1",
        "it is part of 'subscriber.rms' now",
    ),
    "less than nothing": ("criterion: service, set: -1", "from 0 to 20 points"),
    "two changes": ("check: publisher.rate, set: 1, add: 1", "exactly one of set, add, excused"),
    "no change": ("check: publisher.rate", "exactly one of set, add, excused"),
    "a part of both kinds": (
        "check: publisher.rate, criterion: service, set: 1",
        "either a check or a criterion",
    ),
    "points of nothing": ("add: 1", "either a check or a criterion"),
    "a bonus of a check": ("check: publisher.rate, bonus: 1", "bonus is of the whole submission"),
    "an extension of a check": (
        "check: publisher.rate, extension: 1 day",
        "extension is of the whole submission",
    ),
    "no bonus at all": ("bonus: 0", "it should be greater than 0"),
    "points in words": ("bonus: many", "a number of points is expected"),
    "points that are true": ("bonus: true", "a number of points is expected"),
    "points that are no number": ("bonus: .nan", "a number of points is expected"),
    "endless points": ("bonus: .inf", "a number of points is expected"),
    "too many decimals": ("bonus: 1.234", "points have at most two decimals"),
    "an empty value": ("bonus: ", "bonus: a value is missing"),
    "half an excuse": ("check: publisher.rate, excused: false", "excused"),
    "a time without a unit": ("extension: 2", "a time with its unit is expected"),
    "a time without an offset": ("due: 2026-11-20 23:59:00", "needs its offset from UTC"),
    "a day that is none": ("due: 2026-13-20T23:59:00Z", "a date with its time is expected"),
    "an unknown key": ("bonus: 1, colour: red", "unknown key"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_in_an_entry(tmp_path: Path, rubric: Rubric, name: str) -> None:
    """An entry that cannot be right is refused, and the message names the expected form."""
    text, message = MISTAKES[name]
    found = mistakes(tmp_path, entry(f"{text}, {WHY}"), rubric)
    assert [line for line in found if line.startswith("overrides.yaml:2: ") and message in line]


@pytest.mark.parametrize("missing", ["reason", "who", "when"])
def test_nothing_is_decided_without_reason_name_and_date(
    tmp_path: Path, rubric: Rubric, missing: str
) -> None:
    """An entry without reason, name or date is a mistake, and so is one with a blank."""
    parts = {"reason": "r", "who": "w", "when": "2026-11-21"}
    absent = ", ".join(f"{key}: {value}" for key, value in parts.items() if key != missing)
    assert [
        missing in line for line in mistakes(tmp_path, entry(f"bonus: 1, {absent}"), rubric)
    ] == [True]
    blank = ", ".join(
        f"{key}: {value if key != missing else repr(' ')}" for key, value in parts.items()
    )
    assert [
        missing in line for line in mistakes(tmp_path, entry(f"bonus: 1, {blank}"), rubric)
    ] == [True]


@pytest.mark.parametrize("name", ["[]", "[[a]]", "true", "{a: b}", "1.5"])
def test_an_entry_needs_a_submission(tmp_path: Path, rubric: Rubric, name: str) -> None:
    """The submission of an entry is a name or a list of names."""
    text = f"overrides:\n  - {{submission: {name}, bonus: 1, {WHY}}}\n"
    assert ["the name of a submission" in line for line in mistakes(tmp_path, text, rubric)] == [
        True
    ]


def test_the_same_entry_twice_is_a_mistake(tmp_path: Path, rubric: Rubric) -> None:
    """An entry pasted twice is a mistake, because it would count twice."""
    line = f"  - {{submission: alice, check: publisher.rate, add: 1, {WHY}}}\n"
    assert mistakes(tmp_path, f"overrides:\n{line}{line}", rubric) == [
        "overrides.yaml:3: overrides.1: the same entry stands here twice"
    ]


@pytest.mark.parametrize(
    "text", ["overrides: {a: 1}", "- a", "overrides: [1", "overrides: [hello]", "'"]
)
def test_what_is_no_list_of_entries(tmp_path: Path, rubric: Rubric, text: str) -> None:
    """A file of another shape is refused with a line."""
    for line in mistakes(tmp_path, text, rubric):
        assert line.startswith("overrides.yaml:")


def test_a_file_that_is_not_there(tmp_path: Path, rubric: Rubric) -> None:
    """A wrong path is no empty file."""
    with pytest.raises(RubricError, match="cannot be read") as caught:
        load_overrides(tmp_path / "none.yaml", rubric)
    assert caught.value.mistakes == ["No such file or directory"]


# -- what does nothing -----------------------------------------------------------------------------


def test_entries_of_unknown_names_are_named(tmp_path: Path, rubric: Rubric) -> None:
    """A misspelt name of a submission is told, since its entry does nothing."""
    text = f"""overrides:
  - {{submission: [alice, bbo], bonus: 1, {WHY}}}
  - {{submission: "*", bonus: 1, {WHY}}}
"""
    found = load(tmp_path, text, rubric).remarks(["alice", "bob"], times_matter=True)
    assert found == ["overrides.yaml:2: there is no submission 'bbo'; did you mean 'bob'?"]


def test_entries_about_times_are_named(tmp_path: Path, rubric: Rubric) -> None:
    """Where lateness costs nothing, an extension does nothing."""
    text = f"""overrides:
  - {{submission: alice, bonus: 1, {WHY}}}
  - {{submission: alice, extension: 1 day, {WHY}}}
"""
    remarks = load(tmp_path, text, rubric).remarks(["alice"], times_matter=False)
    assert [line.split(": ")[0] for line in remarks] == ["overrides.yaml:3"]


@pytest.mark.parametrize(
    ("text", "known"),
    [
        ("2026-11-20T23:59:00+01:00", True),
        ("2026-11-20T22:59:00Z", True),
        ("2026-11-20T23:59:00", False),
        ("yesterday", False),
        ("", False),
        (None, False),
    ],
)
def test_a_recorded_time_of_submission(text: str | None, known: bool) -> None:
    """A time counts only where it is one moment everywhere."""
    assert (moment_of(text) is not None) == known
