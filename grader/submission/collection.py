"""Tells one submission from a folder (or archive) of submissions, by the names in it.

An *artifact's file* is one whose name the rubric asks for, word for word. A *part* is a folder named as parts of a
workspace are (`src`, `launch`), or one of several named as versions, sections or demonstrations are (`old`, `task2`,
`demo`). A *package* is a folder whose package.xml has the folder's own name. The first rule that applies decides:

1. Most names are those of a learning-management system's download (`grader.submission.lms`): each student is one.
2. It is a git repository's root, or an artifact's file lies directly in it: one submission. In a folder with a name of
   folders of submissions (`submissions`, `lab-09-submissions`, `Abgaben`), that does not matter if 3 holds: an
   instructor's repository, a stray file.
3. The same artifact's file lies in two subfolders that are neither parts nor packages: each subfolder and archive is
   one. In a single workspace each file lies in one package; in a class everyone has handed in the same names. Packages
   count as students only if three hold the same file, or two hold all files that any of them holds, and more than one.
4. It looks like a package or a workspace (`package.xml`, `setup.py`, `CMakeLists.txt`, or a part that holds an
   artifact's file): one submission.
5. Patterns of the rubric find the same artifact in two folders that are no parts nor all packages, one of which holds
   no artifact's file and other programs, and no README lies beside: the launch files of two labs. Each is one.
6. It holds a single folder, and no files but tables: a wrapper, of whatever name. The rules apply to that folder.
7. There are several archives, or several folders that are no parts and hold archives and no programs, or its name is
   that of folders of submissions: each subfolder and archive is one.
8. An archive lies beside a folder with artifacts' files, without a README: each is one.
9. One submission. In wrappers with a name of folders of submissions, it is the folder in the innermost of them.

A folder named as a part that is alone in its place (`code/`) is a wrapper too if two folders in it, neither parts nor with
a package.xml, hold the same artifact's file. `src` and folders named as workspaces never are.
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
    # Others before `_ws` are names of students.
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
    """How a folder or an archive was understood."""

    #: The folder in which students lie beside each other; None if it is one submission.
    students: Listing | None
    #: Folders that hold the same artifact's file although it is one submission; at most two are named.
    doubled: tuple[str, ...] = ()


class Collections:
    """Finds folders of submissions, by the files that one rubric asks for."""

    def __init__(self, rubric: Rubric) -> None:
        self._specs = rubric.artifacts
        self._wanted = {name: names_of(spec) for name, spec in rubric.artifacts.items()}

    def artifacts(self, files: Iterable[str]) -> frozenset[str]:
        """Return the artifacts whose file is among some paths."""
        names = {PurePosixPath(file).name for file in files}
        return frozenset(artifact for artifact, wanted in self._wanted.items() if wanted & names)

    def understood(self, listing: Listing) -> Understood:
        """Apply the rules to a folder or an archive."""
        way, decided = self._way_in(listing)
        if decided:
            return Understood(way[-1])
        named = [level for level in way[:-1] if _COLLECTION.search(level.name)]
        if named:
            return Understood(named[-1])
        return Understood(None, self._doubled(way[-1]))

    def each(self, listing: Listing) -> Listing:
        """Return where submissions lie beside each other, of a folder or an archive of submissions.

        Wrappers are passed as by the rules. If they end in a folder that can only be one submission, e.g.
        `class/alice/talker.py`, it is the one in its wrapper.
        """
        way, decided = self._way_in(listing)
        inner = way[-1].entries
        several = sum(folder or is_packed(name) for name, folder in inner.items()) > 1
        if decided or len(way) == 1 or (decided is None and several):
            return way[-1]
        return way[-2]

    def _way_in(self, listing: Listing) -> tuple[list[Listing], bool | None]:
        """Return the wrappers from outside to the first folder that is none, and what the rules say of that."""
        way = [listing]
        while True:
            decided = self._is_collection(way[-1])
            inner = way[-1].only_folder
            if decided is not None or inner is None or len(way) > _MOST_WRAPPERS:
                return way, decided
            way.append(way[-1].entered(inner))

    def _is_collection(self, listing: Listing) -> bool | None:
        """Apply the rules to the entries of a folder; None if none applies."""
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
        if _PACKAGE_MARKS & set(listing.entries) or any(held[name] for name in parts):
            return False
        return self._by_form(listing, students)

    def _artifacts_beside(self, listing: Listing) -> frozenset[str]:
        """Return the artifacts whose file lies directly in a folder."""
        return self.artifacts(name for name, folder in listing.entries.items() if not folder)

    def _by_form(self, listing: Listing, students: Mapping[str, frozenset[str]]) -> bool | None:
        """Apply the rules for folders in which no two hold the same artifact's file."""
        has_readme = any(name.lower().startswith("readme") for name in listing.entries)
        if not has_readme and self._of_several_labs([listing.below(name) for name in students]):
            return True
        if listing.only_folder is not None:
            return None
        archives = _archives_in(listing)
        if len(archives) > 1 or _are_sealed(listing, students):
            return True
        if _has_folder_or_archive(listing) and _is_named_as_collection(listing):
            return True
        if archives and any(students.values()):
            return not has_readme
        return None

    def _is_download(self, listing: Listing, has_artifacts: bool) -> bool:
        """Whether a system named most entries.

        The files that a system writes beside submissions lie in no repository, and beside no student's files.
        """
        download = recognised(listing.entries)
        if download is None or listing.is_repository:
            return False
        return not (has_artifacts and download[0].own & listing.entries.keys())

    def _held(self, listing: Listing) -> dict[str, frozenset[str]]:
        """Return each folder directly in one -> the artifacts that it holds."""
        folders = [name for name, folder in listing.entries.items() if folder]
        return {name: self.artifacts(listing.below(name).files) for name in folders}

    def _are_alike(self, listing: Listing, held: Mapping[str, frozenset[str]]) -> bool:
        """Whether folders hold the same artifact as those of students do, and not as packages of one workspace."""
        if not _share_one(held.values()):
            return False
        packages = _packages_of(listing, held)
        if _share_one(artifacts for name, artifacts in held.items() if name not in packages):
            return True
        return _share_one(held.values(), _MANY_PACKAGES) or _are_whole(held.values())

    def _wraps_students(self, listing: Listing) -> bool:
        """Whether the only folder in one, though named as a part is, holds folders of students."""
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

    def _doubled(self, listing: Listing) -> tuple[str, ...]:
        """Name two folders that hold the same artifact's file."""
        holders: dict[str, list[str]] = {}
        for name, artifacts in self._held(listing).items():
            for artifact in artifacts:
                holders.setdefault(artifact, []).append(name)
        several = (names for names in holders.values() if len(names) > 1)
        return tuple(next(several, [])[:2])

    def _of_several_labs(self, students: Sequence[Listing]) -> bool:
        foreign, found = False, []
        for student in students:
            paths = [PurePosixPath(file) for file in student.files]
            facts = [by_pattern(name, spec, paths) for name, spec in self._specs.items()]
            found.append(frozenset(fact.name for fact in facts if fact.path is not None))
            programs = {str(path) for path in paths if path.suffix in _PROGRAMS}
            programs.difference_update(*([fact.path, *fact.candidates] for fact in facts))
            foreign |= bool(found[-1] and programs) and not self.artifacts(student.files)
        packages = all(_PACKAGE_MARKS & student.entries.keys() for student in students)
        return foreign and not packages and _share_one(found)


def _is_named_as_collection(listing: Listing) -> bool:
    """Tell whether a folder is called as folders of submissions are, e.g. `submissions` or `lab 9 abgaben`."""
    return _COLLECTION.search(listing.name) is not None


def _archives_in(listing: Listing) -> list[str]:
    """Return the archives directly in a folder."""
    files = (name for name, folder in listing.entries.items() if not folder)
    return [name for name in files if is_packed(name)]


def _has_folder_or_archive(listing: Listing) -> bool:
    """Tell whether an entry of a folder can be a submission."""
    return any(folder or is_packed(name) for name, folder in listing.entries.items())


def _are_sealed(listing: Listing, students: Iterable[str]) -> bool:
    """Tell whether several folders hold nothing but archives."""
    sealed = [name for name in students if _holds_archives_only(listing.below(name).files)]
    return len(sealed) > 1


def _parts_of(entries: Mapping[str, bool]) -> frozenset[str]:
    """Return the folders named as parts of one submission are; versions and sections only beside others."""
    found = set()
    for name in (name for name, folder in entries.items() if folder):
        forms = [_WORKSPACE.fullmatch(name), _PART.fullmatch(name)]
        if len(entries) > 1:
            forms += [_SECTION.fullmatch(name), _VERSION.search(name)]
        if any(forms):
            found.add(name)
    return frozenset(found)


def _packages_of(listing: Listing, folders: Collection[str]) -> frozenset[str]:
    """Return the folders whose package.xml has their own name."""
    manifests = {f"{name}/package.xml": name for name in folders}
    there = [file for file in manifests if file in set(listing.files)]
    texts = listing.texts(there)
    packages = set()
    for file, text in texts.items():
        # Not by a reader of XML: a student's text could keep it busy for ever.
        stated = _PACKAGE_NAME.search(text[:_MOST_MANIFEST_CHARACTERS])
        if stated is not None and stated[1].strip() == manifests[file]:
            packages.add(manifests[file])
    return frozenset(packages)


def _are_whole(held: Collection[frozenset[str]]) -> bool:
    """Whether two hold all artifacts that any of them holds, and these are more than one."""
    everything = frozenset(chain.from_iterable(held))
    return len(everything) > 1 and sum(artifacts == everything for artifacts in held) > 1


def _share_one(held: Iterable[frozenset[str]], least: int = 2) -> bool:
    """Whether the same artifact is in so many of them."""
    return any(count >= least for count in Counter(chain.from_iterable(held)).values())


def _holds_archives_only(files: Iterable[str]) -> bool:
    """Whether files are those of somebody who hands in an archive: no program lies beside it."""
    names = [PurePosixPath(file) for file in files]
    return any(is_packed(name.name) for name in names) and not any(
        name.suffix in _PROGRAMS for name in names
    )
