"""Class lists: students, their submissions and times, in every system's form of names and times."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

import pytest

from grader.lab.policy import Policy, SubmissionTime
from grader.submission.lms.worksheet import columns_of, worksheet_time
from grader.submission.roster import Match, Student, matches, read_class_list

#: Times of worksheets in the forms of Moodle's languages, with the time that they mean.
EVENING = datetime(2026, 3, 2, 23, 41)
TIMES = {
    "en": ("Monday, 2 March 2026, 11:41 PM", EVENING),
    "en_us": ("Monday, March 2, 2026, 11:41 PM", EVENING),
    "en, after midnight": ("Tuesday, 3 March 2026, 12:05 AM", datetime(2026, 3, 3, 0, 5)),
    "de": ("Montag, 2. März 2026, 23:41", EVENING),
    "fr": ("lundi 2 mars 2026, 23:41", EVENING),
    "es": ("lunes, 2 de marzo de 2026, 23:41", EVENING),
    "it": ("lunedì, 2 marzo 2026, 23:41", EVENING),
    "nl": ("maandag, 2 maart 2026, 23:41", EVENING),
    "pl": ("wtorek, 20 października 2026, 23:59", datetime(2026, 10, 20, 23, 59)),
    "hr": ("utorak, 20. listopada 2026., 23:59", datetime(2026, 10, 20, 23, 59)),
    "ru": ("понедельник, 2 марта 2026, 23:41", EVENING),
    "ja": ("2026年 03月 2日(月曜日) 23:41", EVENING),
    "iso": ("2026-03-02 23:41", EVENING),
    "nothing handed in": ("-", None),
    "two possible days": ("03/02/2026, 23:41", None),
    "no year": ("Monday, 2 March, 11:41 PM", None),
    "no time": ("Monday, 2 March 2026", None),
}


@pytest.mark.parametrize("language", TIMES)
def test_times_of_worksheets(language: str) -> None:
    """A time is read in the downloading person's language.

    A text that may mean two days gives none.
    """
    text, meant = TIMES[language]
    assert worksheet_time(text) == meant


HEADINGS = {
    "en": "Identifier,Full name,ID number,Email address,Status,Grade,Maximum Grade,Grade can be changed,"
    "Last modified (submission),Online text,Last modified (grade),Feedback comments",
    "de": "ID,Vollständiger Name,ID-Nummer,E-Mail-Adresse,Status,Bewertung,Bestwertung,"
    "Bewertung kann geändert werden,Zuletzt geändert (Abgabe),Texteingabe online,"
    "Zuletzt geändert (Bewertung),Feedback als Kommentar",
    "fr": "Identifiant,Nom complet,Numéro d’identification,Adresse de courriel,Statut,Note,Note maximale,"
    "La note peut être modifiée,Dernière modification (travail remis),Texte en ligne,"
    "Dernière modification (note),Feedback par commentaires",
    "nl": "Identificatie,Volledige naam,ID-nummer,E-mailadres,Status,Cijfer,Maximale cijfer,"
    "Cijfer kan gewijzigd worden,Laatst gewijzigd (inzending),Online tekst,"
    "Laatst gewijzigd (beoordeling),Feedback",
}


@pytest.mark.parametrize("language", HEADINGS)
def test_a_worksheet_of_any_language_is_a_class_list(language: str, tmp_path: Path) -> None:
    """Participant, name, id, address and time of submission are read whatever the headings' language is."""
    number = "Teilnehmer/in11" if language == "de" else "Participant 11"
    row = [number, '"Müller, Änne"', "0012", "am@uni.example", "Submitted", "", "100", "Yes"]
    text, _ = TIMES[language]
    row += [f'"{text}"', "", "-", ""]
    (tmp_path / "sheet.csv").write_text(
        f"{HEADINGS[language]}\n{','.join(row)}\n", encoding="utf-8-sig"
    )
    (student,) = read_class_list(tmp_path / "sheet.csv")
    assert (student.name, student.person.moodle) == ("Müller, Änne", "11")
    assert (student.student_id, student.person.email) == ("0012", "am@uni.example")
    assert (student.submitted_at, student.time_source) == (EVENING, "Moodle's grading worksheet")


FOREIGN = {
    "pl": "Identyfikator,Imię i nazwisko,Adres e-mail,Status,Ocena,Maksymalna ocena,"
    "Ostatnio modyfikowane (przesłane zadanie),Ostatnio modyfikowane (ocena)",
    "zh": "识别号,全名,电子邮件地址,状态,成绩,最高分,最后修改(作业),最后修改(成绩)",
    "tr": "Kimlik,Tam adı,E-posta adresi,Durum,Not,En yüksek not,Son değiştirme (gönderim),Son değiştirme (not)",
    "da": "Identifikator,Fulde navn,E-mailadresse,Status,Karakter,Maksimum,"
    "Senest ændret (aflevering),Senest ændret (karakter)",
}


@pytest.mark.parametrize("language", FOREIGN)
def test_addresses_tell_a_worksheets_columns(language: str, tmp_path: Path) -> None:
    """Where no heading is known, the column with addresses tells that names stand in the second one."""
    row = 'Participant 11,Ann Lee,al@uni.example,-,,100,"2 March 2026, 23:41",-'
    (tmp_path / "sheet.csv").write_text(f"{FOREIGN[language]}\n{row}\n", encoding="utf-8-sig")
    (student,) = read_class_list(tmp_path / "sheet.csv")
    known = (student.name, student.person.moodle, student.person.email, student.submitted_at)
    assert known == ("Ann Lee", "11", "al@uni.example", EVENING)


def test_other_lists_keep_their_columns() -> None:
    """Only two headings that differ in their brackets make a worksheet of a list."""
    for headings in (["Name", "Points (of 10)"], ["name", "Lab 1 (x)", "Lab 2 (y)", "id"]):
        assert columns_of(headings) == [h.strip().lower().replace(" ", "_") for h in headings]


def test_a_repeated_hour_counts_as_the_first() -> None:
    """A policy's zone gives a time its offset, in the student's favour when clocks are set back."""
    policy = Policy.model_validate({"timezone": "Europe/Berlin"})
    night = datetime(2026, 10, 25, 2, 30)
    zoned = policy.zoned(SubmissionTime(night, "Blackboard"))
    assert zoned.at is not None
    assert zoned.at.astimezone(UTC) == datetime(2026, 10, 25, 0, 30, tzinfo=UTC)
    known = SubmissionTime(datetime(2026, 10, 25, 2, 30, tzinfo=UTC))
    assert policy.zoned(known) == known


def test_an_unknown_zone_is_a_mistake() -> None:
    """A zone that does not exist is refused, with the one that may be meant."""
    with pytest.raises(ValueError, match="did you mean 'Europe/Berlin'"):
        Policy.model_validate({"timezone": "Europe/Berln"})


#: Facts about three downloads and their late deductions; run under each time zone of the machine.
PROGRAM = """
import json, sys
from pathlib import Path
from grader.judging.adjust import adjust
from grader.judging.rubrics import read_rubric
from grader.lab.policy import Policy
from grader.submission.discovery import find_submissions
from grader.submission.extraction import open_submission
from tests.judging.test_adjust import JUDGED
folder, policies, rubric = Path(sys.argv[1]), json.loads(sys.argv[2]), read_rubric(None)
told = []
for path, listed in (("class", None), ("class", "class.csv"), ("blackboard", None)):
    class_list = folder / listed if listed else None
    for source in find_submissions([folder / path], rubric, class_list=class_list).submissions:
        with open_submission(source) as intake:
            for plain in policies:
                policy = Policy.model_validate(plain)
                known = policy.zoned(intake.source.submission_time)
                result = adjust(JUDGED, (), policy.late, known)
                told.append([source.name, str(result.final), result.timing.text])
print(json.dumps(told))
"""


@pytest.mark.slow
def test_no_verdict_depends_on_the_machines_time_zone(tmp_path: Path) -> None:
    """Zips of Windows, a list and a download without zones cost the same points in Berlin, UTC and Los Angeles."""
    lay_out_times_without_zones(tmp_path)
    zones = ("Europe/Berlin", "UTC", "America/Los_Angeles")
    told, *others = [verdicts_in(zone, tmp_path) for zone in zones]
    assert others == [told, told]
    assert {points for _, points, _ in told} == {"12.5"}
    texts = sorted({(name, text) for name, _, text in told})
    words = "\n".join(text for _, text in texts)
    assert "newest file in it says 2026-11-20 23:40, time zone not known" in words
    assert count_of(r"\+01:00 \(by Blackboard's download\)", r"in time", texts) == 2
    assert count_of(r"\(by the class list\)", r": in time\.$", texts) == 1


def count_of(source: str, verdict: str, texts: Iterable[tuple[str, str]]) -> int:
    """Return how many texts have both a source and a verdict, given as regular expressions."""
    named = [text for _, text in texts if re.search(source, text)]
    return sum(re.search(verdict, text) is not None for text in named)


def lay_out_times_without_zones(folder: Path) -> None:
    """Write zips, a class list and a download of Blackboard, all with the same local time."""
    (folder / "class").mkdir()
    for name in ("anna", "ben"):
        with zipfile.ZipFile(folder / f"class/{name}.zip", "w") as packed:
            info = zipfile.ZipInfo("joint_publisher.py", (2026, 11, 20, 23, 40, 0))
            packed.writestr(info, "pass\n")
    (folder / "class.csv").write_text("name,submitted_at\nanna,2026-11-20T23:40\nben,\n")
    (folder / "blackboard").mkdir()
    for user in ("cem1", "dora2"):
        attempt = f"Lab 9_{user}_attempt_2026-11-20-23-40-00"
        (folder / f"blackboard/{attempt}_joint_publisher.py").write_text("pass\n")
        (folder / f"blackboard/{attempt}.txt").write_text("")


def verdicts_in(zone: str, folder: Path) -> list[list[str]]:
    """Return name, points and reason of each submission on a machine in a time zone, by two policies."""
    late = {"due": "2026-11-20T23:59:00+01:00", "per_day": "10 %"}
    policies = json.dumps([{"late": late}, {"late": late, "timezone": "Europe/Berlin"}])
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(folder), policies],
        capture_output=True,
        text=True,
        env={**os.environ, "TZ": zone},
        cwd=Path(__file__).parents[2],
        check=True,
    )
    found: list[list[str]] = json.loads(done.stdout)
    return found


# -- whose what is ---------------------------------------------------------------------------------


def whose(students: list[Student], *names: str) -> list[Match]:
    """Find the owners of folders of these names."""
    return matches(students, [(Student(name), ()) for name in names])


def listed(name: str, student_id: str = "", login: str = "", email: str = "") -> Student:
    """Give a student of a class list."""
    from grader.recording.submission import Person

    return Student(name, student_id or None, person=Person(name, student_id, login, email))


CLASS = [
    listed("Müller, Änne", "4711", "aemuell"),
    listed("Bob O'Brien", "4712", "bobrien"),
    listed("Anna Berg", "4713", "berga"),
    listed("Anna Maria Berg", "4714", "bergam", "anna.maria@uni.example"),
]


@pytest.mark.parametrize(
    ("name", "index"),
    [
        ("Müller_Änne_aemuell_4711", 0),
        ("O_Brien_Bob_bobrien_4712", 1),
        ("lab9-31-bobrien", 1),
        ("Lab-9_4712", 1),
        ("Änne Müller (2)", 0),
        ("Berg_Anna_berga_4713", 2),
        ("Berg_Anna_Maria", 3),
        ("anna.maria_9", 3),
        ("Berg_Anna", 2),
        ("Berg_Anna_x", 2),
    ],
)
def test_a_login_or_all_words_of_a_name_tell_the_student(name: str, index: int) -> None:
    """The forms of ILIAS and Artemis, and others with a login, an id or all words of a name, find the student."""
    (found,) = whose(CLASS, name)
    assert [person.name for person in found.people] == [CLASS[index].name]
    assert found.may_be == {index}


@pytest.mark.parametrize(
    ("name", "may_be"),
    [
        ("Änne_Müller_bobrien", {0, 1}),
        ("aemuell_bobrien", {0, 1}),
        ("Müller", set()),
        ("lab_471", set()),
        ("obrien", set()),
    ],
)
def test_what_points_to_two_or_to_nobody_is_not_guessed(name: str, may_be: set[int]) -> None:
    """A name that fits two students, or only part of one, matches nobody; candidates are listed."""
    (found,) = whose(CLASS, name)
    assert found.people == ()
    assert found.may_be == may_be


def test_a_word_of_several_folders_is_no_id() -> None:
    """A number that all folders bear, such as a year, is not the id of a student."""
    year = listed("Zoe Ray", "2026", "zray")
    found = whose([*CLASS, year], "lab_2026_aemuell", "lab_2026_bobrien", "lab_2026_carl")
    assert [[p.name for p in match.people] for match in found] == [
        ["Müller, Änne"],
        ["Bob O'Brien"],
        [],
    ]
    short = listed("Yann", "9", "y")
    assert whose([short], "lab_9_y")[0].may_be == frozenset()


def test_two_folders_with_a_students_words_are_not_told_apart() -> None:
    """Where one name stands in two folders, neither gets the student, and the student is not missing."""
    first, second = whose(CLASS, "Bob_O'Brien_a", "Bob_O'Brien_b")
    assert first.people == second.people == ()
    assert first.may_be == second.may_be == {1}
    whole, part = whose(CLASS, "Bob O'Brien", "Bob_O'Brien_b")
    assert [p.name for p in whole.people] == ["Bob O'Brien"]
    assert part.people == ()
    assert part.may_be == {1}
