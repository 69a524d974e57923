"""Gaps between a student's machine and the grading computer: missing libraries, and newer syntax.

A person decides about a gap. A program's output about it can be made up; the evidence is the submitted source, and the
modules that the grader itself did not find when it recorded.
"""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Mapping
from pathlib import PurePosixPath

from grader.evidence.crash.causes import Diagnosis
from grader.evidence.known_packages import known_packages
from grader.evidence.newer_python import python_needed
from grader.evidence.text.syntax import normalise, tree_of
from grader.recording.submission import SubmissionRecord

_WHO_DECIDES = "Your instructor will run it by hand."
#: Sentences to students about the person who decides.
_TO_STUDENTS = re.compile(r" ?Your instructor [^.]{1,100}\.")
_NEEDS = "It needs {module}, which the grading computer lacks."
_NEEDED = re.compile(re.escape(_NEEDS).replace(r"\{module\}", r"([\w.]+)"))
#: Names of NumPy 1.26 that NumPy 2 removed, by its migration guide.
_ONLY_IN_NUMPY_1 = frozenset([
    "NaN", "Inf", "Infinity", "infty", "PINF", "NINF", "PZERO", "NZERO", "float_", "complex_", "string_",
    "unicode_", "cfloat", "longfloat", "singlecomplex", "longcomplex", "clongfloat", "cast", "source",
    "lookfor", "who", "fastCopyAndTranspose", "set_numeric_ops", "add_docstring", "add_newdoc", "asfarray",
    "byte_bounds", "compat", "deprecate", "deprecate_with_doc", "disp", "find_common_type", "issctype",
    "issubclass_", "issubsctype", "mat", "maximum_sctype", "msort", "nbytes", "obj2sctype", "product",
    "cumproduct", "sometrue", "alltrue", "round_", "recfromcsv", "recfromtxt", "safe_eval", "sctype2char",
    "sctypes", "tracemalloc_domain",
])  # fmt: skip
_INTERFACES = (".msg", ".srv", ".action")
_IMPORT_KINDS = ("missing-module", "missing-interface", "missing-sibling")
_IMPORT_LINE = re.compile(r"^[ \t]*(?:from|import)[ \t](.*)$", re.MULTILINE)
#: First line, last line and top-level module of an import.
_Import = tuple[int, int, str]


def modules_to_look_for(submission: SubmissionRecord) -> list[str]:
    """Return the modules that a submission may import, and that may be missing without a fault of its own."""
    named: set[str] = set()
    for text in _sources(submission).values():
        named.update(re.findall(r"\w+", text))
    external = known_packages() | interface_packages(submission)
    return sorted(external & named - _own_modules(submission))


def interface_packages(submission: SubmissionRecord) -> set[str]:
    """Return the packages of a submission with interfaces, which must be built before they are imported."""
    folders = set()
    for file in submission.files:
        if file.path.endswith(_INTERFACES):
            folders.add(PurePosixPath(file.path).parent.parent)
    found = set()
    for package in submission.packages:
        if PurePosixPath(package.path) in folders:
            found.add(package.name)
    return found


def environment_gap(
    found: Diagnosis | None, submission: SubmissionRecord, program: str | None
) -> str | None:
    """Say why a program that failed here may run elsewhere; None if it would fail there too.

    Parameters
    ----------
    found
        Diagnosis of the program.
    submission
        The submission.
    program
        File of the program.
    """
    if found is None or found.file is None:
        return None
    if found.file not in _reached_from(program, submission):
        return None
    if found.kind in _IMPORT_KINDS and found.exception_type == "ModuleNotFoundError":
        return absent_module(found.subject, found.file, found.line, submission)
    text = submission.texts.get(found.file, "")
    if found.kind == "missing-name":
        return _unbuilt_package(found.file, found.line, submission)
    return _other_version(found, found.file, text)


def _other_version(found: Diagnosis, file: str, text: str) -> str | None:
    """Say that a file is for another version of NumPy or of Python; None if it is not."""
    if found.kind == "removed-from-numpy":
        return _removed_name(found, file, text)
    if found.kind == "syntax-error":
        return _newer_syntax(file, found.line, text)
    return None


def _newer_syntax(file: str, line: int | None, text: str) -> str | None:
    """Say that a file needs a newer Python; None if no Python accepts it."""
    needed = python_needed(text)
    if not needed:
        return None
    at = f" (line {line})" if line else ""
    problem = f"uses syntax of Python {needed} or later, which the grading computer lacks"
    return f"{file}{at} {problem}. {_WHO_DECIDES}"


def _removed_name(found: Diagnosis, file: str, text: str) -> str | None:
    """Say that a program uses a name that only older versions of NumPy have; None if its line does not show the name."""
    lines = text.split("\n")
    line = found.line or 0
    name = found.subject
    is_shown = any(f".{name}" in each for each in lines[line - 1 : line])
    if not is_shown or name not in _ONLY_IN_NUMPY_1:
        return None
    problem = f"uses np.{name}, which the NumPy of ROS 2 Jazzy has and NumPy 2 of the grading computer lacks"
    return f"{file} (line {line}) {problem}. {_WHO_DECIDES}"


def _unbuilt_package(file: str, line: int | None, submission: SubmissionRecord) -> str | None:
    """Say that a line imports from a package that was not built; Python takes its folder for an empty module."""
    imported = set()
    for first, last, name in _imports(submission.texts.get(file, "")):
        if first <= (line or 0) <= last:
            imported.add(name)
    not_built = submission.not_built or {}
    names = sorted(imported & not_built.keys())
    if not names:
        return None
    return absent_module(names[0], file, line, submission)


def absent_module(
    module: str, file: str, line: int | None, submission: SubmissionRecord
) -> str | None:
    """Say that the import at a line cannot work here; None unless the grader's own evidence shows it.

    The evidence: the source imports the module there, and the grader looked for it in vain. It must be a known package,
    or a package of the submission that has to be built.
    """
    name = module.split(".")[0]
    text = submission.texts.get(file, "")
    if name in _own_modules(submission):
        return None
    if not _is_imported_at(module, text, line or 0):
        return None
    if submission.absent_modules is not None and name not in submission.absent_modules:
        return None
    if name in known_packages():
        return f"{_NEEDS.format(module=module)} {_WHO_DECIDES}"
    not_built = submission.not_built
    if not_built is None:
        not_built = dict.fromkeys(interface_packages(submission), "")
    if name not in not_built:
        return None
    why = ""
    if not_built[name]:
        why = f": {not_built[name]}"
    return (
        f"It needs the interfaces of the package {name}, which were not built{why}. {_WHO_DECIDES}"
    )


def for_teachers(reason: str) -> str:
    """Return a reason of an undecided check in words for a teacher.

    Example
    -------
    `It needs tabulate, which the grading computer lacks. ...` gets the commands that install it and grade again.
    """
    needed = _NEEDED.search(reason)
    text = _TO_STUDENTS.sub("", reason.removeprefix("Not your fault: "))
    text = f"{text[:1].upper()}{text[1:]}"
    if needed is None:
        return text
    name = needed[1].split(".")[0]
    return (
        f"{text} Install it for students' programs (`pip install` with the name of the package of {name}, in the "
        "environment of `--python`, by default the grader's own), and grade this submission again; or run it by hand."
    )


def _is_imported_at(module: str, text: str, line: int) -> bool:
    """Return whether a line imports a module, or uses a missing part of an imported package."""
    name, _, rest = module.partition(".")
    imports = [each for each in _imports(text) if each[2] == name]
    for first, last, _ in imports:
        if first <= line <= last:
            return True
    if not imports or not rest:
        return False
    used = text.splitlines()[line - 1 : line]
    return rest.rsplit(".", 1)[-1] in "".join(used)


def _sources(submission: SubmissionRecord) -> Mapping[str, str]:
    return {path: text for path, text in submission.texts.items() if path.endswith(".py")}


def _own_modules(submission: SubmissionRecord) -> set[str]:
    """Return the names of the submission's own Python files."""
    return {PurePosixPath(file.path).stem for file in submission.files if file.path.endswith(".py")}


@functools.lru_cache(maxsize=256)
def _imports(text: str) -> tuple[_Import, ...]:
    """Return the imports of a text."""
    tree = tree_of(normalise(text))
    if tree is None:
        return ()
    found: list[_Import] = []
    for node in ast.walk(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            for module in _modules_of(node):
                name = module.split(".")[0]
                found.append((node.lineno, node.end_lineno or node.lineno, name))
    return tuple(found)


def _modules_of(node: ast.Import | ast.ImportFrom) -> list[str]:
    """Return the modules that a statement imports, without relative ones."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if node.module and not node.level:
        return [node.module]
    return []


def _reached_from(program: str | None, submission: SubmissionRecord) -> set[str]:
    """Return a program's file, and the files of the submission that it imports: other files excuse nothing."""
    texts = _sources(submission)
    by_stem: dict[str, list[str]] = {}
    for path in texts:
        by_stem.setdefault(PurePosixPath(path).stem, []).append(path)
    found = {program} if program else set()
    queue = list(found)
    while queue:
        text = texts.get(queue.pop(), "")
        lines = " ".join(_IMPORT_LINE.findall(text))
        for name in set(re.findall(r"\w+", lines)):
            # The files of a name are queued once, by its first import.
            new = set(by_stem.pop(name, ())) - found
            found |= new
            queue += new
    return found
