"""Tables for grade books, from a download to the import: every student gets the right points."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterable
from decimal import Decimal
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grader.cohort.entries import ClassEntry, with_roster
from grader.errors import UsageError
from grader.judging import rubrics
from grader.lab.rubric import Rubric
from grader.recording.submission import Identity, Person
from grader.report.exports import CLASS_EXPORTS
from grader.report.exports.returned import Returned, ReturnedClass, comment, plain_report
from grader.submission.roster import read_class_list
from tests.cohort.made_up import entry_of, result_of
from tests.report.exports import importers
from tests.report.exports.importers import Refused, User
from tests.report.exports.returned_class import LAB, given_back, taken_in

USERS = (
    User("11", "Müller, Änne", "0012", "am12", "aenne@uni.example"),
    User("12", "O'Brien, Bob", "0013", "bo,13", "bob@uni.example"),
    User("13", "Çelik, Cem", "00000000000000000014", "007", "cem+lab@uni.example"),
)
POINTS = {"11": Decimal("60.4"), "12": Decimal("60.8"), "13": Decimal("61.2")}
#: The university's own list of the students.
CLASS_LIST = """name;student_id;login;email
Müller, Änne;0012;am12;aenne@uni.example
"O'Brien, Bob";0013;bo,13;bob@uni.example
Çelik, Cem;00000000000000000014;007;cem+lab@uni.example
"""
DOWNLOADS = {
    "Moodle": [
        "Änne Müller_11_assignsubmission_file/lab.zip",
        "Bob O'Brien_12_assignsubmission_file/lab.zip",
        "Cem Çelik_13_assignsubmission_file/lab.zip",
    ],
    "Canvas": [
        "mulleranne_11_890_lab.zip",
        "obrienbob_LATE_12_891_lab.zip",
        "celikcem_13_892_joint_publisher.py",
    ],
    "Blackboard": [
        "Lab 9_am12_attempt_2026-03-01-12-00-00_joint_publisher.py",
        "Lab 9_bo,13_attempt_2026-03-01-12-00-00_joint_publisher.py",
        "Lab 9_007_attempt_2026-03-01-12-00-00_joint_publisher.py",
    ],
    "Brightspace": [
        "11-900 - Änne Müller - Mar 1, 2026 1230 PM/lab.zip",
        "12-900 - Bob O'Brien - Mar 1, 2026 1230 PM/lab.zip",
        "13-900 - Cem Çelik - Mar 1, 2026 1230 PM/lab.zip",
    ],
}
#: Owners of the results, which are made in the order of names.
ORDER = {
    "Canvas": ("13", "11", "12"),
    "Blackboard": ("13", "11", "12"),
    "Moodle": ("12", "13", "11"),
}
ORDER["Brightspace"] = ORDER["Moodle"]


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return rubrics.read_rubric(None)


def graded(
    system: str, tmp_path: Path, rubric: Rubric, class_list: str = "", column: str = ""
) -> ReturnedClass:
    """Give a class that was graded from a system's download; each has the points above."""
    sources = taken_in(tmp_path, rubric, DOWNLOADS[system], class_list)
    order = sorted(range(3), key=lambda n: ORDER[system][n])
    assert [s.identity.system for s in sources] == [system] * 3
    return given_back(tmp_path, [sources[n] for n in order], column)


def test_moodles_worksheet_needs_nothing_but_the_download(tmp_path: Path, rubric: Rubric) -> None:
    """The numbers in its names are the participants' in the worksheet; the comments are read with the grades."""
    returned = CLASS_EXPORTS["moodle"].render(graded("Moodle", tmp_path, rubric))
    read = importers.moodle_worksheet(returned.content, USERS, Decimal(100))
    assert {number: grade for number, (grade, _) in read.items()} == POINTS
    assert read["11"][1] == "60.4 of 100 points. Fix first: DOC.README (39.6 points)."
    assert (returned.count, returned.left_out) == (3, {})


FACTS = {"ID number": "student_id", "Username": "login", "Email address": "email"}


@pytest.mark.parametrize(
    ("system", "heading"),
    # Canvas writes no user names, and its gradebook, which is the list there, has no addresses.
    [(s, h) for s in DOWNLOADS for h in FACTS if (s, h) != ("Canvas", "Email address")],
)
def test_moodles_grade_book_finds_all_of_any_download(
    system: str, heading: str, tmp_path: Path, rubric: Rubric
) -> None:
    """Moodle's grade book finds all students by a class list's facts, such as zeros and commas.

    This holds for submissions from any system.
    """
    given = graded(system, tmp_path, rubric, CLASS_LIST if system != "Canvas" else canvas_export())
    returned = CLASS_EXPORTS["moodle"].render(given)
    assert importers.moodle_grade_book(returned.content, USERS, heading, FACTS[heading]) == POINTS


MOODLE_USERS = (
    User("1", "Admin", "", "admin"),
    User("11", "Ann", "0012", "am12"),
    User("12", "Bob", "", "bob"),
    User("13", "Cem", "0014", "cem"),
)
#: Identified by, empty key cells skipped (3.3.1) or not (4.2.3 and 4.4), last grade -> student's grades. The class
#: `gradeimport_csv_load_data` said so itself, run by PHP 8.2 with a made-up data base.
MOODLE_SAID = (
    ("ID number", True, "80", {"11": 70, "13": 80}),
    ("ID number", False, "80", None),
    ("Username", True, "80", {"11": 60, "12": 70, "13": 80}),
    ("Username", False, "80", {"11": 60, "12": 70, "13": 80}),
    ("Username", True, "101", None),
    ("Username", False, "101", None),
)


@pytest.mark.parametrize(("heading", "skips", "last", "said"), MOODLE_SAID)
def test_the_port_of_moodles_import_says_what_moodle_says(
    heading: str, skips: bool, last: str, said: dict[str, int] | None
) -> None:
    """An empty cell gives the grade to the student of the line above, or ends the import as too high a grade does."""
    text = f"ID number,Username,Grade\n0012,am12,60\n,bob,70\n0014,cem,{last}\n"
    fact = FACTS[heading]
    if said is None:
        with pytest.raises(Refused):
            importers.moodle_grade_book(
                text.encode(), MOODLE_USERS, heading, fact, skips_empty_keys=skips
            )
    else:
        assert said == importers.moodle_grade_book(
            text.encode(), MOODLE_USERS, heading, fact, skips_empty_keys=skips
        )


KNOWN = st.sets(st.sampled_from(["student_id", "login", "email"]))


@settings(max_examples=20)
@given(st.lists(KNOWN, min_size=1, max_size=6), st.booleans())
def test_any_key_column_of_any_table_gives_each_student_their_own_points(
    known: list[set[str]], skips: bool
) -> None:
    """Each student has the right points if facts are known of some students only.

    Both treatments of empty cells by Moodle give the same.
    """
    users = []
    for n in range(len(known)):
        users.append(User(f"{n}", f"S{n}", f"{n:04}", f"login{n}", f"s{n}@uni.example"))
    entries = []
    for user, facts in zip(users, known, strict=True):
        person = Person(user.name, **{fact: getattr(user, fact) for fact in facts})
        result = result_of(LAB, [1, int(user.number) / 100])
        entries.append(entry_of(user.name, result, identity=Identity((person,))))
    returned = CLASS_EXPORTS["moodle"].render(ReturnedClass(entries, Path()))
    reached = []
    for table in (returned, *returned.further):
        reached += students_by_any_key(table, users, skips)
    assert sorted(reached) == [
        user.number for user, facts in zip(users, known, strict=True) if facts
    ]


def students_by_any_key(table: Returned, users: list[User], skips: bool) -> list[str]:
    """Give the students that Moodle finds in a table, by whichever of its columns; each must have their own points."""
    if not table.count:
        return []
    head = importers.table(table.content)[0]
    found = []
    for heading, fact in FACTS.items():
        if heading in head:
            read = importers.moodle_grade_book(
                table.content, users, heading, fact, skips_empty_keys=skips
            )
            assert read == {number: 60 + Decimal(number) * 4 / 10 for number in read}
            assert len(read) == table.count
            found = [*read]
    return found


def test_an_incomplete_column_is_left_out_and_said(tmp_path: Path, rubric: Rubric) -> None:
    """The note names students without the fact, and the columns to map; Identifier is not one."""
    listed = "name;student_id;email\nMüller, Änne;0012;aenne@uni.example\n"
    listed += "O'Brien, Bob;;bob@uni.example\nÇelik, Cem;0014;cem+lab@uni.example\n"
    returned = CLASS_EXPORTS["moodle"].render(graded("Moodle", tmp_path, rubric, listed))
    head = importers.table(returned.content)[0]
    assert "ID number" not in head
    assert {"Identifier", "Email address"} <= {*head}
    advice, missing = returned.notes
    assert "choose 'Map from' Email address, and leave Identifier and all other" in advice
    assert "ID number" in missing
    assert returned.notes[missing] == ["Bob_O_Brien_12"]


def test_points_above_the_maximum_are_said_with_what_moodle_does() -> None:
    """The owners of points above the maximum are named; Moodle imports nothing of such a table."""
    plain = result_of(LAB, [1, 1])
    plain["adjustments"] = [
        {"kind": "bonus", "what": "x", "points": 3, "reason": "", "who": "", "when": ""}
    ]
    entries = [
        one(Person("Ann", "0012"), "a"),
        entry_of("b", plain, identity=Identity((Person("Bob", "0013"),))),
    ]
    given = ReturnedClass(entries, Path())
    returned = CLASS_EXPORTS["moodle"].render(given)
    with pytest.raises(Refused):
        importers.moodle_grade_book(
            returned.content,
            [User("1", "", "0012"), User("2", "", "0013")],
            "ID number",
            "student_id",
        )
    (note,) = (note for note in returned.notes if "maximum" in note)
    assert "imports nobody" in note
    assert returned.notes[note] == ["b"]
    assert CLASS_EXPORTS["canvas"].render(given).notes == {}


@pytest.mark.parametrize(
    ("column", "lab", "number"),
    [
        ("Final Lab (4711)", "x", "4711"),
        ("Semifinal (4711)", "x", "4711"),
        ("Current Score (4711)", "x", "4711"),
        ("", "Final Project", "Project"),
        ("", "FINAL", "Lab"),
        ("", "Lab 9: Nodes", "Lab 9: Nodes"),
    ],
)
def test_canvas_ignores_no_column_of_ours(column: str, lab: str, number: str) -> None:
    """Its number alone says which assignment a column is; a new one gets a name without the word, which is said."""
    plain = result_of(LAB, [1, 0]) | {"lab": lab}
    entries = [entry_of("ann", plain, identity=Identity((Person("Ann", "0012"),)))]
    returned = CLASS_EXPORTS["canvas"].render(ReturnedClass(entries, Path(), column))
    users = [User("12", "Ann", "0012")]
    scores = importers.canvas(returned.content, users, {"4711": "Final Lab"})
    assert scores == {number: {"12": "60"}}
    assert bool(returned.notes) == (lab != "Lab 9: Nodes")


def test_a_column_that_canvas_would_ignore_is_refused() -> None:
    """By its name alone Canvas would not find it; the remedy is its number."""
    with pytest.raises(UsageError) as refused:
        CLASS_EXPORTS["canvas"].render(
            ReturnedClass([one(Person("Ann", "0012"))], Path(), "Final Lab")
        )
    assert "number" in refused.value.remedy


def test_a_number_of_another_system_is_no_participant_of_moodle(
    tmp_path: Path, rubric: Rubric
) -> None:
    """Canvas' number 11 may be anybody's in Moodle, so nobody gets a grade by it."""
    returned = CLASS_EXPORTS["moodle"].render(graded("Canvas", tmp_path, rubric))
    assert returned.count == 0
    assert [len(names) for names in returned.left_out.values()] == [3]


def canvas_export(users: Iterable[User] = USERS) -> str:
    """Give an export of Canvas' gradebook, with a line of possible points and an extra student."""
    lines = [
        "Student,ID,SIS User ID,SIS Login ID,Section,Lab 9 (4711)",
        "    Points Possible,,,,,100",
    ]
    lines += [f'"{u.name}",{u.number},{u.student_id},"{u.login}",A1,' for u in users]
    return "\n".join([*lines, '"Student, Test",99,,,A1,'])


@pytest.mark.parametrize("class_list", ["", canvas_export()])
@pytest.mark.parametrize(
    ("column", "number"), [("Lab 9 (4711)", "4711"), ("Lab 9", "4711"), ("", "Lab 1: Nodes")]
)
def test_canvas_gradebook(
    class_list: str, column: str, number: str, tmp_path: Path, rubric: Rubric
) -> None:
    """An existing column is filled by its heading, else a new one is made.

    The download alone suffices to find each student.
    """
    given = graded("Canvas", tmp_path, rubric, class_list, column)
    returned = CLASS_EXPORTS["canvas"].render(given)
    scores = importers.canvas(returned.content, USERS, {"4711": "Lab 9", "4712": "Lab 10"})
    assert scores == {number: {user: str(points) for user, points in POINTS.items()}}


def test_canvas_finds_students_of_other_downloads_by_the_universitys_ids(
    tmp_path: Path, rubric: Rubric
) -> None:
    """Without a number of Canvas the SIS ids tell, with their zeros."""
    returned = CLASS_EXPORTS["canvas"].render(graded("Brightspace", tmp_path, rubric, CLASS_LIST))
    (scores,) = importers.canvas(returned.content, USERS, {}).values()
    assert scores == {user: str(points) for user, points in POINTS.items()}


def test_blackboards_grade_center_needs_nothing_but_the_download(
    tmp_path: Path, rubric: Rubric
) -> None:
    """User names stand in its names of files; the column's number says which column it is."""
    column = "Lab 9 [Total Pts: 100 Score] |409581"
    returned = CLASS_EXPORTS["blackboard"].render(
        graded("Blackboard", tmp_path, rubric, "", column)
    )
    read = importers.blackboard(returned.content, USERS, {"409581": "Lab 9"})
    assert read["409581"] == {"am12": "60.4", "bo,13": "60.8", "007": "61.2"}
    assert read["Feedback to Learner"]["007"].startswith("61.2 of 100 points.")
    assert {*read["Feedback Format"].values()} == {"SMART_TEXT"}


def test_brightspace_gets_ids_from_a_class_list(tmp_path: Path, rubric: Rubric) -> None:
    """Its download has only numbers that its grade book does not know, so without a list nobody is exported."""
    returned = CLASS_EXPORTS["brightspace"].render(
        graded("Brightspace", tmp_path, rubric, CLASS_LIST)
    )
    assert importers.brightspace(returned.content, USERS, Decimal(100)) == {"Lab 1: Nodes": POINTS}
    bare = CLASS_EXPORTS["brightspace"].render(graded("Brightspace", tmp_path / "bare", rubric))
    assert (bare.count, [*bare.left_out]) == (0, ["none of these is known: OrgDefinedId, Username"])


BRIGHTSPACE_EXPORT = (
    "OrgDefinedId,Username,Last Name,First Name,Email,End-of-Line Indicator\n"
    "#0012,#am12,Müller,Änne,aenne@uni.example,#\n"
    '#0013,"#bo,13",O\'Brien,Bob,bob@uni.example,#\n'
    "#00000000000000000014,#007,Çelik,Cem,cem+lab@uni.example,#\n"
)
BLACKBOARD_EXPORT = (
    '"Last Name"\t"First Name"\t"Username"\t"Student ID"\n"Müller"\t"Änne"\t"am12"\t"0012"\n'
    '"O\'Brien"\t"Bob"\t"bo,13"\t"0013"\n"Çelik"\t"Cem"\t"007"\t"00000000000000000014"\n'
)
MOODLE_EXPORT = (
    "Identifier,Full name,ID number,Email address,Status,Grade,Maximum Grade\n"
    "Participant 11,Änne Müller,0012,aenne@uni.example,Submitted,,100\n"
    "Participant 12,Bob O'Brien,0013,bob@uni.example,Submitted,,100\n"
    "Participant 13,Cem Çelik,00000000000000000014,cem+lab@uni.example,Submitted,,100\n"
)


@pytest.mark.parametrize(
    ("exported", "encoding"),
    [
        (BRIGHTSPACE_EXPORT, "utf-8-sig"),
        (BLACKBOARD_EXPORT, "utf-16"),
        (MOODLE_EXPORT, "utf-8"),
        (canvas_export(), "utf-8"),
    ],
)
@pytest.mark.parametrize("system", ["Moodle", "Brightspace"])
def test_what_a_grade_book_exports_is_a_class_list(
    system: str, exported: str, encoding: str, tmp_path: Path, rubric: Rubric
) -> None:
    """Ids of an exported grade book, without its prefixes, go into any other grade book."""
    (tmp_path / "list").mkdir()
    listed = tmp_path / "list/class.csv"
    listed.write_text(exported, encoding=encoding)
    given = graded(system, tmp_path, rubric)
    entries = []
    for entry in with_roster(given.entries, read_class_list(listed)):
        if entry.result:
            entries.append(entry)
    returned = CLASS_EXPORTS["brightspace"].render(ReturnedClass(entries, given.folder))
    assert importers.brightspace(returned.content, USERS, Decimal(100)) == {"Lab 1: Nodes": POINTS}


def test_numbers_of_two_systems_are_not_taken_for_each_other(
    tmp_path: Path, rubric: Rubric
) -> None:
    """Canvas' user 12 is somebody else than Moodle's participant 12; names tell, and each gets its own numbers."""
    others = []
    for number, user in zip("213", USERS, strict=True):
        others.append(User(number, user.name, user.student_id, user.login))
    others = [User(f"1{user.number}", user.name, user.student_id, user.login) for user in others]
    given = graded("Moodle", tmp_path, rubric, canvas_export(others))
    (scores,) = importers.canvas(CLASS_EXPORTS["canvas"].render(given).content, others, {}).values()
    assert scores == {"12": "60.4", "11": "60.8", "13": "61.2"}
    participants = importers.moodle_worksheet(
        CLASS_EXPORTS["moodle"].render(given).content, USERS, Decimal(100)
    )
    assert {number: grade for number, (grade, _) in participants.items()} == POINTS


# -- teams -----------------------------------------------------------------------------------------


def test_all_of_a_team_get_what_one_of_them_handed_in(tmp_path: Path, rubric: Rubric) -> None:
    """A team's members all get the points of its submission, found by student or team name.

    Of two members with submissions of their own, each keeps the own points.
    """
    listed = """name,student_id,team
Ann,0001,Red
Bob,0002,Red
Cem,0003,Blue Whales
Dan,0004,Blue Whales
Eve,0005,Green
Fay,0006,Green
Gus,0007,Green
"""
    names = []
    for name in ("ann", "Blue_Whales", "eve", "fay"):
        names.append(f"submissions/{name}/joint_publisher.py")
    sources = taken_in(tmp_path, rubric, names, listed)
    assert [source.name for source in sources] == ["ann", "Blue_Whales", "eve", "fay"]
    returned = CLASS_EXPORTS["brightspace"].render(given_back(tmp_path, sources))
    users = [User(str(n), "", f"000{n}") for n in range(1, 8)]
    assert importers.brightspace(returned.content, users, Decimal(100))["Lab 1: Nodes"] == {
        **dict.fromkeys(("1", "2"), Decimal("60.4")),
        **dict.fromkeys(("3", "4"), Decimal("60.8")),
        "5": Decimal("61.2"),
        "6": Decimal("61.6"),
    }


def test_a_team_is_not_given_the_number_of_one_of_its_members(
    tmp_path: Path, rubric: Rubric
) -> None:
    """Students are found by their own ids, not by the one in the name of a group's file.

    Canvas names such a file after the group and one member, and does not say which.
    """
    listed = "name,student_id,team\nMüller Änne,0012,Red\nO'Brien Bob,0013,Red\nÇelik Cem,00000000000000000014,Blue\n"
    sources = taken_in(tmp_path, rubric, ["red_12_890_lab.zip", "blue_13_891_lab.zip"], listed)
    returned = CLASS_EXPORTS["canvas"].render(given_back(tmp_path, reversed(sources)))
    (scores,) = importers.canvas(returned.content, USERS, {}).values()
    assert scores == {"11": "60.4", "12": "60.4", "13": "60.8"}


def test_a_list_that_is_given_later_says_who_is_of_a_team_now(
    tmp_path: Path, rubric: Rubric
) -> None:
    """A member that left the team before the later list has no share any more."""
    names = ["submissions/ann/joint_publisher.py", "submissions/zoe/joint_publisher.py"]
    sources = taken_in(
        tmp_path, rubric, names, "name,student_id,team\nann,1,Red\nbob,2,Red\ncem,3,Red\n"
    )
    given = given_back(tmp_path, sources)
    (tmp_path / "now.csv").write_text("name,student_id,team\nann,1,Red\nbob,2,Red\ncem,3,\n")
    first = with_roster(given.entries, read_class_list(tmp_path / "now.csv"))[0]
    assert [person.name for person in given.entries[0].people] == ["ann", "bob", "cem"]
    assert [person.name for person in first.people] == ["ann", "bob"]


def test_all_who_handed_in_together_on_gradescope_have_a_line(
    tmp_path: Path, rubric: Rubric
) -> None:
    """Each member of a submission on Gradescope has a line, with the university's id."""
    folder = tmp_path / "download"
    for n in (1, 2):
        (folder / f"submission_{n}").mkdir(parents=True)
        (folder / f"submission_{n}/joint_publisher.py").write_text("x")
    people = "  - :name: Änne Müller\n    :sid: '0012'\n    :email: a@uni.example\n  - :name: Bob\n    :sid: '0013'\n"
    alone = "  - :name: Cem\n    :sid: '00000000000000000014'\n    :email: cem@uni.example\n"
    text = f"---\nsubmission_1:\n  :submitters:\n{people}submission_2:\n  :submitters:\n{alone}"
    (folder / "submission_metadata.yml").write_text(text, encoding="utf-8")
    given = given_back(tmp_path, reversed(taken_in(tmp_path, rubric, [])))
    returned = CLASS_EXPORTS["canvas"].render(given)
    (scores,) = importers.canvas(returned.content, USERS, {}).values()
    assert {*scores} == {"11", "12", "13"}
    assert scores["11"] == scores["12"] != scores["13"]


# -- what is hostile, or wrong -----------------------------------------------------------------------


def one(person: Person, name: str = "ann") -> ClassEntry:
    """Give a person with a result."""
    return entry_of(name, result_of(LAB, [1, 0]), identity=Identity((person,)))


TEXT = st.text(st.sampled_from("=+-@＝\t\r\n\"' ,;|#0a(9)[]<&\u202e\ufeffü"), max_size=12)


def ids_of(who: Person, mark: str) -> dict[str, str]:
    """Return the ids of a student, by the headings of all systems; Brightspace marks some of them."""
    return {
        "Identifier": f"Participant {who.moodle}",
        "ID": who.canvas,
        "ID number": who.student_id,
        "SIS User ID": who.student_id,
        "OrgDefinedId": mark + who.student_id,
        "Username": mark + who.login,
        "SIS Login ID": who.login,
        "Email address": who.email,
    }


@given(
    st.lists(TEXT, min_size=7, max_size=7),
    st.sampled_from(["moodle", "canvas", "blackboard", "brightspace"]),
)
def test_no_cell_is_a_formula_and_no_id_another(texts: list[str], form: str) -> None:
    """Whatever a name or id is, the file can be read; by an id that is written, nobody else is found."""
    who = Person(*texts)
    returned = CLASS_EXPORTS[form].render(ReturnedClass([one(who)], Path()))
    rows = list(csv.reader(io.StringIO(returned.content.decode(), newline="")))
    for cell in itertools.chain(*rows):
        assert not cell.startswith(("=", "+", "-", "@", "＝", "\t", "\r"))
    exact = ids_of(who, mark="#" if form == "brightspace" else "")
    for row in rows[1:] if form != "canvas" else rows[2:]:
        keys = {
            heading: cell
            for heading, cell in zip(rows[0], row, strict=True)
            if heading in exact and cell
        }
        assert keys
        assert keys == {heading: exact[heading] for heading in keys}
    assert returned.count + sum(map(len, returned.left_out.values())) == 1


@pytest.mark.parametrize("login", ["=cmd|' /C calc'!A0", "+49", "@sum", "-1", "a\nb"])
def test_an_id_that_cannot_be_written_as_it_is_is_not_written(login: str) -> None:
    """Changed it would be another's, and as it is a spreadsheet would run it; the student is named."""
    bare = CLASS_EXPORTS["blackboard"].render(
        ReturnedClass([one(Person("Ann", login=login))], Path())
    )
    assert (bare.count, [*bare.left_out.values()]) == (0, [["ann"]])
    other = CLASS_EXPORTS["moodle"].render(
        ReturnedClass([one(Person("Ann", "0012", login))], Path())
    )
    assert other.count == 1
    assert login.encode() not in other.content


def test_two_submissions_of_one_student_are_both_left_out() -> None:
    """The grade book would keep whichever comes last."""
    entries = [
        one(Person("Ann", "0012"), "a"),
        one(Person("Ann", "0012", "ann"), "b"),
        one(Person("Cem", "0014"), "c"),
    ]
    returned = CLASS_EXPORTS["moodle"].render(ReturnedClass(entries, Path()))
    assert returned.left_out == {"the same student stands behind several submissions": ["a", "b"]}
    assert importers.moodle_grade_book(
        returned.content, [User("14", "", "0014")], "ID number", "student_id"
    ) == {"14": Decimal(60)}


def test_the_comment_says_what_is_open_and_reads_as_no_markup() -> None:
    """Undecided points and adjustments are listed, without signs of any system's markup."""
    plain = result_of(LAB, [None, 0.5])
    plain["criteria"][1]["checks"][0]["title"] = "<b>|error| & 3 ms"
    plain["adjustments"] = [
        {"kind": "late", "what": "x", "points": -5, "reason": "", "who": "", "when": ""}
    ]
    result = entry_of("ann", plain).result
    assert result is not None
    assert "       0 of 60     Pub (60 undecided)\n      20 of 40     Doc\n" in plain_report(result)
    assert comment(result) == (
        "15 of 100 points. With adjustments: Late −5. 60 more are undecided; your instructor decides. "
        "Fix first: ‹b›|error| + 3 ms (20 points)."
    )


def test_a_reader_refuses_what_its_system_would() -> None:
    """The importers that these tests rely on see a wrong file as wrong."""
    with pytest.raises(Refused, match="header"):
        importers.canvas(b"Name,ID,Section,Lab\n", [], {})
    with pytest.raises(Refused, match="quotes"):
        importers.blackboard(b'"Username",Lab\n"a",1\n', [], {})
    with pytest.raises(Refused, match="end of line"):
        importers.brightspace(b"Username,Lab Points Grade\na,1\n", [], Decimal(1))
    with pytest.raises(Refused, match="no user"):
        importers.moodle_grade_book(b"ID number,Grade\n7,1\n", USERS, "ID number", "student_id")
