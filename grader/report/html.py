"""The HTML report: one page that needs nothing else, neither a network nor scripts.

All that comes from students passes `shown`, through the template engine's last stage, before it is escaped;
and the page's content security policy names its own style and script by their hashes and allows nothing else.
"""

from __future__ import annotations

import base64
import functools
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from grader.evidence.figures import (
    Calls,
    Figure,
    Intervals,
    Latency,
    PlanTree,
    QosTable,
    Rate,
    Reports,
    Series,
)
from grader.recording.session import SessionRecord
from grader.recording.submission import SubmissionRecord
from grader.report import charts, views
from grader.report.charts import Chart, duration
from grader.report.untrusted import line, shown
from grader.result import Outcome, Result

_FOLDER = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Picture:
    """A figure with its chart, where it is one for drawing."""

    kind: str
    figure: Figure
    chart: Chart | None

    @property
    def half(self) -> bool:
        """Whether it takes half the page's width."""
        return self.chart is not None and self.chart.half


def picture_of(figure: Figure, name: str) -> Picture:
    """Draw a figure; tables and trees are left to the template.

    Parameters
    ----------
    name : str
        Unique in the page.
    """
    kinds: tuple[tuple[type[Any], str, Any], ...] = (
        (Intervals, "chart", charts.intervals_chart),
        (Rate, "chart", charts.rate_chart),
        (Series, "chart", charts.series_chart),
        (Reports, "chart", charts.reports_chart),
        (Calls, "calls", charts.calls_chart),
        (Latency, "chart", charts.latency_chart),
        (PlanTree, "plan", None),
        (QosTable, "qos", None),
    )
    kind, paint = next((k, p) for cls, k, p in kinds if isinstance(figure, cls))
    return Picture(kind, figure, paint(figure, name) if paint else None)


def render(
    result: Result,
    figures: Mapping[str, Sequence[Figure]],
    sessions: Mapping[str, SessionRecord],
    submission: SubmissionRecord,
) -> str:
    """Return the report as a page of HTML; equal arguments give equal bytes.

    Parameters
    ----------
    figures : mapping
        Criterion id -> what is shown beside its checks.
    sessions : mapping
        Session name -> its record.
    submission : SubmissionRecord
        Whose texts are quoted where a finding points at a line.
    """
    anchors = views.anchors_of(sessions)
    pictures = {
        name: [picture_of(figure, f"{views.anchor('figure', name)}-{n}") for n, figure in enumerate(listed)]
        for name, listed in figures.items()
    }
    page = _template().render(
        result=result,
        score=views.share_of(result.score.earned, result.score.possible, result.score.undecided),
        recorded=views.recorded_at(result, sessions),
        mends=views.mends_of(result, (Outcome.FAILED, Outcome.PARTIAL)),
        unreached=views.mends_of(result, (Outcome.NOT_REACHED,)),
        criteria=[views.criterion_view(c, submission.texts, anchors) for c in result.criteria],
        pictures=pictures,
        sessions=[views.session_view(name, record) for name, record in sessions.items()],
        isolations=views.isolations_of(sessions),
        versions=views.versions_of(result),
        handed_in=views.handed_in(submission),
        submission=submission,
    )
    # A lone surrogate cannot be written; all that is shown was cleaned of them, so this changes nothing.
    return page.encode("utf-8", "replace").decode("utf-8")


@functools.lru_cache(maxsize=1)
def _template() -> Template:
    environment = Environment(
        loader=FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_finalize,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(line=line, duration=duration, prose=prose)
    css, js = _read("report.css"), _read("report.js")
    environment.globals.update(
        css=Markup(css),
        js=Markup(js),
        policy=(
            f"default-src 'none'; style-src {_hash(css)}; script-src {_hash(js)}; base-uri 'none'; form-action 'none'"
        ),
    )
    return environment.get_template("report.html.j2")


def prose(text: str) -> Markup:
    """Make text fit to be shown, with what stands between backticks as code."""
    parts = shown(text).split("`")
    if len(parts) % 2 == 0:
        return Markup.escape(shown(text))
    pieces = [Markup("<code>{}</code>") if n % 2 else Markup("{}") for n in range(len(parts))]
    return Markup("").join(piece.format(part) for piece, part in zip(pieces, parts, strict=True))


def _read(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f"'sha256-{digest}'"


def _finalize(value: Any) -> Any:
    """Make text fit to be shown; markup of ours and numbers stay as they are."""
    return shown(value) if isinstance(value, str) and not isinstance(value, Markup) else value
