"""The kinds of figures by their names in a rubric; to draw the figures of a rubric, only its own kinds are imported."""

from __future__ import annotations

from collections.abc import Mapping

from grader.report.figures.frames import Frames
from grader.report.figures.graph import Calls, QosTable
from grader.report.figures.link import Link
from grader.report.figures.plan import PlanTree
from grader.report.figures.posture import Posture
from grader.report.figures.progress import Goals, States
from grader.report.figures.svg import FigureKind
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
