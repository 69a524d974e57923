"""The figures of a report: one class per kind, with its settings in the rubric and the way it is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from grader.evidence.recorded import Recorded
from grader.lab.rubric import FigureSpec
from grader.report.figures.frames import Frames
from grader.report.figures.graph import Calls, QosTable
from grader.report.figures.link import Link
from grader.report.figures.plan import PlanTree
from grader.report.figures.posture import Posture
from grader.report.figures.progress import Goals, States
from grader.report.figures.svg import Figure, FigureKind
from grader.report.figures.timing import Intervals, Latency, Rate
from grader.report.figures.values import FieldOverTime, Reports, Series

FIGURES: Mapping[str, type[FigureKind]] = {
    "intervals": Intervals,
    "rate": Rate,
    "series": Series,
    "field": FieldOverTime,
    "reports": Reports,
    "calls": Calls,
    "plan": PlanTree,
    "qos_table": QosTable,
    "latency": Latency,
    "posture": Posture,
    "link": Link,
    "frames": Frames,
    "goals": Goals,
    "states": States,
}


def draw(spec: FigureSpec, recorded: Recorded, lab_folder: Path) -> Figure | None:
    """Draw a figure of the rubric; return None if the recording holds nothing to be shown."""
    assert isinstance(spec.parameters, FigureKind)
    figure = spec.parameters.draw(recorded, lab_folder)
    if figure is None:
        return None
    return replace(figure, title=spec.title, session=spec.session, shows=spec.shows)
