"""Choose the student's work among files of one name: a tutorial lies beside it, or an earlier try.

The files' contents decide, the lab's package, the lab's programs that a launch file names, and which folder holds the
most of the lab's files; never how deep a file lies. Nothing is read of what the student writes about their folders: it
may say anything.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath

#: Folders that say of themselves that the work is elsewhere.
_LEFT_BEHIND = re.compile(
    r"(^|[^a-z])(old|older|backup|bak|archived?|attic|unused|drafts?|deprecated|obsolete|orig|copy|alt|kopie|sicherung"
    r"|tutorials?|demos?|examples?|samples?|templates?|starter|handout|tests?)([^a-z]|$)",
    re.IGNORECASE,
)
#: Two folders that hold so many of the same artifacts are two versions of the work, which are compared as wholes.
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
    #: Files with all the words by which the rubric knows the artifact.
    worded: frozenset[PurePosixPath] = frozenset()
    #: How many of the lab's programs each file names.
    programs: Mapping[PurePosixPath, int] = field(default_factory=dict)


@dataclass(frozen=True)
class _Group:
    """The files of one name in one folder, and what the folder holds of the lab."""

    folder: str
    files: tuple[PurePosixPath, ...]
    #: Artifacts of which a file is there, and those of which one holds the words.
    named: frozenset[str]
    worded: frozenset[str]
    rank: int
    #: True if one of the files holds the words, and if one lies in the lab's package.
    own_words: bool
    in_package: bool
    #: The most of the lab's programs that one of the files names.
    programs: int

    @property
    def is_left_behind(self) -> bool:
        """Tell whether the folder is called as those are that nobody means to hand in."""
        return _LEFT_BEHIND.search(self.folder) is not None

    @property
    def shown(self) -> str:
        """The folder as a reader is told of it."""
        return f"{self.folder}/" if self.folder else "the folder above it"


class Chooser:
    """Chooses among files of one name by the candidates of all artifacts."""

    def __init__(
        self,
        found: Mapping[str, Candidates],
        digests: Mapping[PurePosixPath, str],
        package: str,
        package_folders: Sequence[PurePosixPath],
    ) -> None:
        self._found = found
        self._digests = digests
        self._package = package
        self._package_folders = package_folders

    def choose(self, artifact: str, files: Sequence[PurePosixPath]) -> Choice:
        """Choose one of an artifact's files, of which there is at least one; copies of it are no others."""
        left, whys, is_open, depth = list(files), list[str](), False, 0
        while len({self._digests.get(path, str(path)) for path in left}) > 1:
            groups = self._groups(artifact, left, depth)
            depth += 1
            if len(groups) == 1 and groups[0].folder:
                continue
            best, why, tied = self._best(groups)
            whys.append(why)
            is_open = is_open or tied
            left = list(best.files)
        taken = min(left, key=lambda path: (len(path.parts), path.parts))
        others = self._others(artifact, files, taken)
        return Choice(taken, others, next(filter(None, whys), ""), is_open and bool(others))

    def _others(
        self, artifact: str, files: Sequence[PurePosixPath], taken: PurePosixPath
    ) -> tuple[PurePosixPath, ...]:
        """Return the files of the taken one's rank that are no copies of it."""
        ranks = self._found[artifact].ranks
        found = []
        for path in files:
            is_copy = self._digests.get(path) == self._digests.get(taken)
            if not is_copy and ranks.get(path) == ranks.get(taken):
                found.append(path)
        return tuple(found)

    def _groups(self, artifact: str, files: Sequence[PurePosixPath], depth: int) -> list[_Group]:
        """Return files by the folders in which they lie at a depth; each file that lies in none is its own group."""
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
        named, worded = set(), set()
        for name, candidates in self._found.items():
            if any(map(within.holds, candidates.ranks)):
                named.add(name)
            if any(map(within.holds, candidates.worded)):
                worded.add(name)
        own = self._found[artifact]
        return _Group(
            folder,
            tuple(files),
            frozenset(named),
            frozenset(worded),
            min(own.ranks.get(path, 0) for path in files),
            any(path in own.worded for path in files),
            any(map(self._is_in_package, files)),
            max(own.programs.get(path, 0) for path in files),
        )

    def _is_in_package(self, path: PurePosixPath) -> bool:
        below = any(folder in path.parents for folder in self._package_folders)
        return below or self._package in path.parts[:-1]

    def _best(self, groups: Sequence[_Group]) -> tuple[_Group, str, bool]:
        """Return the group to go on with, why, and whether another is as good."""
        measures = _VERSIONS_BY if _are_versions(groups) else _FILES_BY
        left = list(groups)
        for measure in measures:
            most = max(measure.of(group) for group in left)
            behind, ahead = list[_Group](), list[_Group]()
            for group in left:
                (ahead if measure.of(group) == most else behind).append(group)
            left = ahead
            if len(left) == 1:
                return left[0], measure.why(left[0], behind), False
        return left[0], _TIED, True


_TIED = "nothing tells it from the others, so the first by its folder's name was taken"


def _folder_at(path: PurePosixPath, depth: int) -> str:
    return path.parts[depth] if len(path.parts) > depth + 1 else ""


@dataclass(frozen=True)
class _Within:
    """The part of a submission that belongs to one of several rival folders, or to none of them."""

    above: tuple[str, ...]
    folder: str
    rivals: frozenset[str]

    def holds(self, path: PurePosixPath) -> bool:
        """Tell whether a file lies there."""
        depth = len(self.above)
        if path.parts[:depth] != self.above:
            return False
        folder = _folder_at(path, depth)
        return folder == self.folder if self.folder else folder not in self.rivals


def _are_versions(groups: Sequence[_Group]) -> bool:
    """Tell whether several folders hold the same work; files beside each other share a folder."""
    by_folder = {group.folder: group.worded for group in groups}
    held: Counter[str] = Counter()
    for names in by_folder.values():
        held.update(names)
    return sum(times > 1 for times in held.values()) >= _VERSIONS


@dataclass(frozen=True)
class _Measure:
    """A figure of a group, of which more is better, and the words where it decides."""

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
_WORDED = _by_count(lambda group: len(group.worded))
_NAMED = _by_count(lambda group: len(group.named))
_KEPT = _Measure(
    lambda group: not group.is_left_behind,
    lambda best, others: f"the other lies in {others[0].shown}",
)
#: For files that only have the name in common, and for versions of the same work.
_FILES_BY = (_NAME, _WORDS, _PACKAGE, _PROGRAMS, _WORDED, _NAMED, _KEPT)
_VERSIONS_BY = (_WORDED, _PACKAGE, _WORDS, _NAMED, _NAME, _KEPT)
