"""Paths on the command line → the submissions that they stand for.

How one submission is told from a folder (or archive) of submissions
---------------------------------------------------------------------
An *artifact's file* is one whose name the rubric asks for, word for word. A *part* is a folder named as parts of a
workspace are (`src`, `launch`, `old`), or one of several that are numbered (`task2`). The first that applies decides:

1. Most names are those of a learning-management system's download (`grader.submission.lms`): each student is one.
2. It is a git repository's root, or an artifact's file lies directly in it: one submission. In a folder that is called
   as folders of submissions are (`submissions`, `lab-09-submissions`, `students`), that does not matter if 3 holds:
   an instructor's repository, a stray file.
3. The same artifact's file lies in two subfolders that are no parts: each subfolder and archive is one. In a single
   workspace each file lies in one package; in a class everyone has handed in the same names.
4. It looks like a package or a workspace (`package.xml`, `setup.py`, `CMakeLists.txt`, or a part that holds an
   artifact's file): one submission.
5. Patterns of the rubric find the same artifact in two folders that are no parts nor both packages, one of which holds
   no artifact's file and other programs, and no README lies beside: the launch files of two labs. Each is one.
6. There are several archives, or several folders that are no parts and hold archives and no programs, or it is called
   as folders of submissions are: each subfolder and archive is one.
7. It holds a single folder, and no files but tables: what that folder is. If that is one submission, it is called as
   the outer.
8. An archive lies beside a folder with artifacts' files, without a README: each is one.
9. One submission.

Where this is wrong, `Shape.ONE` and `Shape.EACH` say what is meant. Hidden files and folders, those of tools, tables
are passed over; earlier results (without any of the lab's files), and files that belong to nobody, are told.
"""

from __future__ import annotations

import hashlib
import os
import re
import unicodedata
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from enum import Enum
from functools import cached_property
from itertools import chain, islice
from pathlib import Path, PurePosixPath

from grader import result_folder
from grader.errors import SubmissionError
from grader.lab.kept_lab import KEPT
from grader.lab.overrides import OVERRIDES_FILE
from grader.lab.rubric import Rubric
from grader.recording.submission import Identity, Person
from grader.result_folder import AUDIT_FILE, CHANGES_FILE, HISTORY, JOURNAL_FILE
from grader.submission.artifacts import by_pattern, names_of
from grader.submission.extraction import Piece, SubmissionSource, names_in, text_of, texts_in
from grader.submission.file_names import (
    TOOL_FOLDERS,
    displayed,
    is_litter,
    is_packed,
    without_archive_suffix,
)
from grader.submission.last_commit import last_commit_time
from grader.submission.lms.systems import Delivered, System, is_table, recognised
from grader.submission.members import is_folder
from grader.submission.roster import Student, matches, read_class_list

#: Names in one submission that are looked at to tell what it is.
_MOST_NAMES = 5_000
_MOST_DEPTH = 12
#: Names directly in a folder of submissions.
_MOST_ENTRIES = 1_000_000
#: Folders within each other that hold nothing else.
_MOST_WRAPPERS = 4
_MOST_NAME_BYTES = 120
#: What lies among results, or in those of one submission, and is no submission's folder.
TAKEN_NAMES = frozenset(
    {JOURNAL_FILE, OVERRIDES_FILE, "overrides.yml", CHANGES_FILE, AUDIT_FILE, HISTORY, KEPT}
    | {name for constant, name in vars(result_folder).items() if constant.isupper()}
)

_PART = re.compile(
    r"src|sources?|code|launch|config|params?|scripts?|nodes?|packages?|include|resource|msg|srv"
    # Others before `_ws` are names of students.
    r"|((ros2?|colcon|catkin|ament|dev|my|old|new|final|backup|test|tutorial|robot\w*|lab[\w-]*)_)?ws"
    r"|ros2?|workspace|old|backups?|bak|archive",
    re.IGNORECASE,
)
#: Longer numbers are those of students.
_SECTION = re.compile(
    r"(v|version|part|task|exercise|ex|q|question|lab|week|hw|assignment)[-_ ]?\d{1,3}([-_.]\d{1,3})*",
    re.IGNORECASE,
)
_COLLECTION = re.compile(
    r"(^|[-_ ])(submissions|students|hand-?ins|abgaben)($|[-_ (])", re.IGNORECASE
)
_VERSION = re.compile(r"Version (\d{1,4})")
_PACKAGE_MARKS = frozenset({"package.xml", "setup.py", "CMakeLists.txt"})
_PROGRAMS = frozenset({".py", ".c", ".cc", ".cpp", ".launch"})
#: What a system writes beside submissions is read up to so many bytes.
_MOST_NOTES_BYTES = 64 * 1024**2


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
        sources, missing, unclear = _with_class_list(sources, plain, read_class_list(class_list))
        search.understood += unclear
    ordered = tuple(sorted(sources, key=lambda source: (source.name.casefold(), source.name)))
    return Discovery(ordered, tuple(search.understood), tuple(search.not_understood), missing)


@dataclass(frozen=True)
class _Listing:
    """A folder, or one within an archive, and the names of the files in it."""

    path: Path
    #: The folder within the archive, with a slash at its end; empty for the archive itself, None for a folder.
    within: str | None
    #: Paths relative to it.
    files: tuple[str, ...]

    @property
    def name(self) -> str:
        if self.within:
            return PurePosixPath(self.within).name
        name = Path(os.path.realpath(self.path)).name
        return name if self.within is None else without_archive_suffix(name)

    @property
    def location(self) -> str:
        return f"{self.path}: {displayed(self.within)}" if self.within else str(self.path)

    @property
    def origin(self) -> str:
        """Where it lies, the same however the path was typed."""
        path = os.path.realpath(self.path)
        return f"{path}: {self.within}" if self.within else path

    @property
    def is_repository(self) -> bool:
        return any(file.startswith(".git/") for file in self.files)

    @cached_property
    def _grouped(self) -> dict[str, tuple[str, ...]]:
        """What lies directly in it -> the paths below that; none below a file."""
        groups: dict[str, list[str]] = defaultdict(list)
        for file in self.files:
            first, slash, rest = file.partition("/")
            if first:
                groups[first] += [rest] if slash else []
        return {name: tuple(below) for name, below in groups.items()}

    @cached_property
    def entries(self) -> dict[str, bool]:
        """What lies directly in it -> whether that is a folder; without what nobody hands in."""
        return {
            name: bool(below)
            for name, below in sorted(self._grouped.items())
            if not (name.startswith(".") or is_litter(name) or (below and name in TOOL_FOLDERS))
        }

    def below(self, folder: str) -> _Listing:
        inside = self._grouped[folder]
        if self.within is None:
            return _Listing(self.path / folder, None, inside)
        return _Listing(self.path, f"{self.within}{folder}/", inside)

    def texts(self, files: Sequence[str]) -> dict[str, str]:
        """Read files below it; what cannot be read is left out."""
        if self.within is not None:
            members = {self.within + file: file for file in files}
            return {
                members[m]: text
                for m, text in texts_in(self.path, members, _MOST_NOTES_BYTES).items()
            }
        read = {file: text_of(self.path, file, _MOST_NOTES_BYTES) for file in files}
        return {file: text for file, text in read.items() if text is not None}

    def piece(self, entry: str = "", *, is_folder: bool = True, name: str = "") -> Piece:
        """Return what lies in it, or one entry."""
        if self.within is None:
            return Piece(self.path / entry if entry else self.path, name=name)
        member = self.within + entry + ("/" if entry and is_folder else "")
        return Piece(self.path, member, name)


def _listing_of(path: Path) -> _Listing | None:
    """Look at a path; None if it is neither a folder nor an archive that can be read."""
    if is_folder(path):
        return _Listing(path, None, tuple(_names_below(path)))
    inside = names_in(path)
    return None if inside is None else _Listing(path, "", tuple(inside))


def _names_below(path: Path) -> Iterator[str]:
    for name, inside in _listed(path, _MOST_ENTRIES):
        if not inside:
            yield name
        else:
            yield from list(_walk(path / name, f"{name}/")) or [f"{name}/"]


def _walk(folder: Path, above: str) -> Iterator[str]:
    """Name the files of a folder, as many as it takes to tell what it is."""
    waiting = deque([(folder, above, 1)] if folder.name not in TOOL_FOLDERS else [])
    seen = 0
    while waiting and seen < _MOST_NAMES:
        folder, above, depth = waiting.popleft()
        for name, inside in _listed(folder):
            seen += 1
            if not inside:
                yield above + name
            elif depth < _MOST_DEPTH and name not in TOOL_FOLDERS:
                waiting.append((folder / name, f"{above}{name}/", depth + 1))


def _listed(folder: Path, most: int = _MOST_NAMES) -> list[tuple[str, bool]]:
    """Return the names in a folder, and whether each is a folder; none if it may not be read."""
    with suppress(OSError), os.scandir(folder) as entries:
        return sorted(
            (entry.name, entry.is_dir(follow_symlinks=False)) for entry in islice(entries, most)
        )
    return []


class _Search:
    """What has been found so far."""

    def __init__(self, rubric: Rubric) -> None:
        self.submissions: list[SubmissionSource] = []
        self.understood: list[str] = []
        self.not_understood: list[str] = []
        self._specs = rubric.artifacts
        self._wanted = {name: names_of(spec) for name, spec in rubric.artifacts.items()}

    def look_at(self, path: Path, shape: Shape) -> None:
        """Add the submissions that a path stands for."""
        listing = _listing_of(path)
        if listing is None:
            self._add(SubmissionSource.of(path), SubmissionSource.of(path).name)
            return
        students = self._students(listing, shape) if shape is not Shape.ONE else None
        if students is None:
            if shape is not Shape.ONE:
                self._refuse_packed_class(listing)
            self._add(_source_of(listing), listing.name)
            self.understood.append(f"{listing.location}: one submission")
        elif not students.is_repository and (download := recognised(students.entries)) is not None:
            self._add_download(students, *download)
        else:
            self._add_each(students)

    def _refuse_packed_class(self, listing: _Listing) -> None:
        """Raise if an archive holds only the archive of a class, all of which would be taken for one student's."""
        if listing.within is None or list(listing.entries.values()) != [False]:
            return
        (packed,) = listing.entries
        names = names_in(listing.path, listing.within + packed)
        inner = _Listing(Path(packed), "", tuple(names)) if names is not None else None
        if inner is not None and self._students(inner, Shape.AUTO) is not None:
            raise SubmissionError(
                f"it holds an archive of several submissions, {displayed(packed)}",
                location=str(listing.path),
                remedy=f"Unpack it and give the path {displayed(packed)}; if all of it is one student's, add --one.",
            )

    def _students(self, listing: _Listing, shape: Shape) -> _Listing | None:
        """Return where the students lie beside each other; None if it is one submission."""
        if shape is Shape.EACH:
            return listing
        for _ in range(_MOST_WRAPPERS):
            entries = listing.entries
            decided = self._is_collection(listing, entries)
            if decided is not None:
                return listing if decided else None
            inner = [name for name, folder in entries.items() if folder or not is_table(name)]
            if len(inner) != 1 or not entries[inner[0]]:
                break
            listing = listing.below(inner[0])
        return None

    def _is_collection(self, listing: _Listing, entries: Mapping[str, bool]) -> bool | None:
        """Apply the rules that are stated above; None if none applies."""
        own = self._artifacts(name for name, folder in entries.items() if not folder)
        # What a system writes beside submissions lies in no repository, and beside no student's files.
        download = recognised(entries)
        if (
            download is not None
            and not listing.is_repository
            and not (own and download[0].own & entries.keys())
        ):
            return True
        folders = [name for name, folder in entries.items() if folder]
        held = {name: self._artifacts(listing.below(name).files) for name in folders}
        sections = {name for name in folders if _SECTION.fullmatch(name) and len(entries) > 1}
        parts = {name for name in folders if _PART.fullmatch(name)} | sections
        students = {name: artifacts for name, artifacts in held.items() if name not in parts}
        archives = [name for name, folder in entries.items() if not folder and is_packed(name)]
        sealed = [
            name
            for name in folders
            if name not in parts and _holds_archives_only(listing.below(name).files)
        ]
        named_so = _COLLECTION.search(listing.name) is not None
        alike = _share_one(students.values())
        if (listing.is_repository or own) and not (named_so and alike):
            return False
        if alike:
            return True
        if _PACKAGE_MARKS & set(entries) or any(held[name] for name in parts):
            return False
        alone = not any(name.lower().startswith("readme") for name in entries)
        if alone and self._of_several_labs([listing.below(name) for name in students]):
            return True
        if len(archives) > 1 or len(sealed) > 1 or (named_so and (folders or archives)):
            return True
        return alone if archives and any(students.values()) else None

    def _of_several_labs(self, students: Sequence[_Listing]) -> bool:
        foreign, found = False, []
        for student in students:
            paths = [PurePosixPath(file) for file in student.files]
            facts = [by_pattern(name, spec, paths) for name, spec in self._specs.items()]
            found.append(frozenset(fact.name for fact in facts if fact.path is not None))
            programs = {str(path) for path in paths if path.suffix in _PROGRAMS}
            programs.difference_update(*([fact.path, *fact.candidates] for fact in facts))
            foreign |= bool(found[-1] and programs) and not self._artifacts(student.files)
        packages = all(_PACKAGE_MARKS & student.entries.keys() for student in students)
        return foreign and not packages and _share_one(found)

    def _artifacts(self, files: Iterable[str]) -> frozenset[str]:
        names = {PurePosixPath(file).name for file in files}
        return frozenset(artifact for artifact, wanted in self._wanted.items() if wanted & names)

    # -- what is found -----------------------------------------------------------------------------

    def _add(self, source: SubmissionSource, name: str) -> None:
        self.submissions.append(replace(source, name=_safe_name(name)))

    def _add_each(self, listing: _Listing) -> None:
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
                source = _source_of(self._last_version(listing.below(name)))
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

    def _is_earlier_result(self, listing: _Listing) -> bool:
        """Whether a folder holds results, and none of the lab's files, which a student may keep beside such."""
        return any(file.endswith(_RESULT) for file in listing.files) and not self._artifacts(
            listing.files
        )

    def _last_version(self, listing: _Listing) -> _Listing:
        """Return the last of the folders `Version 1`, `Version 2`, ... that Microsoft Teams makes, if it holds such."""
        inner = listing
        for _ in range(_MOST_WRAPPERS):
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
        self, listing: _Listing, system: System, delivered: Mapping[str, Delivered]
    ) -> None:
        students: dict[tuple[str, str], dict[str, Delivered]] = defaultdict(dict)
        known = system.details(delivered, listing.texts)
        for entry, is_a_folder in listing.entries.items():
            if entry in known:
                students[known[entry].student, known[entry].student_id][entry] = known[entry]
            elif entry not in system.own and (is_a_folder or not is_table(entry)):
                described = f"{listing.location}: {displayed(entry)}: not named as {system.name} names files"
                self.not_understood.append(described)
        for (student, student_id), entries in students.items():
            source = self._delivered(listing, entries)
            named = (
                student if student == student_id or not student_id else f"{student}_{student_id}"
            )
            described = f"{listing.location}: {displayed(named)}"
            own = {system.id_is: student_id} if system.id_is else {}
            people = next(iter(entries.values())).people or (
                Person(student if student != student_id else "", **own),
            )
            identity = replace(source.identity, people=people, system=system.name)
            source = replace(
                source, student=student, student_id=student_id or None, identity=identity
            )
            self._add(replace(source, location=described, origin=listing.origin), named)
        amount = _submissions(len(students))
        self.understood.append(f"{listing.location}: {system.name}'s download of {amount}")

    def _delivered(self, listing: _Listing, entries: Mapping[str, Delivered]) -> SubmissionSource:
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


def _holds_archives_only(files: Iterable[str]) -> bool:
    """Whether files are what somebody hands in who packs: an archive, and no program beside it."""
    names = [PurePosixPath(file) for file in files]
    return any(is_packed(name.name) for name in names) and not any(
        name.suffix in _PROGRAMS for name in names
    )


def _share_one(held: Iterable[frozenset[str]]) -> bool:
    """Whether the same artifact is in two of them."""
    return any(count > 1 for count in Counter(chain.from_iterable(held)).values())


def _submissions(count: int) -> str:
    return f"{count:,} submission{'' if count == 1 else 's'}"


def _source_of(listing: _Listing) -> SubmissionSource:
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
        "", (listing.piece(),), submitted_at=time, location=listing.location, origin=listing.origin
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
        among_results = plain.casefold() in TAKEN_NAMES
        if among_results or names[plain.casefold()] > 1:
            source = replace(source, name=f"{plain}-{_mark(_origin(source))}")
            others = " among results" if among_results else ""
            remarks.append(
                f"{source.location}: called {source.name}, since there is another {plain}{others}"
            )
        named.append(source)
    return named, remarks


def _with_class_list(
    submissions: Sequence[SubmissionSource], names: Mapping[str, str], students: Sequence[Student]
) -> tuple[list[SubmissionSource], tuple[str, ...], list[str]]:
    """Add what a class list knows; returns who is missing, and whose lines are not told apart, too.

    `names` are those without a mark, by where each submission lies.
    """
    items = [
        (
            Student(s.name, s.student_id, s.submitted_at),
            (s.student, names[_origin(s)], *s.identity.names),
        )
        for s in submissions
    ]
    found = list(zip(submissions, matches(students, items), strict=True))
    unclear = [
        f"{source.location}: the name alone does not say who of the class list this is"
        for source, match in found
        if match.may_be and not match.people
    ]
    there = frozenset[int]().union(*(match.may_be for _, match in found))
    missing = tuple(
        displayed(s.name or s.student_id or s.person.login)
        for n, s in enumerate(students)
        if n not in there
    )
    named = [
        replace(
            source,
            student_id=match.student_id,
            submitted_at=match.submitted_at,
            identity=match.completed(source.identity),
        )
        for source, match in found
    ]
    return named, missing, unclear
