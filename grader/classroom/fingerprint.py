"""Hashes of the sources of a result: equal hashes need no second grading."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import confine
import grader
import launch_plan
import ros_bag
from grader.lab.kept_lab import interface_files, named_files
from grader.lab.rubric import Rubric
from grader.live.sandbox.environment import versions
from grader.live.sandbox.installation import Installation
from grader.pipeline import Options
from grader.submission.extraction import Intake


def engine_sha256() -> str:
    """Return the hash of the grader's own code, and of the versions in a recording."""
    ours: dict[str, Path] = {}
    for package in (confine, grader, launch_plan, ros_bag):
        for folder in package.__path__:
            for name, path in files_below(Path(folder)):
                if not name.startswith("shipped_lab/"):
                    ours[f"{package.__name__}/{name}"] = path
    stated = {name: version for name, version in versions().items() if name != "kernel"}
    return sha256_of(stated, sorted(ours.items()))


def lab_files(rubric: Rubric, *, figures: bool = True) -> dict[str, Path]:
    """Return the files beside a rubric for a grading, by their path relative to the rubric's folder.

    These are the reference programs and oracles, with all other files in their folders, and files of figures.
    """
    return _with_folders(rubric, named_files(rubric, figures=figures))


def _with_folders(rubric: Rubric, names: Iterable[str]) -> dict[str, Path]:
    """Return files beside a rubric with all other files in their folders, which they can import."""
    files = {}
    named = (rubric.folder / name for name in names)
    for folder in {path.parent for path in named if path.is_file()}:
        for name, path in files_below(folder):
            # The rubric's own folder can be a home folder; only its files count, not its folders.
            if folder != rubric.folder or "/" not in name:
                files[path.relative_to(rubric.folder).as_posix()] = path
    return dict(sorted(files.items()))


def lab_sha256(rubric: Rubric) -> str:
    """Return the hash of a rubric with its reference programs and oracles; no points depend on figures."""
    return sha256_of(rubric.sha256, lab_files(rubric, figures=False).items())


def recording_sha256(rubric: Rubric) -> str:
    """Return the hash of the parts of a lab that take part in a recording.

    Checks, points, words and policy are left out: another judgement of the same recordings is enough for them.
    """
    sessions = {}
    for name, session in rubric.sessions.items():
        steps = [(step.kind, step.parameters, step.label) for step in session.steps]
        sessions[name] = (steps, session.timeout_s)
    artifacts = {name: spec.model_dump(mode="json") for name, spec in rubric.artifacts.items()}
    reference = {name: spec.model_dump(mode="json") for name, spec in rubric.reference.items()}
    bonus = sorted(rubric.bonus_artifacts)
    stated = (rubric.lab.package, sessions, artifacts, reference, bonus)
    programs = [spec.file for spec in rubric.reference.values()]
    files = _with_folders(rubric, [*programs, *interface_files(rubric)])
    return sha256_of(stated, files.items())


def submission_sha256(intake: Intake) -> str:
    """Return the hash of an extracted submission."""
    return sha256_of(intake.left_out, sorted(files_below(intake.folder)))


def options_sha256(options: Options) -> str:
    """Return the hash of the options on which recordings depend."""
    stated = (
        options.interpreter,
        options.interpreter.resolve(),
        options.sessions,
        options.seed,
        options.evaluator,
        *_of_installation(options.ros),
    )
    return sha256_of(stated)


def _of_installation(ros: Installation | None) -> Iterator[object]:
    """Yield the facts about an installation of ROS for students' programs."""
    if ros is not None:
        yield from ros.facts()


def judging_sha256(options: Options, name: str, submission_time: str, lab: str) -> str:
    """Return the hash of all sources of a judgement that do not affect the recordings.

    The lab's hash is `lab_sha256`.
    """
    return sha256_of((repr(options.overrides.of(name)), submission_time, lab))


def seed_for(submission: str, run_seed: int) -> int:
    """Return the seed of stimuli for a submission's hash: different for each submission, and equal on all machines."""
    return int(sha256_of([submission, run_seed])[:8], 16) % 2**31


def sha256_of(stated: Any, files: Iterable[tuple[str, Path]] = ()) -> str:
    """Return the hash of plain data, and of files with their names."""
    digest = hashlib.sha256(json.dumps(stated, sort_keys=True, default=str).encode())
    for name, path in files:
        content = path.read_bytes()
        digest.update(f"\0{name}\0{len(content)}\0".encode("utf-8", "surrogateescape") + content)
    return digest.hexdigest()


def files_below(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield the regular files below a folder, without compiled Python; links are not followed."""
    for root, folders, files in os.walk(folder, followlinks=False):
        folders[:] = [name for name in folders if name != "__pycache__"]
        for name in files:
            path = Path(root) / name
            if path.is_file() and not path.is_symlink():
                yield path.relative_to(folder).as_posix(), path
