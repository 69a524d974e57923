"""Choose the student's work among files of one name, beside a tutorial or an earlier version.

The criteria are the files' contents, the lab's package, the lab's programs named in a launch file, the folders that
build files name, and the number of the lab's files in each folder; never the depth of a file. A student's text about
the folders is not read, because it can claim anything.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import PurePosixPath

#: Names of folders without the final work.
_LEFT_BEHIND = re.compile(
    r"(^|[^a-z])(old|older|backup|bak|archived?|attic|unused|drafts?|deprecated|obsolete|orig|copy|alt|kopie|sicherung"
    r"|tutorials?|demos?|examples?|samples?|templates?|starter|handout|tests?)([^a-z]|$)",
    re.IGNORECASE,
)
#: Common artifacts from which two folders are versions of the work, and are compared as a whole.
_VERSIONS = 2


@dataclass(frozen=True)
class Choice:
    """A file that was taken, the others of its name that were not, and why."""

    path: PurePosixPath
    others: tuple[PurePosixPath, ...] = ()
    why: str = ""
    #: True if nothing tells the taken one from another, and a person must look.
    is_open: bool = False


@dataclass(frozen=True)
class Candidates:
    """The files of one artifact's names: each with the rank of its name, 0 for the best."""

    ranks: Mapping[PurePosixPath, int] = field(default_factory=dict)
    #: Files with all words that the rubric requires of the artifact.
    worded: frozenset[PurePosixPath] = frozenset()
    #: Number of the lab's programs in each file.
    programs: Mapping[PurePosixPath, int] = field(default_factory=dict)


@dataclass(frozen=True)
class _Group:
    """The files of one name in one folder, and the lab's artifacts in the folder."""

    folder: str
    files: tuple[PurePosixPath, ...]
    #: Artifacts with a file in the folder.
    named: frozenset[str]
    #: Artifacts with a file in the folder that has the required words.
    worded: frozenset[str]
    #: Best rank of the files' names.
    rank: int
    #: True if one of the files has the required words.
    own_words: bool
    #: True if one of the files is in the lab's package.
    in_package: bool
    #: Largest number of the lab's programs named in one of the files.
    programs: int
    #: True if the build files of a package install the folder of one of the files.
    is_installed: bool

    @property
    def is_left_behind(self) -> bool:
        """True if the folder has a name of folders without the final work."""
        return _LEFT_BEHIND.search(self.folder) is not None

    @property
    def shown(self) -> str:
        """The folder's name for a reader."""
        return f"{self.folder}/" if self.folder else "the folder above it"


class Chooser:
    """Chooses among files of one name by the candidates of all artifacts."""

    def __init__(
        self,
        found: Mapping[str, Candidates],
        digests: Mapping[PurePosixPath, str],
        package: str,
        package_folders: Sequence[PurePosixPath],
        installed: Set[PurePosixPath],
    ) -> None:
        self._found = found
        self._digests = digests
        self._package = package
        self._package_folders = package_folders
        self._installed = installed

    def choose(self, artifact: str, files: Sequence[PurePosixPath]) -> Choice:
        """Choose one of an artifact's files, at least one; copies of the chosen file do not count as others."""
        left = list(files)
        first_why = ""
        is_open = False
        depth = 0
        while self._differ(left):
            groups = self._groups(artifact, left, depth)
            depth += 1
            if len(groups) == 1 and groups[0].folder:
                continue
            best, why, tied = self._best(groups)
            first_why = first_why or why
            is_open = is_open or tied
            left = list(best.files)
        taken = min(left, key=lambda path: (len(path.parts), path.parts))
        others = self._others(artifact, files, taken)
        return Choice(taken, others, first_why, is_open and bool(others))

    def _differ(self, files: Sequence[PurePosixPath]) -> bool:
        """Return whether some files have different contents."""
        contents = {self._digests.get(path, str(path)) for path in files}
        return len(contents) > 1

    def _others(
        self, artifact: str, files: Sequence[PurePosixPath], taken: PurePosixPath
    ) -> tuple[PurePosixPath, ...]:
        """Return the files with the rank of the taken one, without copies of it."""
        ranks = self._found[artifact].ranks
        found = []
        for path in files:
            is_copy = self._digests.get(path) == self._digests.get(taken)
            if not is_copy and ranks.get(path) == ranks.get(taken):
                found.append(path)
        return tuple(found)

    def _groups(self, artifact: str, files: Sequence[PurePosixPath], depth: int) -> list[_Group]:
        """Return groups of files by their folders at a depth; a file outside of folders is a group of its own."""
        by_folder: dict[str, list[PurePosixPath]] = {}
        for path in files:
            by_folder.setdefault(_folder_at(path, depth), []).append(path)
        above = files[0].parts[:depth]
        rivals = frozenset(folder for folder in by_folder if folder)
        groups = []
        for folder in sorted(by_folder):
            within = _Within(above, folder, rivals)
            if folder:
                groups.append(self._group(artifact, folder, by_folder[folder], within))
                continue
            for path in sorted(by_folder[""]):
                groups.append(self._group(artifact, folder, [path], within))
        return groups

    def _group(
        self, artifact: str, folder: str, files: list[PurePosixPath], within: _Within
    ) -> _Group:
        named = set()
        worded = set()
        for name, candidates in self._found.items():
            if any(map(within.holds, candidates.ranks)):
                named.add(name)
            if any(map(within.holds, candidates.worded)):
                worded.add(name)
        own = self._found[artifact]
        rank = min(own.ranks.get(path, 0) for path in files)
        own_words = any(path in own.worded for path in files)
        in_package = any(map(self._is_in_package, files))
        programs = max(own.programs.get(path, 0) for path in files)
        return _Group(
            folder,
            tuple(files),
            frozenset(named),
            frozenset(worded),
            rank,
            own_words,
            in_package,
            programs,
            any(path in self._installed for path in files),
        )

    def _is_in_package(self, path: PurePosixPath) -> bool:
        below = any(folder in path.parents for folder in self._package_folders)
        return below or self._package in path.parts[:-1]

    def _best(self, groups: Sequence[_Group]) -> tuple[_Group, str, bool]:
        """Return the best group, the reason, and whether another group is as good."""
        measures = _VERSIONS_BY if _are_versions(groups) else _FILES_BY
        left = list(groups)
        for measure in measures:
            most = max(map(measure.of, left))
            behind = [group for group in left if measure.of(group) < most]
            left = [group for group in left if measure.of(group) == most]
            if len(left) == 1:
                return left[0], measure.why(left[0], behind), False
        return left[0], _TIED, True


_TIED = "nothing tells it from the others, so the first by its folder's name was taken"


def _folder_at(path: PurePosixPath, depth: int) -> str:
    """Return the folder of a file at a depth; empty if the file is not so deep."""
    if len(path.parts) <= depth + 1:
        return ""
    return path.parts[depth]


@dataclass(frozen=True)
class _Within:
    """The part of a submission that belongs to one of several rival folders, or to none of them."""

    above: tuple[str, ...]
    folder: str
    rivals: frozenset[str]

    def holds(self, path: PurePosixPath) -> bool:
        """Return whether a file is in this part."""
        depth = len(self.above)
        if path.parts[:depth] != self.above:
            return False
        folder = _folder_at(path, depth)
        if self.folder:
            return folder == self.folder
        return folder not in self.rivals


def _are_versions(groups: Sequence[_Group]) -> bool:
    """Return whether several folders hold the same work; files beside each other share a folder."""
    by_folder = {group.folder: group.worded for group in groups}
    held: Counter[str] = Counter()
    for names in by_folder.values():
        held.update(names)
    return sum(times > 1 for times in held.values()) >= _VERSIONS


@dataclass(frozen=True)
class _Measure:
    """A figure of a group; more is better. `why` words the decision of the figure."""

    of: Callable[[_Group], int]
    why: Callable[[_Group, Sequence[_Group]], str]


def _by_count(count: Callable[[_Group], int]) -> _Measure:
    def why(best: _Group, others: Sequence[_Group]) -> str:
        rival = max(others, key=count)
        held = f"{best.shown} holds {count(best)} of the lab's files"
        return f"{held}, {rival.shown} {count(rival)}"

    return _Measure(count, why)


_NAME = _Measure(lambda group: -group.rank, lambda best, others: "its name is the lab's")
_WORDS = _Measure(
    lambda group: group.own_words, lambda best, others: "only this one holds what the lab asks for"
)
_PACKAGE = _Measure(
    lambda group: group.in_package, lambda best, others: "it lies in the lab's package"
)


def _why_by_programs(best: _Group, others: Sequence[_Group]) -> str:
    most = max(group.programs for group in others)
    return f"it names {best.programs} of the lab's programs, the other {most}"


_PROGRAMS = _Measure(lambda group: group.programs, _why_by_programs)
_INSTALLED = _Measure(
    lambda group: group.is_installed,
    lambda best, others: "only this one is installed by the build files of its package",
)
_WORDED = _by_count(lambda group: len(group.worded))
_NAMED = _by_count(lambda group: len(group.named))
_KEPT = _Measure(
    lambda group: not group.is_left_behind,
    lambda best, others: f"the other lies in {others[0].shown}",
)
#: Order of the measures for files with nothing but the name in common.
_FILES_BY = (_NAME, _WORDS, _PACKAGE, _PROGRAMS, _INSTALLED, _WORDED, _NAMED, _KEPT)
#: Order of the measures for versions of the same work.
_VERSIONS_BY = (_WORDED, _PACKAGE, _WORDS, _NAMED, _NAME, _KEPT)
