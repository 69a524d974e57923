"""Which interface packages a submission and its lab need, and what follows where one of them cannot be had."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from confine.interpreters import OWN_INTERPRETER
from confine.isolation import Isolation
from grader.lab import kept_lab
from grader.lab.rubric import Rubric, SessionSpec
from grader.live.interfaces.build import Built, provide, shipped_for
from grader.live.sandbox.environment import ask_interpreter
from grader.recording.interfaces import InterfacePackage
from grader.recording.submission import SubmissionRecord
from grader.submission.packages.interfaces import interface_packages

_SOURCES = (".py", ".msg", ".srv", ".action")


@dataclass(frozen=True)
class Needed:
    """Packages of interfaces: the lab's, those that the grader brings, and the student's."""

    labs: Sequence[InterfacePackage]
    shipped: Sequence[InterfacePackage]
    students: Sequence[InterfacePackage]

    @property
    def packages(self) -> list[InterfacePackage]:
        """Return all of them; of several of one name, the first counts."""
        return [*self.labs, *self.shipped, *self.students]


def needed_interfaces(
    rubric: Rubric, submission: SubmissionRecord, sessions: Sequence[str]
) -> Needed:
    """Return the packages that a lab and a submission define, and those of the grader's own that they name.

    The lab's are needed where a session that is recorded, or something that was handed in, names one of them.
    """
    sources = [text for path, text in submission.texts.items() if path.endswith(_SOURCES)]
    shipped = shipped_for([rubric.text, *kept_lab.files_of(rubric).values(), *sources])
    named = [*sources, *(_texts_of(rubric.sessions[name], rubric) for name in sessions)]
    ours = [
        package
        for package in rubric.interface_packages
        if any(package.name in text for text in named)
    ]
    return Needed(
        rubric.interface_packages if ours else [], shipped, list(interface_packages(submission))
    )


def provide_interfaces(
    needed: Needed,
    rubric: Rubric,
    submission: SubmissionRecord,
    folder: Path,
    isolation: Isolation,
    interpreter: Path,
    on_progress: Callable[[], object] = lambda: None,
) -> dict[str, str]:
    """Put what can be had into a folder, and note in the submission's record what cannot.

    Returns for each session that needs more than there is what it lacks. A package of the lab's counts before one of
    the grader's own, and both before a student's of the same name. For `on_progress` see `provide`.
    """
    ours = [*needed.labs, *needed.shipped]
    if needed.packages and not _is_like_ours(interpreter):
        why = "students' programs run with another Python than the grader's"
        built = Built(missing=dict.fromkeys(_names(needed.packages), why))
    else:
        built = provide(ours, folder, isolation, on_progress=on_progress)
        # A mistake in one of these is not a student's, nor is what follows from it.
        built = Built(built.prefixes, {**built.missing, **built.invalid}, took_s=built.took_s)
        built = provide(needed.students, folder, isolation, built, on_progress)
    submission.not_built = built.missing
    if submission.absent_modules is not None:
        absent = {*submission.absent_modules, *built.missing} - built.prefixes.keys()
        submission.absent_modules = sorted(absent)
    _note_problems(needed, built, submission)
    lost = {name: why for name, why in built.missing.items() if name in _names(ours)}
    whole = {spec.id: _texts_of(spec, rubric) for spec in rubric.sessions.values() if lost}
    return {
        session: f"{name} could not be built on the grading computer: {why}"
        for session, text in whole.items()
        for name, why in lost.items()
        if name in text
    }


def _is_like_ours(interpreter: Path) -> bool:
    """Whether an interpreter can load what was compiled for the grader's own."""
    tell = "import sys; print(*sys.version_info[:2])"
    return interpreter == OWN_INTERPRETER or ask_interpreter(interpreter, tell) == "{} {}\n".format(
        *sys.version_info
    )


def _names(packages: Iterable[InterfacePackage]) -> set[str]:
    return {package.name for package in packages}


def _note_problems(needed: Needed, built: Built, submission: SubmissionRecord) -> None:
    """Note what students should know of their own packages."""
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
    """Return what stands in a session's steps and in the lab's programs that it starts."""
    started = {step.parameters.get("reference") for step in spec.steps if step.kind == "start"}
    texts = kept_lab.files_of(rubric)
    programs = [
        texts.get(rubric.reference[name].file, "") for name in sorted(filter(None, started))
    ]
    return json.dumps([step.parameters for step in spec.steps]) + "".join(programs)
