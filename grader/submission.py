"""A folder of a student's files → the artifacts that the rubric asks for, and static facts.

Nothing is executed or imported here; links are never followed.
"""

from __future__ import annotations

import difflib
import fnmatch
import hashlib
import os
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from grader.errors import SubmissionError
from grader.packages import find_packages
from grader.recording.submission import ArtifactFact, FileFact, SubmissionRecord
from grader.rubric import ArtifactSpec, Rubric

#: Folders that tools make; a copy of a student's file in them is not the student's file.
TOOL_FOLDERS = frozenset(
    {
        "build",
        "install",
        "log",
        "__pycache__",
        ".git",
        ".venv",
        "venv",
        "node_modules",
        ".vscode",
        ".idea",
        "__MACOSX",
    }
)
#: Files beyond these limits are left out, and the report says so.
MAX_FILES = 2_000
MAX_FILE_BYTES = 8 * 1024 * 1024
MAX_TEXT_BYTES = 512 * 1024
#: Kinds of files whose text the judging half may read.
TEXT_SUFFIXES = frozenset(
    {".py", ".md", ".rst", ".txt", ".xml", ".cfg", ".toml", ".yaml", ".yml", ".launch", ".org", ".adoc", ""}
)
#: How similar two file names must be for one to count as a misspelling of the other (difflib's ratio).
NEAR_MISS_RATIO = 0.75


def read_submission_folder(folder: Path, rubric: Rubric) -> SubmissionRecord:
    """Find the rubric's artifacts in a folder and collect static facts.

    Raises
    ------
    SubmissionError
        If the folder is missing, empty, or holds nothing that the rubric asks for.
    """
    if not folder.exists():
        raise SubmissionError(
            "there is no such submission",
            where=str(folder),
            remedy=f"Check the path. {_neighbours(folder)}".strip(),
        )
    if not folder.is_dir():
        raise SubmissionError(
            "a submission is a folder",
            where=str(folder),
            remedy="Unpack the archive and give the folder with the student's files.",
        )
    record = SubmissionRecord(name=folder.resolve().name)
    _collect_files(folder, record)
    if not record.files:
        raise SubmissionError("the submission is empty", where=str(folder), remedy="Put the lab's files into it.")
    paths = [PurePosixPath(f.path) for f in record.files]
    record.artifacts = find_artifacts(paths, record.texts, rubric.artifacts)
    if all(a.path is None for a in record.artifacts):
        wanted = ", ".join(spec.file for spec in rubric.artifacts.values())
        raise SubmissionError(
            "nothing in this folder looks like a submission",
            where=str(folder),
            remedy=f"At least one of these files is expected: {wanted}. "
            "For a folder of several submissions, name each of them.",
        )
    record.packages = find_packages(record.texts, [f.path for f in record.files])
    record.sha256 = _digest_of(record.files)
    return record


def _neighbours(folder: Path) -> str:
    parent = folder.parent
    if not parent.is_dir():
        return ""
    names = sorted(p.name for p in parent.iterdir() if p.is_dir() and not p.name.startswith("."))
    near = difflib.get_close_matches(folder.name, names, n=3, cutoff=0.5) or names[:5]
    return f"In {parent}/ there is: {', '.join(near)}." if near else ""


def _walk(folder: Path) -> Iterator[tuple[str, Path]]:
    for root, folders, files in os.walk(folder, followlinks=False):
        folders[:] = sorted(d for d in folders if d not in TOOL_FOLDERS and not (Path(root) / d).is_symlink())
        for name in sorted(files):
            path = Path(root) / name
            yield path.relative_to(folder).as_posix(), path


def _collect_files(folder: Path, record: SubmissionRecord) -> None:
    for relative, path in _walk(folder):
        shown = relative.encode("utf-8", "backslashreplace").decode("utf-8")
        if path.is_symlink() or not path.is_file():
            record.left_out.append(f"{shown}: not a regular file")
        elif path.stat().st_size > MAX_FILE_BYTES:
            record.left_out.append(f"{shown}: larger than {MAX_FILE_BYTES // 1024 // 1024} MiB")
        elif path.suffix in (".pyc", ".pyo"):
            record.left_out.append(f"{shown}: compiled Python")
        elif len(record.files) >= MAX_FILES:
            record.left_out.append(f"{shown}: more than {MAX_FILES} files")
            return
        elif (content := _content_of(path)) is None:
            record.left_out.append(f"{shown}: not readable")
        else:
            record.files.append(FileFact(shown, len(content), hashlib.sha256(content).hexdigest()))
            if path.suffix.lower() in TEXT_SUFFIXES and len(content) <= MAX_TEXT_BYTES and b"\0" not in content:
                record.texts[shown] = decode_text(content)


def _content_of(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


def decode_text(content: bytes) -> str:
    """Decode a text file as UTF-8 (with or without byte order mark), else as Latin-1; never fails."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _digest_of(files: list[FileFact]) -> str:
    digest = hashlib.sha256()
    for file in sorted(files, key=lambda f: f.path):
        digest.update(f"{file.path}\0{file.sha256}\n".encode())
    return digest.hexdigest()


def find_artifacts(
    paths: list[PurePosixPath], texts: dict[str, str], specs: dict[str, ArtifactSpec]
) -> list[ArtifactFact]:
    """Find each artifact: by the rubric's patterns, else by a similar name, else by its contents."""
    facts = {name: _by_pattern(name, spec, paths) for name, spec in specs.items()}
    for name, spec in specs.items():
        if facts[name].path is None:
            taken = {fact.path for fact in facts.values()}
            free = [p for p in paths if str(p) not in taken and p.suffix in (".py", "")]
            facts[name] = _by_similarity(name, spec, free, texts)
    return list(facts.values())


def _by_pattern(name: str, spec: ArtifactSpec, paths: list[PurePosixPath]) -> ArtifactFact:
    for pattern in spec.find:
        hits = [p for p in paths if _matches(p, pattern)]
        if hits:
            hits.sort(key=lambda p: (len(p.parts), str(p)))
            others = [str(p) for p in hits[1:]]
            return ArtifactFact(name, spec.file, str(hits[0]), "name", others)
    return ArtifactFact(name, spec.file)


def _matches(path: PurePosixPath, pattern: str) -> bool:
    if pattern.startswith("**/"):
        return fnmatch.fnmatchcase(path.name, pattern[3:])
    return fnmatch.fnmatchcase(str(path), pattern)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", re.sub(r"\.py$", "", name.lower()))


def _by_similarity(name: str, spec: ArtifactSpec, free: list[PurePosixPath], texts: dict[str, str]) -> ArtifactFact:
    def ratio(path: PurePosixPath) -> float:
        return difflib.SequenceMatcher(None, _plain(spec.file), _plain(path.name)).ratio()

    near = sorted((p for p in free if ratio(p) >= NEAR_MISS_RATIO), key=lambda p: (-ratio(p), str(p)))
    if not near and spec.contains:
        near = [p for p in free if all(words in texts.get(str(p), "") for words in spec.contains)]
    if not near:
        return ArtifactFact(name, spec.file)
    return ArtifactFact(name, spec.file, str(near[0]), "near miss", [str(p) for p in near[1:]])
