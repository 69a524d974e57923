"""An extracted submission → the artifacts that the rubric asks for, and static facts.

Nothing is executed or imported here.
"""

from __future__ import annotations

import difflib
import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

from grader.errors import SubmissionError
from grader.lab.file_patterns import anywhere, matches
from grader.lab.rubric import ArtifactSpec, Rubric
from grader.recording.submission import ArtifactFact, FileFact, PackageFact, SubmissionRecord
from grader.submission.choice import Candidates, Chooser
from grader.submission.extraction import Intake, SubmissionSource
from grader.submission.file_names import TEXT_SUFFIXES, displayed
from grader.submission.packages.colcon import find_packages
from grader.submission.submission_time import set_submission_time

#: A text beyond this, and the largest of those that are too much together, are not read by the judging half.
MAX_TEXT_BYTES = 512 * 1024
MAX_TEXTS_CHARACTERS = 8 * 1024 * 1024
#: How similar two file names must be for one to count as a misspelling of the other (difflib's ratio).
NEAR_MISS_RATIO = 0.75


def read_submission(intake: Intake, rubric: Rubric) -> SubmissionRecord:
    """Find the rubric's artifacts in a submission and collect static facts.

    Raises SubmissionError if it holds nothing that the rubric asks for, or something of it may not be read: that costs
    nobody points.
    """
    source = intake.source
    record = SubmissionRecord(
        name=source.name, left_out=list(intake.left_out), source=source.origin
    )
    record.student_id, record.identity = source.student_id, source.identity
    set_submission_time(record, source.submission_time)
    collect_files(intake.folder, record)
    if not record.files:
        raise SubmissionError(
            "the submission is empty",
            location=source.location,
            remedy="Put the lab's files into it.",
        )
    paths = [PurePosixPath(f.path) for f in record.files]
    record.packages = find_packages(record.texts, [f.path for f in record.files])
    record.artifacts = find_artifacts(paths, record, rubric)
    for fact in record.artifacts:
        if fact.path is None:
            fact.path = _by_entry_point(
                rubric.artifacts[fact.name].executable,
                sorted(record.packages, key=lambda package: package.name != rubric.lab.package),
                record.texts,
            )
            fact.found_by = "near miss" if fact.path is not None else fact.found_by
    for fact in record.artifacts:
        fact.bonus = fact.name in rubric.bonus_artifacts
    # What nobody has to hand in is not missing.
    record.artifacts = [
        fact for fact in record.artifacts if fact.path is not None or not fact.bonus
    ]
    _require_readable(intake, record)
    if not any(_shows_lab(fact, record, rubric) for fact in record.artifacts):
        wanted = ", ".join(
            spec.file
            for name, spec in rubric.artifacts.items()
            if name not in rubric.bonus_artifacts
        )
        problem = f"nothing in it looks like a submission to lab {rubric.lab.id}; it may be of another lab"
        remedy = f"At least one of these files is expected: {wanted}. "
        remedy += "Another lab is given by --lab; for a folder of several submissions, add --each."
        raise SubmissionError(problem, location=source.location, remedy=remedy)
    digest = hashlib.sha256()
    for file in sorted(record.files, key=lambda f: f.path):
        digest.update(f"{file.path}\0{file.sha256}\n".encode())
    record.sha256 = digest.hexdigest()
    return record


def names_of(spec: ArtifactSpec) -> frozenset[str]:
    """Return the names by which the rubric asks for an artifact's file, word for word."""
    names = (PurePosixPath(pattern).name for pattern in (spec.file, *spec.find))
    return frozenset(name for name in names if not re.search(r"[*?\[]", name))


def _shows_lab(fact: ArtifactFact, record: SubmissionRecord, rubric: Rubric) -> bool:
    """Whether a file that was found shows that this lab is meant.

    A launch file that only a pattern finds, and an extension found by its contents, may be of any lab: they show it
    where they name one of its programs.
    """
    spec, programs = (
        rubric.artifacts[fact.name],
        {s.executable for s in rubric.artifacts.values()} - {None},
    )
    by_pattern = spec.executable is None and fact.found_by == "name"
    if fact.path is None or not (by_pattern or (fact.bonus and fact.found_by != "name")):
        return fact.path is not None
    text = record.texts.get(fact.path, "")
    return (
        not programs
        or PurePosixPath(fact.path).name in names_of(spec)
        or any(str(p) in text for p in programs)
    )


def _require_readable(intake: Intake, record: SubmissionRecord) -> None:
    """Raise if a grade may rest on what is there and may not be read.

    That is a file that programs are made of or that people read, and a folder, where a file of the lab is missing.
    """
    missing = any(fact.path is None for fact in record.artifacts)
    closed = [
        name
        for name in intake.unreadable
        if (missing if name.endswith("/") else PurePosixPath(name).suffix.lower() in TEXT_SUFFIXES)
    ]
    if closed:
        more = f" and {len(closed) - 1} more" if len(closed) > 1 else ""
        raise SubmissionError(
            f"{displayed(closed[0])}{more} may not be read, so that no fair score exists",
            location=intake.source.location,
            remedy="Give yourself the right to read it (chmod -R u+rX), or grade as the user that it belongs to.",
        )


def read_submission_folder(folder: Path, rubric: Rubric) -> SubmissionRecord:
    """Read a folder of the project's own as `read_submission` does; a student's is extracted first."""
    return read_submission(
        Intake(folder, SubmissionSource(folder.resolve().name, (), location=str(folder))), rubric
    )


def collect_files(folder: Path, record: SubmissionRecord) -> None:
    """Note the files of a folder with their hashes, and the texts that may be read."""
    paths = [
        path.relative_to(folder)
        for path in folder.rglob("*")
        if path.is_file() and not path.is_symlink()
    ]
    # The files of a folder come before those of the folders in it.
    for path in sorted(
        paths, key=lambda path: (*((True, part) for part in path.parts[:-1]), (False, path.name))
    ):
        content = (folder / path).read_bytes()
        record.files.append(
            FileFact(path.as_posix(), len(content), hashlib.sha256(content).hexdigest())
        )
        if (
            path.suffix.lower() in TEXT_SUFFIXES
            and len(content) <= MAX_TEXT_BYTES
            and b"\0" not in content
        ):
            record.texts[path.as_posix()] = decode_text(content)
    _limit_texts(record.texts)


def _limit_texts(texts: dict[str, str]) -> None:
    """Drop the largest texts, which nobody has written, where all of them would be too much to judge."""
    total = sum(map(len, texts.values()))
    for path in sorted(texts, key=lambda path: (-len(texts[path]), path)):
        if total <= MAX_TEXTS_CHARACTERS:
            return
        total -= len(texts.pop(path))


def decode_text(content: bytes) -> str:
    """Decode a text file as UTF-8 (with or without byte order mark), else as Latin-1; never fails."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def find_artifacts(
    paths: list[PurePosixPath], record: SubmissionRecord, rubric: Rubric
) -> list[ArtifactFact]:
    """Find each artifact: by the rubric's patterns, else by a similar name, else by its contents.

    One file may hold several, as nodes that are composed in one process do. A bonus artifact is not found by a similar
    name: nobody has to hand it in, so that the file is more likely another.
    """
    specs, texts = rubric.artifacts, record.texts
    executables = frozenset(filter(None, (spec.executable for spec in specs.values())))
    found = {name: _candidates(spec, paths, texts, executables) for name, spec in specs.items()}
    chooser = _chooser(found, record, rubric)
    facts = {name: ArtifactFact(name, spec.file) for name, spec in specs.items()}
    for name, candidates in found.items():
        if candidates.ranks:
            facts[name] = _chosen(facts[name], chooser, list(candidates.ranks), "name")
    for name, spec in specs.items():
        if facts[name].path is not None:
            continue
        free = _free_programs(paths, facts.values())
        alike = _similar(spec, free) if name not in rubric.bonus_artifacts else []
        near = alike or _by_contents(spec, free, paths, texts)
        if near:
            worded = frozenset(_holding(spec, near, texts))
            found[name] = Candidates(_ranks_of_near(near, alike), worded)
            facts[name] = _chosen(facts[name], chooser, near, "near miss")
    return list(facts.values())


def _chooser(found: dict[str, Candidates], record: SubmissionRecord, rubric: Rubric) -> Chooser:
    """Return the choice among candidates, by contents and by the packages of the lab's name."""
    hashes = {PurePosixPath(file.path): file.sha256 for file in record.files}
    package = rubric.lab.package
    folders = [PurePosixPath(p.path) for p in record.packages if p.name == package]
    return Chooser(found, hashes, package, folders)


def _free_programs(
    paths: Sequence[PurePosixPath], facts: Iterable[ArtifactFact]
) -> list[PurePosixPath]:
    """Return the Python files and files without suffix that are no artifact yet."""
    taken = {fact.path for fact in facts}
    programs = (path for path in paths if path.suffix in (".py", ""))
    return [path for path in programs if str(path) not in taken]


def _by_contents(
    spec: ArtifactSpec,
    free: list[PurePosixPath],
    paths: list[PurePosixPath],
    texts: dict[str, str],
) -> list[PurePosixPath]:
    """Return the files that hold an artifact by their contents, else programs that are another artifact too."""
    found = _holding(spec, free, texts)
    if not found and spec.executable is not None:
        programs = [path for path in paths if path.suffix == ".py"]
        found = _holding(spec, programs, texts)
    return found


def _ranks_of_near(
    near: Sequence[PurePosixPath], alike: Sequence[PurePosixPath]
) -> dict[PurePosixPath, int]:
    """Return the rank of each file that was found without a pattern.

    Names that are less like the wanted one are candidates still, but no rivals.
    """
    best = _plain(near[0].name)
    if alike:
        return {path: int(_plain(path.name) != best) for path in alike}
    return dict.fromkeys(near, 0)


def _candidates(
    spec: ArtifactSpec,
    paths: Sequence[PurePosixPath],
    texts: dict[str, str],
    programs: frozenset[str],
) -> Candidates:
    """Return the files of an artifact's names, each with the rank of the best name that it has."""
    ranks: dict[PurePosixPath, int] = {}
    for rank, patterns in enumerate(_names_by_rank(spec)):
        for path in paths:
            if path not in ranks and any(matches(pattern, path) for pattern in patterns):
                ranks[path] = rank
    worded = _holding(spec, list(ranks), texts) if spec.contains else ranks
    if spec.executable is not None:
        return Candidates(ranks, frozenset(worded))
    # No program itself, such as a launch file: the lab's is known by the programs that it starts.
    named = {path: _named_in(texts.get(str(path), ""), programs) for path in ranks}
    return Candidates(ranks, frozenset(worded), named)


def _named_in(text: str, programs: frozenset[str]) -> int:
    return sum(re.search(rf"\b{re.escape(program)}\b", text) is not None for program in programs)


def _names_by_rank(spec: ArtifactSpec) -> list[list[str]]:
    """Return the patterns of an artifact, best first; one name in the root and in any folder has one rank."""
    ranks: dict[str, list[str]] = {}
    for pattern in spec.find:
        ranks.setdefault(anywhere(pattern), []).append(pattern)
    return list(ranks.values())


def _chosen(
    fact: ArtifactFact, chooser: Chooser, files: Sequence[PurePosixPath], found_by: str
) -> ArtifactFact:
    """Return where an artifact was found, with the other files that could have been meant."""
    choice = chooser.choose(fact.name, files)
    others = [str(path) for path in files if path != choice.path]
    passed_over = list(map(str, choice.others))
    return replace(
        fact,
        path=str(choice.path),
        found_by=found_by,
        candidates=others,
        passed_over=passed_over,
        why=choice.why if passed_over else "",
        is_open=choice.is_open,
    )


def _holding(
    spec: ArtifactSpec, paths: list[PurePosixPath], texts: dict[str, str]
) -> list[PurePosixPath]:
    """Return the files that hold an artifact by their contents."""
    wanted = spec.contains
    return [
        path
        for path in paths
        if wanted and all(words in texts.get(str(path), "") for words in wanted)
    ]


def by_pattern(name: str, spec: ArtifactSpec, paths: Sequence[PurePosixPath]) -> ArtifactFact:
    """Find an artifact by the rubric's patterns, and the files of its name as candidates."""
    for patterns in _names_by_rank(spec):
        hits = [path for path in paths if any(matches(pattern, path) for pattern in patterns)]
        if hits:
            first, *others = sorted(hits, key=lambda p: (len(p.parts), str(p)))
            return ArtifactFact(name, spec.file, str(first), "name", list(map(str, others)))
    return ArtifactFact(name, spec.file)


def _by_entry_point(
    executable: str | None, packages: list[PackageFact], texts: dict[str, str]
) -> str | None:
    """Return the file that a package runs as an executable of the artifact's name, whatever the file is called."""
    for package in packages:
        target = package.executables.get(executable or "", "")
        module = PurePosixPath(package.path) / target.partition(":")[0].replace(".", "/")
        path = f"{module}.py" if ":" in target else target
        if path in texts:
            return path
    return None


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", re.sub(r"\.py$", "", name.lower()))


def _similar(spec: ArtifactSpec, free: list[PurePosixPath]) -> list[PurePosixPath]:
    def ratio(path: PurePosixPath) -> float:
        return difflib.SequenceMatcher(None, _plain(spec.file), _plain(path.name)).ratio()

    return sorted(
        (p for p in free if ratio(p) >= NEAR_MISS_RATIO), key=lambda p: (-ratio(p), str(p))
    )
