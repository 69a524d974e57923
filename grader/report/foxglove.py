"""A layout for Foxglove, and Lichtblick, that shows what a recording holds: its numbers as plots, and the log.

As both export layouts, `configById` has the settings of each panel by its id, which begins with the panel's type, and
`layout` is a tree of these ids.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import islice
from numbers import Real
from typing import Any

import numpy as np

from grader.evidence.recorded import Recorded

_LOG = "/rosout"
#: More lines in a plot, and more plots, nobody can read; messages in messages are looked at so deep.
_MOST_LINES, _MOST_PLOTS, _DEEPEST = 8, 4, 4
#: Topics of every node and of time, and parts of messages that are no quantity.
_NO_QUANTITY = ("/clock", "/parameter_events", _LOG, "stamp", "layout")


def layout_of(recorded: Recorded) -> str:
    """Return the layout of a session's recording as JSON; equal recordings give equal bytes."""
    topics = {i.topic for i in recorded.bag.topics if i.count and "/_" not in i.topic} - {
        *_NO_QUANTITY
    }
    ordered = sorted(topics, key=lambda name: (name not in recorded.awaited, name))
    plots = [_plot(topic, paths) for topic in ordered if (paths := _paths(recorded, topic))][
        :_MOST_PLOTS
    ]
    panels = {f"Plot!{number}": plot for number, plot in enumerate(plots, 1)}
    panels["RosOut!log"] = {"topicToRender": _LOG, "minLogLevel": 1, "searchTerms": []}
    tree: Any = None
    for panel in reversed(panels):
        tree = panel if tree is None else {"direction": "column", "first": panel, "second": tree}
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
    }
    return json.dumps({**layout, "layout": tree}, indent=1) + "\n"


def _paths(recorded: Recorded, topic: str) -> list[str]:
    """Return the numbers in a topic's first message, as message paths."""
    stream = recorded.bag.stream(topic)
    (message,) = stream.only(np.arange(len(stream)) == 0).messages
    return [topic + path for path in islice(_numbers(message, _DEEPEST), _MOST_LINES)]


def _numbers(value: Any, depth: int) -> Iterator[str]:
    if isinstance(value, Real):
        yield ""
    elif isinstance(value, (list, np.ndarray)) and depth:
        for place, element in enumerate(value[:_MOST_LINES]):
            yield from (f"[{place}]{path}" for path in _numbers(element, depth - 1))
    elif hasattr(value, "__dict__") and depth:
        for name, held in vars(value).items():
            if name not in _NO_QUANTITY and not name.startswith("_"):
                yield from (f".{name}{path}" for path in _numbers(held, depth - 1))


def _plot(topic: str, paths: Sequence[str]) -> dict[str, Any]:
    lines = [{"value": path, "enabled": True, "timestampMethod": "receiveTime"} for path in paths]
    shown = dict.fromkeys(
        ("isSynced", "showLegend", "showXAxisLabels", "showYAxisLabels", "showPlotValuesInLegend"),
        True,
    )
    return {
        "foxglovePanelTitle": topic,
        "paths": lines,
        "xAxisVal": "timestamp",
        "legendDisplay": "floating",
        **shown,
    }
