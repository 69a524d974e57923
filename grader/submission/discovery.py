"""Submissions at the paths of a command line.

`grader.submission.collection` distinguishes one submission from a folder of submissions; `Shape.ONE` and `Shape.EACH`
override it. Hidden files and folders, folders of tools, and tables are ignored. Earlier results (without any of the
lab's files), and files without an owner, are reported.
"""

from __future__ import annotations

import hashlib
import os
import re
import unicodedata
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path

from grader.errors import SubmissionError
from grader.lab.rubric import Rubric
from grader.recording.submission import Identity, Person
from grader.result_folder import is_reserved
from grader.submission.collection import Collections
from grader.submission.extraction import SubmissionSource, names_in
from grader.submission.file_names import (
    displayed,
    is_packed,
    without_archive_suffix,
)
from grader.submission.last_commit import last_commit_time
from grader.submission.listing import Listing, listing_of
from grader.submission.lms.systems import Delivered, System, is_table, recognised
from grader.submission.roster import Match, Student, matches, read_class_list

#: Bytes of the longest name of a folder of results.
_MOST_NAME_BYTES = 120
#: Characters of a student's name that are read.
_MOST_NAME_CHARACTERS = 1000
#: Folders around the folders of versions.
_MOST_FOLDERS_OF_VERSIONS = 4
_VERSION = re.compile(r"Version (\d{1,4})")


#: A file in the results of an earlier grading.
_RESULT = "recordings/submission.json"
#: Names that a message lists.
_MOST_LISTED = 3


class Shape(Enum):
    """The meaning of a path, as the user states it."""

    AUTO = "auto"
    ONE = "one"
    EACH = "each"


@dataclass(frozen=True)
class Discovery:
    """The submissions that were found."""

    #: In the order of their names, each with a unique name.
    submissions: tuple[SubmissionSource, ...]
    #: A sentence about the meaning of each path.
    understood: tuple[str, ...] = ()
    #: Files that belong to no submission; the names are students', and must not be trusted.
    not_understood: tuple[str, ...] = ()
    #: Students of the class list without a submission.
    missing: tuple[str, ...] = ()
    #: Paths that may mean something else, with a remedy.
    doubts: tuple[str, ...] = ()


def find_submissions(
    paths: Sequence[Path],
    rubric: Rubric,
    *,
    shape: Shape = Shape.AUTO,
    class_list: Path | None = None,
) -> Discovery:
    """Find the submissions in folders, archives, and downloads of learning-management systems.

    A missing path becomes a submission that is refused when it is graded, and does not affect the others.

    A submission's name is made from the student's name alone and does not depend on other submissions, so that results
    are found again. Only equal names get a mark made from their paths. The time of submission comes from the class list,
    else from the download. The time of the last commit stands apart, because a student's own clock sets it; the time of
    the newest file in an archive is found when the archive is extracted.

    Raises
    ------
    SubmissionError
        If the class list (see `grader.submission.roster`) is not usable, or a class is packed twice.
    """
    search = _Search(rubric)
    for path in paths:
        search.look_at(path, shape)
    sources, marked = _uniquely_named(search.submissions)
    search.understood += marked
    missing: tuple[str, ...] = ()
    if class_list is not None:
        plain = {_origin(one): one.name for one in search.submissions}
        students = read_class_list(class_list)
        sources, missing, unclear = _with_class_list(sources, plain, students)
        search.understood += [*_unread_times(students), *unclear]
        all_are_missing = len(missing) == len(students)
        if sources and students and all_are_missing:
            _refuse_unknown_students(sources, class_list)
    return Discovery(
        tuple(sorted(sources, key=_by_name)),
        tuple(search.understood),
        tuple(search.not_understood),
        missing,
        tuple(search.doubts),
    )


def _by_name(source: SubmissionSource) -> tuple[str, str]:
    return source.name.casefold(), source.name


class _Search:
    """The submissions found so far."""

    def __init__(self, rubric: Rubric) -> None:
        self.submissions: list[SubmissionSource] = []
        self.understood: list[str] = []
        self.not_understood: list[str] = []
        self.doubts: list[str] = []
        self._collections = Collections(rubric)

    def look_at(self, path: Path, shape: Shape) -> None:
        """Add the submissions at a path."""
        listing = listing_of(path)
        if listing is None:
            source = SubmissionSource.of(path)
            self._add(source, source.name)
            return
        students = self._students(listing, shape)
        if students is None:
            self._add(_source_of(listing), listing.name)
            self.understood.append(f"{listing.location}: one submission")
            return
        download = None
        if not students.is_repository:
            download = recognised(students.entries)
        if download is not None:
            self._add_download(students, *download)
        else:
            self._add_each(students)

    def _students(self, listing: Listing, shape: Shape) -> Listing | None:
        """Return the folder with an entry for each student; None for a single submission."""
        if shape is Shape.ONE:
            return None
        if shape is Shape.EACH:
            self._refuse_packed_class(listing)
            return self._collections.each(listing)
        understood = self._collections.understood(listing)
        if understood.students is None:
            self._refuse_packed_class(listing)
            if understood.doubled:
                one, other = map(displayed, understood.doubled)
                self.doubts.append(
                    f"{listing.location}: taken as one submission, although {one}/ and {other}/ in it hold the same "
                    "file of the lab. If these are two students', add --each."
                )
        return understood.students

    def _refuse_packed_class(self, listing: Listing) -> None:
        """Raise SubmissionError if an archive holds only the archive of a class, which is not a single submission."""
        if listing.within is None or list(listing.entries.values()) != [False]:
            return
        (packed,) = listing.entries
        names = names_in(listing.path, listing.within + packed)
        if names is None:
            return
        inner = Listing(Path(packed), "", tuple(names))
        if self._collections.understood(inner).students is not None:
            raise SubmissionError(
                f"it holds an archive of several submissions, {displayed(packed)}",
                location=str(listing.path),
                remedy=f"Unpack it and give the path {displayed(packed)}; if all of it is one student's, add --one.",
            )

    # -- what is found -----------------------------------------------------------------------------

    def _add(self, source: SubmissionSource, name: str) -> None:
        self.submissions.append(replace(source, name=_safe_name(name)))

    def _add_each(self, listing: Listing) -> None:
        before = len(self.submissions)
        for name, is_folder in listing.entries.items():
            location = f"{listing.location}: {displayed(name)}"
            if is_folder and self._is_earlier_result(listing.below(name)):
                self.not_understood.append(f"{location}: results of an earlier grading")
            elif is_folder:
                self._add_folder(listing, name)
            elif is_packed(name):
                piece = listing.piece(name, is_folder=False)
                origin = f"{listing.origin}/{name}"
                source = SubmissionSource("", (piece,), location=location, origin=origin)
                self._add(source, without_archive_suffix(name))
            elif not is_table(name):
                self.not_understood.append(f"{location}: neither a folder nor an archive")
        amount = _submissions(len(self.submissions) - before)
        self.understood.append(f"{listing.location}: {amount}")

    def _add_folder(self, listing: Listing, name: str) -> None:
        """Add a folder among submissions, which can be one of GitHub Classroom with the user's login in its name."""
        folder = self._last_version(listing.below(name))
        self._doubt_several_in(folder)
        source = _source_of(folder)
        # For example `lab-09-submissions/lab-09-alice`.
        assignment = listing.name.removesuffix("-submissions")
        user = name.removeprefix(f"{assignment}-")
        if assignment != listing.name and user != name:
            identity = Identity((Person(login=user),))
            source = replace(source, student_id=user, identity=identity)
        self._add(source, name)

    def _doubt_several_in(self, listing: Listing) -> None:
        """Report a folder among submissions that seems to hold several, such as a folder of a section or a group."""
        students = self._collections.understood(listing).students
        inner = students.folders if students is not None else []
        if len(inner) > 1:
            one = displayed(inner[0])
            other = displayed(inner[1])
            self.doubts.append(
                f"{listing.location}: taken as one submission, although {one}/ and {other}/ in it look like "
                "submissions. If they are, grade that folder by its own path, unpacked."
            )

    def _is_earlier_result(self, listing: Listing) -> bool:
        """Return whether a folder holds results, and none of the lab's files; students may keep results beside these."""
        if self._collections.artifacts(listing.files):
            return False
        return any(file.endswith(_RESULT) for file in listing.files)

    def _last_version(self, listing: Listing) -> Listing:
        """Return the last of the folders `Version 1`, `Version 2`, ... of Microsoft Teams in a folder, else the folder."""
        inner = listing
        for _ in range(_MOST_FOLDERS_OF_VERSIONS):
            numbers = _version_numbers(inner)
            if numbers and len(numbers) == len(inner.entries):
                *earlier, last = sorted(numbers, key=lambda name: numbers[name])
                self._note_each(inner, earlier, "an earlier version")
                return inner.below(last)
            if list(inner.entries.values()) != [True]:
                break
            inner = inner.below(next(iter(inner.entries)))
        return listing

    def _add_download(
        self, listing: Listing, system: System, delivered: Mapping[str, Delivered]
    ) -> None:
        """Add the submissions in the download of a learning-management system, one for each student."""
        known = system.details(delivered, listing.texts)
        self._note_foreign(listing, system, known)
        students: dict[tuple[str, str], dict[str, Delivered]] = defaultdict(dict)
        for entry in listing.entries:
            if entry in known:
                upload = known[entry]
                students[upload.student, upload.student_id][entry] = upload
        for uploads in students.values():
            self._add_delivered(listing, system, uploads)
        amount = _submissions(len(students))
        self.understood.append(f"{listing.location}: {system.name}'s download of {amount}")

    def _add_delivered(
        self, listing: Listing, system: System, uploads: Mapping[str, Delivered]
    ) -> None:
        """Add the submission of one student."""
        first = next(iter(uploads.values()))
        people = first.people or (_person_in(system, first.student, first.student_id),)
        named = first.student
        if first.student_id and first.student_id != first.student:
            named = f"{first.student}_{first.student_id}"
        source = self._delivered(listing, uploads)
        identity = replace(source.identity, people=people, system=system.name)
        source = replace(
            source,
            student=first.student,
            student_id=first.student_id or None,
            identity=identity,
            location=f"{listing.location}: {displayed(named)}",
            origin=listing.origin,
        )
        if source.submitted_at is not None:
            source = replace(source, time_source=f"{system.name}'s download")
        if any(upload.late for upload in uploads.values()):
            source = replace(source, marked_late_by=system.name)
        self._add(source, named)

    def _note_foreign(
        self, listing: Listing, system: System, known: Mapping[str, Delivered]
    ) -> None:
        """Note the entries of a download that the system did not name, except tables."""
        for entry, is_a_folder in listing.entries.items():
            if entry in known or entry in system.own:
                continue
            if is_a_folder or not is_table(entry):
                described = f"{listing.location}: {displayed(entry)}: not named as {system.name} names files"
                self.not_understood.append(described)

    def _delivered(self, listing: Listing, entries: Mapping[str, Delivered]) -> SubmissionSource:
        """Return the submission of one student's uploads; of several attempts, the last."""
        times = [upload.attempt_at for upload in entries.values() if upload.attempt_at is not None]
        last = max(times, default=None)
        counted = {entry: upload for entry, upload in entries.items() if upload.attempt_at == last}
        earlier = [entry for entry in entries if entry not in counted]
        self._note_each(listing, earlier, "an earlier attempt")
        names: Counter[str] = Counter()
        handback = []
        for upload in counted.values():
            names.update({upload.file, upload.first_called})
            if upload.handback:
                handback.append(upload.handback)
        pieces = []
        for entry, upload in counted.items():
            if upload.file:
                name = upload.file
                if upload.first_called and names[upload.first_called] == 1:
                    name = upload.first_called
                pieces.append(listing.piece(entry, is_folder=False, name=name))
            elif listing.entries[entry]:
                pieces.append(listing.piece(entry))
        identity = Identity(handback=tuple(handback))
        return SubmissionSource("", tuple(pieces), submitted_at=last, identity=identity)

    def _note_each(self, listing: Listing, entries: Iterable[str], reason: str) -> None:
        """Note entries of a folder that are not used."""
        for entry in entries:
            self.not_understood.append(f"{listing.location}: {displayed(entry)}: {reason}")


def _version_numbers(listing: Listing) -> dict[str, int]:
    """Return the entries of a folder that are named as versions, such as `Version 2`, with their numbers."""
    numbers: dict[str, int] = {}
    for name in listing.entries:
        version = _VERSION.fullmatch(name)
        if version is not None:
            numbers[name] = int(version[1])
    return numbers


def _person_in(system: System, student: str, student_id: str) -> Person:
    """Return the person in the names of a system's files, for example a name with a login."""
    own = {system.id_is: student_id} if system.id_is else {}
    name = student if student != student_id else ""
    return Person(name, **own)


def _submissions(count: int) -> str:
    return "1 submission" if count == 1 else f"{count:,} submissions"


def _source_of(listing: Listing) -> SubmissionSource:
    """Return a submission, with the time of its last commit."""
    return SubmissionSource(
        "",
        (listing.piece(),),
        last_commit=_commit_time(listing),
        location=listing.location,
        origin=listing.origin,
    )


def _commit_time(listing: Listing) -> datetime | None:
    """Return the time of the last commit in a folder, or in its only folder; None if it is in the future."""
    if listing.within is not None:
        return None
    time = last_commit_time(listing.path)
    if time is None and len(listing.folders) == 1:
        time = last_commit_time(listing.path / listing.folders[0])
    if time is None or time > datetime.now(UTC):
        return None
    return time


# -- names -----------------------------------------------------------------------------------------


def _safe_name(text: str) -> str:
    """Return a name for a folder of results: letters, marks and numbers of any script, and `-_.+@`."""
    valid = text[:_MOST_NAME_CHARACTERS].encode("utf-8", "replace").decode()
    kept = []
    for character in unicodedata.normalize("NFC", valid):
        is_fit = character in "-_.+@" or unicodedata.category(character)[0] in "LMN"
        kept.append(character if is_fit else "_")
    name = re.sub(r"__+", "_", "".join(kept)).strip("._- ")
    if len(name.encode()) > _MOST_NAME_BYTES:
        cut = name.encode()[: _MOST_NAME_BYTES - 7].decode("utf-8", "ignore")
        name = f"{cut}-{_mark(text)}"
    return name or f"submission-{_mark(text)}"


def _mark(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:6]


def _origin(source: SubmissionSource) -> str:
    """Return the locations of a submission's pieces, independent of the way that the path was typed."""
    places = [f"{os.path.realpath(piece.path)}\n{piece.member}" for piece in source.pieces]
    return "\n".join(places)


def _uniquely_named(
    submissions: Sequence[SubmissionSource],
) -> tuple[list[SubmissionSource], list[str]]:
    """Drop repeated submissions, and mark equal names, and names of the grader's own files among results.

    Returns the submissions, and a remark about each mark.
    """
    last: dict[tuple[str, str], SubmissionSource] = {}
    for source in reversed(submissions):
        last[_origin(source), source.name] = source
    distinct = list(last.values())
    distinct.reverse()
    names = Counter(source.name.casefold() for source in distinct)
    named = []
    remarks = []
    for source in distinct:
        plain = source.name
        among_results = is_reserved(plain)
        if among_results or names[plain.casefold()] > 1:
            source = replace(source, name=f"{plain}-{_mark(_origin(source))}")
            why = f"there is another {plain}"
            if among_results:
                why = f"{plain} is a name for the grader's own files"
            remarks.append(f"{source.location}: called {source.name}, because {why}")
        named.append(source)
    return named, remarks


def _refuse_unknown_students(submissions: Sequence[SubmissionSource], class_list: Path) -> None:
    """Raise SubmissionError because no student of a class list is among the submissions."""
    some = _first_of([source.name for source in submissions])
    raise SubmissionError(
        f"nobody on the class list is among the {_submissions(len(submissions))} ({some})",
        location=str(class_list),
        remedy="Is it the list of this class? If the submissions were told apart wrongly, add --each or --one; "
        "to grade without a list, leave --class-list out.",
    )


def _with_class_list(
    submissions: Sequence[SubmissionSource], names: Mapping[str, str], students: Sequence[Student]
) -> tuple[list[SubmissionSource], tuple[str, ...], list[str]]:
    """Add the facts of a class list to submissions.

    Parameters
    ----------
    submissions
        The submissions.
    names
        Names without a mark, by the indexes of the submissions.
    students
        The class list.

    Returns
    -------
    The submissions; the missing students; a remark about each submission without a certain student.
    """
    items = []
    for source in submissions:
        bearer = Student(
            source.name, source.student_id, source.submitted_at, time_source=source.time_source
        )
        others = (source.student, names[_origin(source)], *source.identity.names)
        items.append((bearer, others))
    named = []
    unclear = []
    there: set[int] = set()
    for source, match in zip(submissions, matches(students, items), strict=True):
        there |= match.may_be
        remark = _unclear(source, match, students)
        if remark:
            unclear.append(remark)
        known = replace(
            source,
            student_id=match.student_id,
            submitted_at=match.submitted_at,
            time_source=match.time_source,
            identity=match.completed(source.identity),
        )
        named.append(known)
    missing = []
    for index, student in enumerate(students):
        if index not in there:
            missing.append(displayed(student.shown))
    return named, tuple(missing), unclear


def _first_of(names: Sequence[str]) -> str:
    """Return the first names of a list, such as "alice, bob, carol, ..."."""
    first = ", ".join(names[:_MOST_LISTED])
    if len(names) > _MOST_LISTED:
        return f"{first}, ..."
    return first


def _unread_times(students: Sequence[Student]) -> list[str]:
    """Return a sentence about the times of a worksheet that could not be read; none if all were."""
    unread = [student.unread_time for student in students if student.unread_time]
    if not unread:
        return []
    if len(unread) == 1:
        count = "1 time"
    else:
        count = f"{len(unread)} times"
    first = displayed(unread[0])
    return [
        f"The class list has {count} that could not be read, such as {first!r}; a column "
        "submitted_at can give them as 2026-03-02T23:41:00+01:00."
    ]


def _unclear(source: SubmissionSource, match: Match, students: Sequence[Student]) -> str:
    """Name the possible students of a submission on a class list; empty if the student is certain."""
    if match.people:
        return ""
    if not match.may_be:
        return f"{source.location}: nobody on the class list has this name, login or id"
    names = [displayed(students[index].shown) for index in sorted(match.may_be)]
    problem = "the name alone does not say who of the class list this is"
    return f"{source.location}: {problem} ({_first_of(names)})"
