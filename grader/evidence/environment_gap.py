"""What would run on a student's machine and does not here: libraries that are missing, and newer syntax.

That is for a person to decide. What a program prints of it can be made up: the evidence is the submitted source, and
what the grader itself did not find when it recorded.
"""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Mapping
from pathlib import PurePosixPath

from grader.evidence.crash.causes import Diagnosis
from grader.evidence.known_packages import known_packages
from grader.evidence.newer_python import is_newer_python
from grader.evidence.text.syntax import normalise, tree_of
from grader.recording.submission import SubmissionRecord

_WHO_DECIDES = "Your instructor will run it by hand."
_INTERFACES = (".msg", ".srv", ".action")
_IMPORT_KINDS = ("missing-module", "missing-interface", "missing-sibling")


def modules_to_look_for(submission: SubmissionRecord) -> list[str]:
    """Return the modules that a submission may import, and that may be missing through no fault of its own."""
    named = {word for text in _sources(submission).values() for word in re.findall(r"\w+", text)}
    return sorted(
        (known_packages() | interface_packages(submission)) & named - _own_modules(submission)
    )


def interface_packages(submission: SubmissionRecord) -> set[str]:
    """Return the packages of a submission that define interfaces, which have to be built before they are imported."""
    defined = [PurePosixPath(f.path) for f in submission.files if f.path.endswith(_INTERFACES)]
    folders = {path.parent.parent for path in defined}
    return {
        package.name for package in submission.packages if PurePosixPath(package.path) in folders
    }


def environment_gap(
    found: Diagnosis | None, submission: SubmissionRecord, program: str | None
) -> str | None:
    """Say why a program, by its file, that ended with this diagnosis may run elsewhere; None if it would not."""
    if found is None or found.file is None or found.file not in _reached_from(program, submission):
        return None
    if found.kind in _IMPORT_KINDS and found.exception_type == "ModuleNotFoundError":
        return absent_module(found.subject, found.file, found.line, submission)
    if found.kind == "missing-name":
        # Its folder of definitions was taken for a module, in which nothing is.
        lines = _imports(submission.texts.get(found.file, ""))
        names = {name for first, last, name in lines if first <= (found.line or 0) <= last}
        not_built = sorted(names & (submission.not_built or {}).keys())
        return (
            absent_module(not_built[0], found.file, found.line, submission) if not_built else None
        )
    if found.kind != "syntax-error" or not is_newer_python(submission.texts.get(found.file, "")):
        return None
    at = f" (line {found.line})" if found.line else ""
    return f"{found.file}{at} uses syntax of Python 3.12 or later, which the grading computer lacks. {_WHO_DECIDES}"


def absent_module(
    module: str, file: str, line: int | None, submission: SubmissionRecord
) -> str | None:
    """Say that the import at a line cannot work where it was graded; None unless the grader's own evidence shows it.

    The source imports it there, the grader looked for it and did not find it, and it is a package that others have,
    or one of the submission's own that has to be built.
    """
    name = module.split(".")[0]
    text = submission.texts.get(file, "")
    imports = [(first, last) for first, last, found in _imports(text) if found == name]
    imported = any(first <= (line or 0) <= last for first, last in imports)
    # Of a package that is there in part, what lacks shows where it is used.
    used = "." in module and module.rsplit(".", 1)[1] in "".join(
        text.splitlines()[(line or 0) - 1 : line]
    )
    if not (imported or (imports and used)) or name in _own_modules(submission):
        return None
    if submission.absent_modules is not None and name not in submission.absent_modules:
        return None
    if name in known_packages():
        return f"It needs {module}, which the grading computer lacks. {_WHO_DECIDES}"
    not_built = submission.not_built
    if not_built is None:
        not_built = dict.fromkeys(interface_packages(submission), "")
    if name in not_built:
        why = f": {not_built[name]}" if not_built[name] else ""
        return f"It needs the interfaces of the package {name}, which were not built{why}. {_WHO_DECIDES}"
    return None


def _sources(submission: SubmissionRecord) -> Mapping[str, str]:
    return {path: text for path, text in submission.texts.items() if path.endswith(".py")}


def _own_modules(submission: SubmissionRecord) -> set[str]:
    """Return the names of the submission's own Python files."""
    return {PurePosixPath(file.path).stem for file in submission.files if file.path.endswith(".py")}


@functools.lru_cache(maxsize=256)
def _imports(text: str) -> tuple[tuple[int, int, str], ...]:
    """Return the first and last line of each import with the top-level module that it imports."""
    tree = tree_of(normalise(text))
    found: list[tuple[int, int, str]] = []
    for node in ast.walk(tree) if tree is not None else ():
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            whole = (
                [node.module]
                if isinstance(node, ast.ImportFrom) and node.module and not node.level
                else []
            )
            modules = (
                [alias.name for alias in node.names] if isinstance(node, ast.Import) else whole
            )
            found += [
                (node.lineno, node.end_lineno or node.lineno, name.split(".")[0])
                for name in modules
            ]
    return tuple(found)


_IMPORT_LINE = re.compile(r"^[ \t]*(?:from|import)[ \t](.*)$", re.MULTILINE)


def _reached_from(program: str | None, submission: SubmissionRecord) -> set[str]:
    """Return a program's file, and those of the submission that it imports: others excuse nothing."""
    texts, found = _sources(submission), {program} if program else set()
    by_stem: dict[str, list[str]] = {}
    for path in texts:
        by_stem.setdefault(PurePosixPath(path).stem, []).append(path)
    queue = list(found)
    while queue:
        lines = " ".join(_IMPORT_LINE.findall(texts.get(queue.pop(), "")))
        # What a name stands for is queued once, however many files import it.
        new = {
            path for name in set(re.findall(r"\w+", lines)) for path in by_stem.pop(name, ())
        } - found
        found |= new
        queue += new
    return found
