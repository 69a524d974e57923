"""Paths on the command line → the submissions that they stand for.

How one submission is told from a folder of submissions stands in `grader.submission.collection`; where that is wrong,
`Shape.ONE` and `Shape.EACH` say what is meant. Hidden files and folders, those of tools, tables are passed over; earlier
results (without any of the lab's files), and files that belong to nobody, are told.
"""

from __future__ import annotations

import hashlib
import os
import re
import unicodedata
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone
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

_MOST_NAME_BYTES = 120
#: Folders around those of versions.
_MOST_FOLDERS_OF_VERSIONS = 4
_VERSION = re.compile(r"Version (\d{1,4})")


class Shape(Enum):
    """What a path stands for, where the user says so."""

    AUTO = "auto"
    ONE = "one"
    EACH = "each"


@dataclass(frozen=True)
class Discovery:
    """The submissions that were found."""

    #: In the order of their names, each under a name of its own.
    submissions: tuple[SubmissionSource, ...]
    #: What each path was taken for, in words.
    understood: tuple[str, ...] = ()
    #: Files that belong to no submission; written by students, so not to be trusted.
    not_understood: tuple[str, ...] = ()
    #: Who is in the class list and has not handed in.
    missing: tuple[str, ...] = ()
    #: Paths that may stand for something else, with what to do then.
    doubts: tuple[str, ...] = ()


def find_submissions(
    paths: Sequence[Path],
    rubric: Rubric,
    *,
    shape: Shape = Shape.AUTO,
    class_list: Path | None = None,
) -> Discovery:
    """Find the submissions in folders, archives, and downloads of learning-management systems.

    A path that is not there stands for itself: it is refused when it is graded, and does not keep the others from it.
    Raises SubmissionError if the class list (see `grader.submission.roster`) is not usable, or a class is packed twice.

    A name is made from the student's alone and does not depend on who else has handed in, so that results are found
    again. Only where two would be the same, they get a mark made from their paths. The time of submission is that of
    the class list, else of the download, else of the last commit. An archive's own is found when it is extracted.
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
        if sources and students and len(missing) == len(students):
            _refuse_unknown_students(sources, class_list)
    ordered = tuple(sorted(sources, key=lambda source: (source.name.casefold(), source.name)))
    return Discovery(
        ordered,
        tuple(search.understood),
        tuple(search.not_understood),
        missing,
        tuple(search.doubts),
    )


class _Search:
    """What has been found so far."""

    def __init__(self, rubric: Rubric) -> None:
        self.submissions: list[SubmissionSource] = []
        self.understood: list[str] = []
        self.not_understood: list[str] = []
        self.doubts: list[str] = []
        self._collections = Collections(rubric)

    def look_at(self, path: Path, shape: Shape) -> None:
        """Add the submissions that a path stands for."""
        listing = listing_of(path)
        if listing is None:
            self._add(SubmissionSource.of(path), SubmissionSource.of(path).name)
            return
        students = self._students(listing, shape)
        if students is None:
            self._add(_source_of(listing), listing.name)
            self.understood.append(f"{listing.location}: one submission")
        elif not students.is_repository and (download := recognised(students.entries)) is not None:
            self._add_download(students, *download)
        else:
            self._add_each(students)

    def _students(self, listing: Listing, shape: Shape) -> Listing | None:
        """Return where students lie beside each other; None if it is one submission."""
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
        """Raise if an archive holds only the archive of a class, all of which would be taken for one student's."""
        if listing.within is None or list(listing.entries.values()) != [False]:
            return
        (packed,) = listing.entries
        names = names_in(listing.path, listing.within + packed)
        inner = Listing(Path(packed), "", tuple(names)) if names is not None else None
        if inner is not None and self._collections.understood(inner).students is not None:
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
        for name, folder in listing.entries.items():
            if folder and self._is_earlier_result(listing.below(name)):
                self.not_understood.append(
                    f"{listing.location}: {displayed(name)}: results of an earlier grading"
                )
            elif folder:
                # GitHub Classroom's `lab-09-submissions/lab-09-alice` names the user.
                assignment = listing.name.removesuffix("-submissions")
                user = name.removeprefix(f"{assignment}-") if assignment != listing.name else name
                folder_of_one = self._last_version(listing.below(name))
                self._doubt_several_in(folder_of_one)
                source = _source_of(folder_of_one)
                identity = Identity((Person(login=user),))
                self._add(
                    replace(source, student_id=user, identity=identity) if user != name else source,
                    name,
                )
            elif is_packed(name):
                piece = listing.piece(name, is_folder=False)
                location, origin = (
                    f"{listing.location}: {displayed(name)}",
                    f"{listing.origin}/{name}",
                )
                source = SubmissionSource("", (piece,), location=location, origin=origin)
                self._add(source, without_archive_suffix(name))
            elif not is_table(name):
                self.not_understood.append(
                    f"{listing.location}: {displayed(name)}: neither a folder nor an archive"
                )
        self.understood.append(
            f"{listing.location}: {_submissions(len(self.submissions) - before)}"
        )

    def _doubt_several_in(self, listing: Listing) -> None:
        """Tell of a folder among submissions that holds several itself, as that of a section or a group does."""
        students = self._collections.understood(listing).students
        inner = [name for name, folder in students.entries.items() if folder] if students else []
        if len(inner) > 1:
            one, other, *_ = map(displayed, inner)
            self.doubts.append(
                f"{listing.location}: taken as one submission, although {one}/ and {other}/ in it look like "
                "submissions. If they are, grade that folder by its own path, unpacked."
            )

    def _is_earlier_result(self, listing: Listing) -> bool:
        """Whether a folder holds results, and none of the lab's files, which a student may keep beside such."""
        return any(
            file.endswith(_RESULT) for file in listing.files
        ) and not self._collections.artifacts(listing.files)

    def _last_version(self, listing: Listing) -> Listing:
        """Return the last of the folders `Version 1`, `Version 2`, ... that Microsoft Teams makes, if it holds such."""
        inner = listing
        for _ in range(_MOST_FOLDERS_OF_VERSIONS):
            versions = {name: _VERSION.fullmatch(name) for name in inner.entries}
            numbers = {
                name: int(version[1]) for name, version in versions.items() if version is not None
            }
            if numbers and len(numbers) == len(versions):
                *earlier, last = sorted(numbers, key=lambda name: numbers[name])
                self.not_understood += [
                    f"{inner.location}: {displayed(name)}: an earlier version" for name in earlier
                ]
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
        for (student, student_id), entries in students.items():
            source = self._delivered(listing, entries)
            people = next(iter(entries.values())).people
            if not people:
                people = (_person_in(system, student, student_id),)
            named = student
            if student_id and student_id != student:
                named = f"{student}_{student_id}"
            source = replace(
                source,
                student=student,
                student_id=student_id or None,
                identity=replace(source.identity, people=people, system=system.name),
                location=f"{listing.location}: {displayed(named)}",
                origin=listing.origin,
            )
            if source.submitted_at is not None:
                source = replace(source, time_source=f"{system.name}'s download")
            self._add(source, named)
        amount = _submissions(len(students))
        self.understood.append(f"{listing.location}: {system.name}'s download of {amount}")

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
        """Put together what one student has handed in: of several attempts, the last."""
        last = max(
            (upload.attempt_at for upload in entries.values() if upload.attempt_at is not None),
            default=None,
        )
        counted = {entry: upload for entry, upload in entries.items() if upload.attempt_at == last}
        earlier = [entry for entry in entries if entry not in counted]
        self.not_understood += [
            f"{listing.location}: {displayed(entry)}: an earlier attempt" for entry in earlier
        ]
        names = Counter(
            name for upload in counted.values() for name in {upload.file, upload.first_called}
        )
        pieces = []
        for entry, upload in counted.items():
            if upload.file:
                name = (
                    upload.first_called
                    if upload.first_called and names[upload.first_called] == 1
                    else upload.file
                )
                pieces.append(listing.piece(entry, is_folder=False, name=name))
            elif listing.entries[entry]:
                pieces.append(listing.piece(entry))
        identity = Identity(
            handback=tuple(upload.handback for upload in counted.values() if upload.handback)
        )
        late = any(upload.late for upload in entries.values())
        return SubmissionSource("", tuple(pieces), submitted_at=last, late=late, identity=identity)


#: By this, the results of an earlier grading are known.
_RESULT = "recordings/submission.json"


def _person_in(system: System, student: str, student_id: str) -> Person:
    """Return the person whom the names of a system's files tell, e.g. a name with a login."""
    own = {system.id_is: student_id} if system.id_is else {}
    return Person(student if student != student_id else "", **own)


def _submissions(count: int) -> str:
    return f"{count:,} submission{'' if count == 1 else 's'}"


def _source_of(listing: Listing) -> SubmissionSource:
    """Return a submission, with the time of its last commit unless that is yet to come: such a clock was wrong."""
    time = None
    if listing.within is None:
        folders = [name for name, folder in listing.entries.items() if folder]
        inner = [listing.path / folders[0]] if len(folders) == 1 else []
        time = next(
            (found for folder in (listing.path, *inner) if (found := last_commit_time(folder))),
            None,
        )
        time = None if time is not None and time > datetime.now(timezone.utc) else time
    return SubmissionSource(
        "",
        (listing.piece(),),
        submitted_at=time,
        time_source="the last commit" if time is not None else "",
        location=listing.location,
        origin=listing.origin,
    )


# -- names -----------------------------------------------------------------------------------------


def _safe_name(text: str) -> str:
    """Return a name for a folder of results: letters, marks and numbers of any script, and `-_.+@`."""
    composed = unicodedata.normalize("NFC", text[:1000].encode("utf-8", "replace").decode())
    kept = "".join(
        c if c in "-_.+@" or unicodedata.category(c)[0] in "LMN" else "_" for c in composed
    )
    name = re.sub(r"__+", "_", kept).strip("._- ")
    if len(name.encode()) > _MOST_NAME_BYTES:
        cut = name.encode()[: _MOST_NAME_BYTES - 7].decode("utf-8", "ignore")
        name = f"{cut}-{_mark(text)}"
    return name or f"submission-{_mark(text)}"


def _mark(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:6]


def _origin(source: SubmissionSource) -> str:
    """Return where a submission's pieces lie; the same however the path was typed."""
    return "\n".join(f"{os.path.realpath(piece.path)}\n{piece.member}" for piece in source.pieces)


def _uniquely_named(
    submissions: Sequence[SubmissionSource],
) -> tuple[list[SubmissionSource], list[str]]:
    """Drop what was given twice, and tell those of the same name apart, and from what else lies among results.

    Returns the submissions, and for a person which of them got a mark.
    """
    distinct = list(
        {(_origin(source), source.name): source for source in reversed(submissions)}.values()
    )[::-1]
    names = Counter(source.name.casefold() for source in distinct)
    named, remarks = [], []
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
    """Raise because nobody of a class list is among those that handed in: one of the two is not what it seems."""
    some = ", ".join(source.name for source in submissions[:3])
    more = ", ..." if len(submissions) > 3 else ""
    raise SubmissionError(
        f"nobody on the class list is among the {_submissions(len(submissions))} ({some}{more})",
        location=str(class_list),
        remedy="Is it the list of this class? If the submissions were told apart wrongly, add --each or --one; "
        "to grade without a list, leave --class-list out.",
    )


def _with_class_list(
    submissions: Sequence[SubmissionSource], names: Mapping[str, str], students: Sequence[Student]
) -> tuple[list[SubmissionSource], tuple[str, ...], list[str]]:
    """Add what a class list knows; returns who is missing, and whose lines are not told apart, too.

    `names` are those without a mark, by where each submission lies.
    """
    items = [
        (
            Student(s.name, s.student_id, s.submitted_at, time_source=s.time_source),
            (s.student, names[_origin(s)], *s.identity.names),
        )
        for s in submissions
    ]
    found = list(zip(submissions, matches(students, items), strict=True))
    remarks = [_unclear(source, match, students) for source, match in found]
    there = frozenset[int]().union(*(match.may_be for _, match in found))
    missing = tuple(
        displayed(student.shown) for n, student in enumerate(students) if n not in there
    )
    named = [
        replace(
            source,
            student_id=match.student_id,
            submitted_at=match.submitted_at,
            time_source=match.time_source,
            identity=match.completed(source.identity),
        )
        for source, match in found
    ]
    unclear = [remark for remark in remarks if remark]
    return named, missing, unclear


def _unread_times(students: Sequence[Student]) -> list[str]:
    """Say which times in a worksheet could not be read."""
    unread = [student.unread_time for student in students if student.unread_time]
    if not unread:
        return []
    count = f"{len(unread)} time{'s' * (len(unread) != 1)}"
    first = displayed(unread[0])
    return [
        f"The class list has {count} that could not be read, such as {first!r}; a column "
        "submitted_at can give them as 2026-03-02T23:41:00+01:00."
    ]


def _unclear(source: SubmissionSource, match: Match, students: Sequence[Student]) -> str:
    """Say of whom in a class list a submission may be if that is not certain; empty if it is."""
    if match.people:
        return ""
    if not match.may_be:
        return f"{source.location}: nobody on the class list has this name, login or id"
    names = [displayed(students[index].shown) for index in sorted(match.may_be)]
    more = ", ..." if len(names) > 3 else ""
    return (
        f"{source.location}: the name alone does not say who of the class list this is "
        f"({', '.join(names[:3])}{more})"
    )
