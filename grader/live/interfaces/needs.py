"""Interface packages that a submission and its lab need, and the sessions affected by a missing one."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from confine.interpreters import OWN_INTERPRETER
from confine.isolation import Isolation
from grader.lab import kept_lab
from grader.lab.rubric import Rubric, SessionSpec
from grader.live.interfaces.build import Built, provide, shipped_for
from grader.live.sandbox.environment import ask_interpreter
from grader.recording.submission import SubmissionRecord
from grader.submission.packages.interfaces import interface_packages
from ros_bag.interfaces import InterfacePackage

_SOURCES = (".py", ".msg", ".srv", ".action")


@dataclass(frozen=True)
class Needed:
    """Packages of interfaces: the lab's, the grader's, and the student's."""

    labs: Sequence[InterfacePackage]
    shipped: Sequence[InterfacePackage]
    students: Sequence[InterfacePackage]

    @property
    def packages(self) -> list[InterfacePackage]:
        """All packages; of several with one name, the first counts."""
        return [*self.labs, *self.shipped, *self.students]


def needed_interfaces(
    rubric: Rubric, submission: SubmissionRecord, sessions: Sequence[str]
) -> Needed:
    """Return the packages that a lab and a submission define, and packages of the grader that they name.

    The lab's packages are needed if a recorded session or a submitted source names one of them.
    """
    sources = [text for path, text in submission.texts.items() if path.endswith(_SOURCES)]
    shipped = shipped_for([rubric.text, *kept_lab.files_of(rubric).values(), *sources])
    naming = list(sources)
    for name in sessions:
        naming.append(_texts_of(rubric.sessions[name], rubric))
    labs = rubric.interface_packages
    if not any(_is_named(package, naming) for package in labs):
        labs = []
    return Needed(labs, shipped, list(interface_packages(submission)))


def _is_named(package: InterfacePackage, texts: Iterable[str]) -> bool:
    return any(package.name in text for text in texts)


def provide_interfaces(
    needed: Needed,
    rubric: Rubric,
    submission: SubmissionRecord,
    folder: Path,
    isolation: Isolation,
    interpreter: Path,
    on_progress: Callable[[], object] = lambda: None,
) -> dict[str, str]:
    """Build the needed packages into a folder, and note missing ones in the submission's record.

    Of packages with the same name, the lab's has priority over the grader's, and both over a student's. For
    `on_progress` see `provide`.

    Returns
    -------
    A sentence about the missing package of each affected session.
    """
    ours = [*needed.labs, *needed.shipped]
    if needed.packages and not _is_like_ours(interpreter):
        why = "students' programs run with another Python than the grader's"
        built = Built(missing=dict.fromkeys(_names(needed.packages), why))
    else:
        built = provide(ours, folder, isolation, on_progress=on_progress)
        # Neither a mistake in one of these nor its effects are the student's.
        built = Built(built.prefixes, {**built.missing, **built.invalid}, took_s=built.took_s)
        built = provide(needed.students, folder, isolation, built, on_progress)
    submission.not_built = built.missing
    if submission.absent_modules is not None:
        absent = {*submission.absent_modules, *built.missing} - built.prefixes.keys()
        submission.absent_modules = sorted(absent)
    _note_problems(needed, built, submission)
    lost = {name: why for name, why in built.missing.items() if name in _names(ours)}
    return _affected_sessions(lost, rubric)


def _affected_sessions(lost: Mapping[str, str], rubric: Rubric) -> dict[str, str]:
    """Return a sentence for each session that names a missing package."""
    affected: dict[str, str] = {}
    if not lost:
        return affected
    for spec in rubric.sessions.values():
        text = _texts_of(spec, rubric)
        for name, why in lost.items():
            if name in text:
                affected[spec.id] = f"{name} could not be built on the grading computer: {why}"
    return affected


def _is_like_ours(interpreter: Path) -> bool:
    """Return whether an interpreter can load modules compiled for the grader's interpreter."""
    if interpreter == OWN_INTERPRETER:
        return True
    own = f"{sys.version_info.major} {sys.version_info.minor}\n"
    return ask_interpreter(interpreter, "import sys; print(*sys.version_info[:2])") == own


def _names(packages: Iterable[InterfacePackage]) -> set[str]:
    return {package.name for package in packages}


def _note_problems(needed: Needed, built: Built, submission: SubmissionRecord) -> None:
    """Note problems of a student's own packages."""
    ours = _names([*needed.labs, *needed.shipped])
    for package in submission.packages:
        if package.name not in _names(needed.students):
            continue
        if package.name in ours:
            package.problems.append(
                "a package of this name belongs to the lab; that one counts, not yours"
            )
        elif package.name in built.invalid:
            package.problems.append(
                f"`colcon build` cannot make its interfaces: {built.invalid[package.name]}"
            )
        elif package.name in built.missing:
            package.problems.append(f"its interfaces were not built: {built.missing[package.name]}")


def _texts_of(spec: SessionSpec, rubric: Rubric) -> str:
    """Return the text of a session's steps, and of the lab's programs that it starts."""
    started = {step.parameters.get("reference") for step in spec.steps if step.kind == "start"}
    texts = kept_lab.files_of(rubric)
    parts = [json.dumps([step.parameters for step in spec.steps])]
    for name in sorted(filter(None, started)):
        parts.append(texts.get(rubric.reference[name].file, ""))
    return "".join(parts)
