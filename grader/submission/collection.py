"""Tells one submission from a folder (or archive) of submissions, by the names in it.

An *artifact's file* has exactly the name that the rubric asks for. A *part* is a folder with the usual name of a part
of a workspace (`src`, `launch`), or one of several named as versions, sections or demonstrations (`old`, `task2`,
`demo`). A *package* is a folder with its own name in its package.xml. The first rule that applies decides:

1. Most names are those of a learning-management system's download (`grader.submission.lms`): one submission for each
   student.
2. The folder is the root of a git repository, or directly contains an artifact's file: one submission. In a folder
   named as a folder of submissions (`submissions`, `lab-09-submissions`, `Abgaben`), rule 3 has priority: the
   repository can be an instructor's, and the file a stray one.
3. The same artifact's file is in two subfolders that are neither parts nor packages: each subfolder and archive is
   a submission. In a single workspace, each file is in one package; in a class, all students submit the same names.
   Packages count as students only if three hold the same file, or two hold all files of all packages, and more than one.
4. The folder looks like a package or a workspace (`package.xml`, `setup.py`, `CMakeLists.txt`, or a part with an
   artifact's file): one submission.
5. Patterns of the rubric find the same artifact in two folders that are neither parts nor all packages. One of them
   holds no artifact's file, but other programs, and there is no README beside them: launch files of two labs. Each folder
   is a submission.
6. The folder holds a single folder, and no files except tables: a wrapper of any name. The rules apply to its folder.
7. There are several archives; or several folders that are not parts hold archives and no programs; or the folder is named
   as a folder of submissions: each subfolder and archive is a submission.
8. An archive is next to a folder with artifacts' files, without a README: each is a submission.
9. One submission. In wrappers named as folders of submissions, it is the folder in the innermost of them.

A single folder named as a part (`code/`) is a wrapper too if two folders in it, neither parts nor with a package.xml,
hold the same artifact's file. `src` and folders named as workspaces are never wrappers, because they can be the
workspace of one student or of a group; folders in them with the same artifact's file are reported. If the user states
that a path is a class, the students' folders are looked for there too.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import PurePosixPath

from grader.lab.rubric import Rubric
from grader.submission.artifacts import by_pattern, names_of
from grader.submission.file_names import is_packed
from grader.submission.listing import Listing
from grader.submission.lms.systems import recognised

#: Folders within each other that hold nothing else.
_MOST_WRAPPERS = 50
_WORKSPACE = re.compile(
    r"src|sources?|ros2?|workspace"
    # Other words before `_ws` are names of students.
    r"|((ros2?|colcon|catkin|ament|dev|my|old|new|final|backup|test|tutorial|robot\w*|lab[\w-]*)_)?ws",
    re.IGNORECASE,
)
_PART = re.compile(
    r"code|launch|config|params?|scripts?|nodes?|packages?|include|resource|msg|srv", re.IGNORECASE
)
#: Longer numbers are those of students.
_SECTION = re.compile(
    r"(v|version|part|task|exercise|ex|q|question|lab|week|hw|assignment)[-_ ]?\d{1,3}([-_.]\d{1,3})*",
    re.IGNORECASE,
)
#: A word of a version or of an example, anywhere in a name: `old`, `lab9_backup`, `turtle demo (copy)`.
_VERSION = re.compile(
    r"(^|[-_ (.])(old|new|final|backups?|bak|archive|copy|orig(inal)?|drafts?|attempts?|tr(y|ies)"
    r"|alt|neu|kopie|sicherung|v\d{1,2}"
    r"|tutorials?|demos?|examples?|samples?|templates?|starter|handout|tests?)\d{0,2}($|[-_ ).])",
    re.IGNORECASE,
)
_COLLECTION = re.compile(
    r"(^|[-_ ])(submissions|students|hand-?ins|abgaben)($|[-_ (])", re.IGNORECASE
)
_PACKAGE_MARKS = frozenset({"package.xml", "setup.py", "CMakeLists.txt"})
_PACKAGE_NAME = re.compile(r"<name>([^<]{1,200})</name>")
_MOST_MANIFEST_CHARACTERS = 20_000
_PROGRAMS = frozenset({".py", ".c", ".cc", ".cpp", ".launch"})
#: Packages with the same file that are more than one workspace has.
_MANY_PACKAGES = 3


@dataclass(frozen=True)
class Understood:
    """The meaning of a folder or an archive."""

    #: The folder with an entry for each student; None for a single submission.
    students: Listing | None
    #: Paths of two folders of a single submission with the same artifact's file; empty without such folders.
    doubled: tuple[str, ...] = ()


class Collections:
    """Finds folders of submissions, by the files that one rubric asks for."""

    def __init__(self, rubric: Rubric) -> None:
        self._specs = rubric.artifacts
        self._wanted = {name: names_of(spec) for name, spec in rubric.artifacts.items()}

    def artifacts(self, files: Iterable[str]) -> frozenset[str]:
        """Return the artifacts with a file among some paths."""
        names = {PurePosixPath(file).name for file in files}
        found = set()
        for artifact, wanted in self._wanted.items():
            if not wanted.isdisjoint(names):
                found.add(artifact)
        return frozenset(found)

    def understood(self, listing: Listing) -> Understood:
        """Apply the rules to a folder or an archive."""
        way, decided = self._way_in(listing)
        if decided:
            return Understood(way[-1])
        named = [level for level in way[:-1] if _COLLECTION.search(level.name)]
        if named:
            return Understood(named[-1])
        _, doubled = self._doubled(way[-1])
        return Understood(None, doubled)

    def each(self, listing: Listing) -> Listing:
        """Return the folder with an entry for each student, of a folder or an archive of submissions.

        Wrappers are entered as by the rules. If they end in a folder that can only be one submission, as in
        `class/alice/talker.py`, its wrapper is returned.
        """
        way, decided = self._way_in(listing)
        if decided:
            return way[-1]
        holder, doubled = self._doubled(way[-1])
        if doubled:
            return holder
        if len(way) == 1:
            return way[-1]
        several = len(_submissions_in(way[-1])) > 1
        if decided is None and several:
            return way[-1]
        return way[-2]

    def _way_in(self, listing: Listing) -> tuple[list[Listing], bool | None]:
        """Return the wrappers from outside to the first folder that is not one, and the decision of the rules about it."""
        way = [listing]
        while True:
            last = way[-1]
            decided = self._is_collection(last)
            inner = last.only_folder
            if decided is not None or inner is None:
                return way, decided
            if len(way) > _MOST_WRAPPERS:
                return way, decided
            way.append(last.entered(inner))

    def _is_collection(self, listing: Listing) -> bool | None:
        """Apply the rules to the entries of a folder; returns None if no rule applies."""
        own = self._artifacts_beside(listing)
        if self._is_download(listing, bool(own)):
            return True
        held = self._held(listing)
        parts = _parts_of(listing.entries)
        students = {name: artifacts for name, artifacts in held.items() if name not in parts}
        alike = self._are_alike(listing, students)
        if listing.is_repository or own:
            return alike and _is_named_as_collection(listing)
        if alike:
            return True
        if listing.only_folder in parts and self._wraps_students(listing):
            return None
        is_package = bool(_PACKAGE_MARKS & set(listing.entries))
        if is_package or any(held[name] for name in parts):
            return False
        return self._by_form(listing, students)

    def _artifacts_beside(self, listing: Listing) -> frozenset[str]:
        """Return the artifacts with a file directly in a folder."""
        return self.artifacts(_files_in(listing))

    def _by_form(self, listing: Listing, students: Mapping[str, frozenset[str]]) -> bool | None:
        """Apply the rules for folders with no artifact's file in two entries."""
        has_readme = any(name.lower().startswith("readme") for name in listing.entries)
        folders = [listing.below(name) for name in students]
        if not has_readme and self._of_several_labs(folders):
            return True
        if listing.only_folder is not None:
            return None
        archives = list(filter(is_packed, _files_in(listing)))
        if len(archives) > 1 or _are_sealed(folders):
            return True
        if _submissions_in(listing) and _is_named_as_collection(listing):
            return True
        if archives and any(students.values()):
            return not has_readme
        return None

    def _is_download(self, listing: Listing, has_artifacts: bool) -> bool:
        """Return whether a system named most entries.

        A system's own files are neither in a repository nor beside a student's files.
        """
        download = recognised(listing.entries)
        if download is None or listing.is_repository:
            return False
        system, _ = download
        return not has_artifacts or system.own.isdisjoint(listing.entries)

    def _held(self, listing: Listing) -> dict[str, frozenset[str]]:
        """Return the artifacts in each folder of a folder."""
        return {name: self.artifacts(listing.below(name).files) for name in listing.folders}

    def _are_alike(self, listing: Listing, held: Mapping[str, frozenset[str]]) -> bool:
        """Return whether folders share an artifact as students' folders do, not as packages of one workspace."""
        if not _share_one(held.values()):
            return False
        packages = _packages_of(listing, held)
        others = [artifacts for name, artifacts in held.items() if name not in packages]
        if _share_one(others):
            return True
        return _share_one(held.values(), _MANY_PACKAGES) or _are_whole(held.values())

    def _wraps_students(self, listing: Listing) -> bool:
        """Return whether the only folder in a folder holds folders of students, although it is named as a part."""
        name = listing.only_folder
        if name is None or _WORKSPACE.fullmatch(name):
            return False
        inner = listing.entered(name)
        if inner.only_folder is not None:
            return self._wraps_students(inner)
        parts = _parts_of(inner.entries)
        students = []
        for folder, artifacts in self._held(inner).items():
            marks = _PACKAGE_MARKS & inner.below(folder).entries.keys()
            if folder not in parts and not marks:
                students.append(artifacts)
        return _share_one(students)

    def _doubled(self, listing: Listing) -> tuple[Listing, tuple[str, ...]]:
        """Return the paths of two folders beside each other with the same artifact's file, and the folder around them.

        Folders that alone hold artifacts' files are entered. Without two such folders, there are no paths.
        """
        above = ""
        while not self._artifacts_beside(listing):
            holders = [name for name, artifacts in self._held(listing).items() if artifacts]
            if len(holders) != 1:
                return listing, self._two_alike(listing, above)
            above += f"{holders[0]}/"
            listing = listing.below(holders[0])
        return listing, self._two_alike(listing, above)

    def _two_alike(self, listing: Listing, above: str) -> tuple[str, ...]:
        """Return the paths of two folders in a folder, no parts, with the same artifact's file; empty without these."""
        parts = _parts_of(listing.entries)
        holders: dict[str, list[str]] = {}
        for name, artifacts in self._held(listing).items():
            if name in parts:
                continue
            for artifact in artifacts:
                holders.setdefault(artifact, []).append(f"{above}{name}")
        for paths in holders.values():
            if len(paths) > 1:
                return tuple(paths[:2])
        return ()

    def _of_several_labs(self, students: Sequence[Listing]) -> bool:
        """Return whether folders hold the work for several labs, by rule 5."""
        if all(_PACKAGE_MARKS & student.entries.keys() for student in students):
            return False
        found = []
        foreign = False
        for student in students:
            artifacts, programs = self._by_patterns(student)
            found.append(artifacts)
            if artifacts and programs:
                foreign = foreign or not self.artifacts(student.files)
        return foreign and _share_one(found)

    def _by_patterns(self, listing: Listing) -> tuple[frozenset[str], set[str]]:
        """Return the artifacts in a folder by the rubric's patterns, and its other programs."""
        paths = list(map(PurePosixPath, listing.files))
        programs = {str(path) for path in paths if path.suffix in _PROGRAMS}
        found = set()
        for name, spec in self._specs.items():
            fact = by_pattern(name, spec, paths)
            programs.difference_update(fact.candidates)
            if fact.path is not None:
                programs.discard(fact.path)
                found.add(name)
        return frozenset(found), programs


def _is_named_as_collection(listing: Listing) -> bool:
    """Return whether a folder is named as a folder of submissions, such as `submissions` or `lab 9 abgaben`."""
    return _COLLECTION.search(listing.name) is not None


def _files_in(listing: Listing) -> list[str]:
    """Return the files directly in a folder."""
    return [name for name, is_folder in listing.entries.items() if not is_folder]


def _submissions_in(listing: Listing) -> list[str]:
    """Return the entries of a folder that can be submissions: folders and archives."""
    return [name for name, is_folder in listing.entries.items() if is_folder or is_packed(name)]


def _are_sealed(folders: Iterable[Listing]) -> bool:
    """Return whether several folders hold archives and no programs."""
    return sum(_is_sealed(folder) for folder in folders) > 1


def _parts_of(entries: Mapping[str, bool]) -> frozenset[str]:
    """Return the folders named as parts of one submission; versions and sections count only beside other entries."""
    found = set()
    for name, is_folder in entries.items():
        forms = [_WORKSPACE.fullmatch(name), _PART.fullmatch(name)]
        if len(entries) > 1:
            forms += [_SECTION.fullmatch(name), _VERSION.search(name)]
        if is_folder and any(forms):
            found.add(name)
    return frozenset(found)


def _packages_of(listing: Listing, folders: Collection[str]) -> frozenset[str]:
    """Return the folders with their own name in their package.xml."""
    manifests = {f"{name}/package.xml": name for name in folders}
    there = manifests.keys() & set(listing.files)
    texts = listing.texts(sorted(there))
    packages = set()
    for file, text in texts.items():
        # A student's text could keep a reader of XML busy for ever.
        stated = _PACKAGE_NAME.search(text[:_MOST_MANIFEST_CHARACTERS])
        if stated is not None and stated[1].strip() == manifests[file]:
            packages.add(manifests[file])
    return frozenset(packages)


def _are_whole(held: Collection[frozenset[str]]) -> bool:
    """Return whether two folders hold all artifacts of all folders, and these are more than one."""
    everything = frozenset(chain.from_iterable(held))
    if len(everything) < 2:
        return False
    return sum(artifacts == everything for artifacts in held) > 1


def _share_one(held: Iterable[frozenset[str]], least: int = 2) -> bool:
    """Return whether a number of folders hold the same artifact."""
    counts = Counter(chain.from_iterable(held))
    return max(counts.values(), default=0) >= least


def _is_sealed(folder: Listing) -> bool:
    """Return whether a folder holds an archive, and no program."""
    paths = list(map(PurePosixPath, folder.files))
    if any(path.suffix in _PROGRAMS for path in paths):
        return False
    return any(is_packed(path.name) for path in paths)
