"""Artifacts of the rubric in an extracted submission, and static facts. No student's file is executed or imported."""

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
from grader.submission.file_names import MAX_TEXT_BYTES, TEXT_SUFFIXES, displayed
from grader.submission.packages.colcon import find_packages
from grader.submission.packages.compiled import compiled_programs
from grader.submission.submission_time import set_submission_time
from grader.submission.texts import decode_text, given_texts, is_text

_NOTEBOOK = ".ipynb"
#: Characters of all texts that are read; the largest texts beyond are left out.
MAX_TEXTS_CHARACTERS = 8 * 1024 * 1024
#: Likeness (difflib's ratio) from which a file name counts as a misspelt other one.
NEAR_MISS_RATIO = 0.75


def read_submission(intake: Intake, rubric: Rubric) -> SubmissionRecord:
    """Find the rubric's artifacts in a submission and collect static facts.

    Raises
    ------
    SubmissionError
        If the submission holds nothing that the rubric asks for, or a file that grade may not read. This costs no
        points.
    """
    source = intake.source
    record = SubmissionRecord(
        name=source.name, left_out=list(intake.left_out), source=source.origin
    )
    record.student_id = source.student_id
    record.identity = source.identity
    set_submission_time(record, source.submission_time)
    collect_files(intake.folder, record)
    record.given_texts = given_texts(rubric)
    if not record.files:
        raise SubmissionError(
            "the submission is empty",
            location=source.location,
            remedy="Put the lab's files into it.",
        )
    names = [file.path for file in record.files]
    record.packages = find_packages(record.texts, names)
    record.artifacts = _artifacts(record, rubric)
    _require_readable(intake, record)
    if not any(_shows_lab(fact, record, rubric) for fact in record.artifacts):
        raise _foreign(source, rubric, names)
    record.sha256 = _digest(record.files)
    return record


def _artifacts(record: SubmissionRecord, rubric: Rubric) -> list[ArtifactFact]:
    """Return the artifacts: those that were found, and the missing ones that are required."""
    paths = [PurePosixPath(file.path) for file in record.files]
    # The lab's package comes first.
    packages = sorted(record.packages, key=lambda package: package.name != rubric.lab.package)
    found = []
    for fact in find_artifacts(paths, record, rubric):
        fact.bonus = fact.name in rubric.bonus_artifacts
        if fact.path is None:
            executable = rubric.artifacts[fact.name].executable
            fact.path = _by_entry_point(executable, packages, record)
            if fact.path is not None:
                fact.found_by = "near miss"
        if fact.path is not None or not fact.bonus:
            found.append(fact)
    return found


def _foreign(source: SubmissionSource, rubric: Rubric, names: Sequence[str]) -> SubmissionError:
    """Return the error of a submission without any of the lab's files; a notebook is named."""
    wanted = []
    for name, spec in rubric.artifacts.items():
        if name not in rubric.bonus_artifacts:
            wanted.append(spec.file)
    notebooks = [name for name in names if name.lower().endswith(_NOTEBOOK)]
    if notebooks:
        problem = (
            f"its programs are in a notebook, {displayed(notebooks[0])}, and nodes start from files"
        )
        remedy = f"Hand in the programs as files: {', '.join(wanted)}."
        return SubmissionError(problem, location=source.location, remedy=remedy)
    return SubmissionError(
        f"nothing in it looks like a submission to lab {rubric.lab.id}; it may be of another lab",
        location=source.location,
        remedy=f"At least one of these files is expected: {', '.join(wanted)}. "
        "Another lab is given by --lab; for a folder of several submissions, add --each.",
    )


def _digest(files: Iterable[FileFact]) -> str:
    """Return a digest of the paths and contents of files."""
    digest = hashlib.sha256()
    for file in sorted(files, key=lambda file: file.path):
        digest.update(f"{file.path}\0{file.sha256}\n".encode())
    return digest.hexdigest()


def names_of(spec: ArtifactSpec) -> frozenset[str]:
    """Return the names that the rubric gives an artifact's file, without patterns."""
    names = set()
    for pattern in (spec.file, *spec.find):
        name = PurePosixPath(pattern).name
        if not re.search(r"[*?\[]", name):
            names.add(name)
    return frozenset(names)


def _shows_lab(fact: ArtifactFact, record: SubmissionRecord, rubric: Rubric) -> bool:
    """Return whether an artifact shows that a submission is one to this lab.

    A launch file that only a pattern finds, and an extension found by its contents, can belong to any lab. They must
    name one of the lab's programs.
    """
    if fact.path is None:
        return False
    spec = rubric.artifacts[fact.name]
    is_common = spec.executable is None and fact.found_by == "name"
    is_common_extension = fact.bonus and fact.found_by != "name"
    if not is_common and not is_common_extension:
        return True
    if PurePosixPath(fact.path).name in names_of(spec):
        return True
    programs = _programs_of(rubric)
    text = record.texts.get(fact.path, "")
    return not programs or any(program in text for program in programs)


def _programs_of(rubric: Rubric) -> frozenset[str]:
    """Return the names of the lab's programs."""
    executables = (spec.executable for spec in rubric.artifacts.values())
    return frozenset(filter(None, executables))


def _require_readable(intake: Intake, record: SubmissionRecord) -> None:
    """Raise SubmissionError if a grade may depend on a file or folder that may not be read.

    A grade depends on a source or a text, and on a folder if a file of the lab is missing.
    """
    is_missing = any(fact.path is None for fact in record.artifacts)
    closed = []
    for name in intake.unreadable:
        is_folder = name.endswith("/")
        is_text = not is_folder and PurePosixPath(name).suffix.lower() in TEXT_SUFFIXES
        if is_text or (is_folder and is_missing):
            closed.append(name)
    if not closed:
        return
    more = ""
    if len(closed) > 1:
        more = f" and {len(closed) - 1} more"
    raise SubmissionError(
        f"{displayed(closed[0])}{more} may not be read, so that no fair score exists",
        location=intake.source.location,
        remedy="Give yourself the right to read it (chmod -R u+rX), or grade as the user that it belongs to.",
    )


def read_submission_folder(folder: Path, rubric: Rubric) -> SubmissionRecord:
    """Read a folder of the project's own as `read_submission` does; a student's is extracted first."""
    source = SubmissionSource(folder.resolve().name, (), location=str(folder))
    return read_submission(Intake(folder, source), rubric)


def collect_files(folder: Path, record: SubmissionRecord) -> None:
    """Add the files of a folder with their hashes to a record, and the texts that can be read."""
    paths = []
    for path in folder.rglob("*"):
        if path.is_file() and not path.is_symlink():
            paths.append(path.relative_to(folder))
    for path in sorted(paths, key=_files_first):
        content = (folder / path).read_bytes()
        digest = hashlib.sha256(content).hexdigest()
        name = path.as_posix()
        record.files.append(FileFact(name, len(content), digest))
        is_read = path.suffix.lower() in TEXT_SUFFIXES and len(content) <= MAX_TEXT_BYTES
        if is_read and is_text(content):
            record.texts[name] = decode_text(content)
    _limit_texts(record.texts)


def _files_first(path: Path) -> list[tuple[bool, str]]:
    """Return a key that sorts the files of a folder before the folders in it."""
    key = [(True, part) for part in path.parts[:-1]]
    key.append((False, path.name))
    return key


def _nearest_to_root(path: PurePosixPath) -> tuple[int, str]:
    return len(path.parts), str(path)


def _limit_texts(texts: dict[str, str]) -> None:
    """Drop the largest texts if all of them would be too much to judge; people write smaller ones."""
    total = sum(map(len, texts.values()))

    def largest_first(path: str) -> tuple[int, str]:
        return -len(texts[path]), path

    for path in sorted(texts, key=largest_first):
        if total <= MAX_TEXTS_CHARACTERS:
            return
        total -= len(texts.pop(path))


def find_artifacts(
    paths: list[PurePosixPath], record: SubmissionRecord, rubric: Rubric
) -> list[ArtifactFact]:
    """Find each artifact: by the rubric's patterns, else by a similar name, else by its contents.

    One file can hold several artifacts, such as nodes in one process. A bonus artifact is not found by a similar name:
    it is optional, and the file is more likely another one.
    """
    specs = rubric.artifacts
    texts = record.texts
    programs = _programs_of(rubric)
    found = {}
    facts = {}
    for name, spec in specs.items():
        found[name] = _candidates(spec, paths, texts, programs)
        facts[name] = ArtifactFact(name, spec.file)
    chooser = _chooser(found, record, rubric)
    for name, candidates in found.items():
        if candidates.ranks:
            facts[name] = _chosen(facts[name], chooser, list(candidates.ranks), "name")
    for name, spec in specs.items():
        if facts[name].path is not None:
            continue
        free = _free_programs(paths, facts.values())
        alike: list[PurePosixPath] = []
        if name not in rubric.bonus_artifacts:
            alike = _similar(spec, free)
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
    folders = []
    for fact in record.packages:
        if fact.name == package:
            folders.append(PurePosixPath(fact.path))
    candidates: set[PurePosixPath] = set()
    for each in found.values():
        candidates.update(each.ranks)
    installed: set[PurePosixPath] = set()
    for fact in record.packages:
        build_files = _build_files(record, fact.path)
        for path in candidates:
            if _is_named(path, fact.path, build_files):
                installed.add(path)
    return Chooser(found, hashes, package, folders, installed)


def _build_files(record: SubmissionRecord, package: str) -> str:
    """Return the texts of a package's build files, given its folder."""
    texts = ""
    for name in ("setup.py", "CMakeLists.txt"):
        path = f"{package}/{name}".lstrip("/")
        texts += record.texts.get(path, "")
    return texts


def _is_named(path: PurePosixPath, package: str, build_files: str) -> bool:
    """Return whether the build files of a package name the folder of one of its files."""
    if not path.is_relative_to(package):
        return False
    folder = re.escape(str(path.parent.relative_to(package)))
    named = re.search(rf"['\"\s]{folder}['\"/\s)]", build_files)
    return named is not None


def _free_programs(
    paths: Sequence[PurePosixPath], facts: Iterable[ArtifactFact]
) -> list[PurePosixPath]:
    """Return the Python files and files without suffix that are not artifacts yet."""
    taken = {fact.path for fact in facts}
    free = []
    for path in paths:
        if path.suffix in (".py", "") and str(path) not in taken:
            free.append(path)
    return free


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

    Names that are less like the wanted one remain candidates, but no rivals.
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
    """Return the files with a name of an artifact, each with the rank of its best name."""
    ranks: dict[PurePosixPath, int] = {}
    for rank, patterns in enumerate(_names_by_rank(spec)):
        for path in paths:
            if path not in ranks and _matches_any(patterns, path):
                ranks[path] = rank
    worded = list(ranks)
    if spec.contains:
        worded = _holding(spec, worded, texts)
    if spec.executable is not None:
        return Candidates(ranks, frozenset(worded))
    # A launch file, for example, is known by the programs that it starts.
    named = {path: _named_in(texts.get(str(path), ""), programs) for path in ranks}
    return Candidates(ranks, frozenset(worded), named)


def _named_in(text: str, programs: frozenset[str]) -> int:
    named = 0
    for program in programs:
        if re.search(rf"\b{re.escape(program)}\b", text):
            named += 1
    return named


def _matches_any(patterns: Iterable[str], path: PurePosixPath) -> bool:
    return any(matches(pattern, path) for pattern in patterns)


def _names_by_rank(spec: ArtifactSpec) -> list[list[str]]:
    """Return the patterns of an artifact, best first; a name in the root and in any folder has one rank."""
    ranks: dict[str, list[str]] = {}
    for pattern in spec.find:
        ranks.setdefault(anywhere(pattern), []).append(pattern)
    return list(ranks.values())


def _chosen(
    fact: ArtifactFact, chooser: Chooser, files: Sequence[PurePosixPath], found_by: str
) -> ArtifactFact:
    """Return an artifact with the chosen file, and the other files that could be meant."""
    choice = chooser.choose(fact.name, files)
    others = [str(path) for path in files if path != choice.path]
    passed_over = list(map(str, choice.others))
    why = choice.why if passed_over else ""
    return replace(
        fact,
        path=str(choice.path),
        found_by=found_by,
        candidates=others,
        passed_over=passed_over,
        why=why,
        is_open=choice.is_open,
    )


def _holding(
    spec: ArtifactSpec, paths: list[PurePosixPath], texts: dict[str, str]
) -> list[PurePosixPath]:
    """Return the files that hold an artifact by their contents."""
    found: list[PurePosixPath] = []
    if not spec.contains:
        return found
    for path in paths:
        text = texts.get(str(path), "")
        if all(words in text for words in spec.contains):
            found.append(path)
    return found


def by_pattern(name: str, spec: ArtifactSpec, paths: Sequence[PurePosixPath]) -> ArtifactFact:
    """Find an artifact by the rubric's patterns, and the files of its name as candidates."""
    for patterns in _names_by_rank(spec):
        hits = [path for path in paths if _matches_any(patterns, path)]
        if hits:
            first, *others = sorted(hits, key=_nearest_to_root)
            return ArtifactFact(name, spec.file, str(first), "name", list(map(str, others)))
    return ArtifactFact(name, spec.file)


def _by_entry_point(
    executable: str | None, packages: list[PackageFact], record: SubmissionRecord
) -> str | None:
    """Return the file that a package runs, or compiles, as an executable with the artifact's name.

    The name of the file does not count.
    """
    if executable is None:
        return None
    files = set()
    for file in record.files:
        files.add(file.path)
    for package in packages:
        target = package.executables.get(executable, "")
        module = PurePosixPath(package.path) / target.partition(":")[0].replace(".", "/")
        path = target
        if ":" in target:
            path = f"{module}.py"
        if path in record.texts:
            return path
        source = compiled_programs(package, record.texts).get(executable)
        if source in files:
            return source
    return None


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", re.sub(r"\.py$", "", name.lower()))


def _similar(spec: ArtifactSpec, free: list[PurePosixPath]) -> list[PurePosixPath]:
    """Return the files with a similar name, the most similar one first."""
    wanted = _plain(spec.file)
    found = []
    for path in free:
        ratio = difflib.SequenceMatcher(None, wanted, _plain(path.name)).ratio()
        if ratio >= NEAR_MISS_RATIO:
            found.append((-ratio, str(path), path))
    return [path for _, _, path in sorted(found)]
