"""Moodle's grading worksheet: its columns and times, in any language.

Facts from Moodle's source (`mod/assign/gradingtable.php`, `lib/moodlelib.php`): headings are in the language of the
downloading user. "Last modified (submission)" comes before "Last modified (grade)" and differs from it by the
words in brackets only, in every language. Times are written by `userdate` in the language's long form and the user's
time zone, without the zone: "Monday, 2 March 2026, 11:41 PM", "Montag, 2. März 2026, 23:41". The first column is
the participant's number after a word ("Participant 12", "Teilnehmer/in12"), the second the full name unless hidden.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from datetime import datetime

#: The column of the time of submission, as `columns_of` names it.
WORKSHEET_TIME = "last_modified_(submission)"
_BRACKETED = re.compile(r"(?P<head>[^(（]+)[(（].*")
_CLOCK = re.compile(r"\d{1,2}[:.h]\d\d")
_YEAR = re.compile(r"\b\d{4}\b|\d{4}年")
#: A date of numbers without the year in front.
_TWO_DAYS = re.compile(r"\b\d{1,2}[-/.]\d{1,2}[-/.]\d{4}")
_MOST_CHARACTERS = 100
_ADDRESS = re.compile(r"\s*[^@\s]{1,100}@[^@\s]{1,200}\s*")
#: Columns before the grades: the participant, the name, and other facts about a person.
_MOST_IDENTITY_COLUMNS = 6
_KNOWN = frozenset({"full_name", "id_number", "email_address"})
_NAME = re.compile(r"(?i)name|nom|naam|nimi|jméno|név|имя|氏名|姓名|名前")


def columns_of(headings: Sequence[str], sample: Sequence[Sequence[str]] = ()) -> list[str]:
    """Return the columns of a class list in lower case, with underscores for blanks; a worksheet's in English.

    Parameters
    ----------
    headings
        The headings.
    sample
        Some lines; addresses in them tell more than headings in an unknown language.
    """
    columns = [heading.strip().lower().replace(" ", "_") for heading in headings]
    heads = []
    for column in columns:
        match = _BRACKETED.fullmatch(column)
        heads.append(match["head"] if match is not None else "")
    pairs = [head for head, count in Counter(heads).items() if head and count == 2]
    if len(pairs) != 1:
        return columns
    columns[heads.index(pairs[0])] = WORKSHEET_TIME
    if "identifier" not in columns:
        columns[0] = "identifier"
        if not _KNOWN & {*columns} and _NAME.search(columns[1]):
            columns[1] = "full_name"
        if not _KNOWN & {*columns[2:]}:
            _translate(columns)
        _name_by_addresses(columns, sample)
    return columns


def _name_by_addresses(columns: list[str], sample: Sequence[Sequence[str]]) -> None:
    """Name the column of addresses by its contents; a worksheet with addresses has full names in its second column."""
    beside = range(2, min(len(columns), _MOST_IDENTITY_COLUMNS))
    lines = [line for line in sample if len(line) == len(columns)]
    for n in beside:
        has_addresses = any(_ADDRESS.fullmatch(line[n]) for line in lines)
        if has_addresses and "email_address" not in columns:
            columns[n] = "email_address"
    if "email_address" in columns[2:] and not _KNOWN & {columns[1]}:
        columns[1] = "full_name"


def _translate(columns: list[str]) -> None:
    """Name the columns of ID numbers and addresses by their headings in other languages."""
    for n, column in enumerate(columns[1:5], 1):
        if re.search("mail|correo|courriel", column):
            columns[n] = "email_address"
        elif re.match(r"(?i)(id[-_]|n.*[-_ ’']id|.*matri[ck]el)", column):
            columns[n] = "id_number"


def worksheet_time(text: str) -> datetime | None:
    """Read a time such as "Montag, 2. März 2026, 23:41", without offset from UTC; None if it is not certain.

    A date of numbers alone, such as 3/2/2026, can mean two days, and is not certain.
    """
    import dateparser

    if len(text) > _MOST_CHARACTERS or _TWO_DAYS.search(text):
        return None
    if not _CLOCK.search(text) or not _YEAR.search(text):
        return None
    settings = {
        "PARSERS": ["absolute-time"],
        "REQUIRE_PARTS": ["day", "month", "year"],
        "RETURN_AS_TIMEZONE_AWARE": False,
        "TIMEZONE": "UTC",
    }
    return dateparser.parse(text, settings=settings)
