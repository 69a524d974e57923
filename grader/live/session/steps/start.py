"""The action of the step `start`: a student's program, the processes of a launch plan, or a reference node."""

from __future__ import annotations

import json
from pathlib import Path

from grader.lab.steps.base import Answer
from grader.lab.steps.start import StartResult, StartStep
from grader.live.sandbox.room import WORKSPACE
from grader.live.session.programs import Programs
from grader.recording.session import ProcessRun


async def start(programs: Programs, step: StartStep) -> Answer:
    """Start it."""
    if step.reference:
        return await programs.start_reference(step.reference, step.with_)
    if step.launch:
        return await programs.launch.start(programs.record.plan)
    artifact = step.student or ""
    program = programs.plan.programs.get(artifact)
    if program is None:
        return Answer("failed", StartResult("missing artifact", artifact=artifact))
    name = step.name or artifact
    if step.if_ended:
        if programs.processes[name].alive:
            return Answer("done", StartResult(started=False))
        assert programs.director is not None
        await programs.director.forget()
    workspace = Path(programs.sandbox.seen[WORKSPACE])
    command = program.command(str(workspace), programs.plan.installation.interpreter)
    arguments = _arguments(programs, step, artifact)
    if arguments:
        command += ["--ros-args", *arguments]
    source = Path(programs.plan.sources.get(artifact, ""))
    run = ProcessRun(name, "student", command, artifact)
    await programs.sandbox.start(run, cwd=str(workspace / "src" / source.parent))
    return Answer("done", StartResult(started=True))


def _arguments(programs: Programs, step: StartStep, artifact: str) -> list[str]:
    """Return the ROS arguments, e.g. ["-p", "rate:=50", "-r", "/chatter:=/talk"]."""
    arguments = []
    for parameter, value in step.parameters.items():
        arguments += ["-p", f"{parameter}:={json.dumps(value)}"]
    remappings = dict(step.remappings)
    if _is_composed(programs.plan.sources, artifact):
        remappings |= step.composed
    for wanted, new in remappings.items():
        arguments += ["-r", f"{programs.record.names.get(wanted, wanted)}:={new}"]
    return arguments


def _is_composed(sources: dict[str, str], artifact: str) -> bool:
    """Return whether the artifact's file holds other artifacts too.

    Nodes that a student composed in one file all run. The names that the session needs are kept from the others.
    """
    source = sources.get(artifact)
    return any(other != artifact and sources[other] == source for other in sources)
