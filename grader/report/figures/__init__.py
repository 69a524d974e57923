"""The figures of a report: one class per kind, with its settings in the rubric and the way it is drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from grader.evidence.recorded import Recorded
from grader.lab.rubric import FigureSpec
from grader.report.figures.svg import Figure, FigureKind


def draw(spec: FigureSpec, recorded: Recorded, lab_folder: Path) -> Figure | None:
    """Draw a figure of the rubric; return None if the recording holds nothing to be shown."""
    assert isinstance(spec.parameters, FigureKind)
    figure = spec.parameters.draw(recorded, lab_folder)
    if figure is None:
        return None
    return replace(figure, title=spec.title, session=spec.session, shows=spec.shows)
