"""A layout for Foxglove, and Lichtblick, that shows what a recording holds: its numbers as plots, and the log.

References
----------
The layouts that both export: `configById` has the settings of each panel by its id, which begins with the panel's type,
and `layout` is a tree of these ids.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import islice
from numbers import Real
from typing import Any

import numpy as np

from grader.evidence.recorded import Recorded

LOG = "/rosout"
#: More lines in a plot, and more plots, nobody can read. Beside numbers a message may hold much else.
_MOST_LINES, _MOST_PLOTS, _DEEPEST = 8, 4, 4
#: Topics of every node and of time, and parts of messages that are no quantity.
_NO_QUANTITY = ("/clock", "/parameter_events", LOG, "stamp", "layout")


def layout_of(recorded: Recorded) -> str:
    """Return the layout of a session's recording as JSON; equal recordings give equal bytes."""
    plots = [(topic, paths) for topic in _topics(recorded) if (paths := _paths(recorded, topic))][:_MOST_PLOTS]
    panels = {f"Plot!{number}": _plot(topic, paths) for number, (topic, paths) in enumerate(plots, 1)}
    panels["RosOut!log"] = {"topicToRender": LOG, "minLogLevel": 1, "searchTerms": []}
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _stacked(list(panels)),
    }
    return json.dumps(layout, indent=1) + "\n"


def _topics(recorded: Recorded) -> list[str]:
    """Return the topics with quantities that are not hidden, those first that the steps wait for."""
    names = sorted({i.topic for i in recorded.bag.topics if i.count and "/_" not in i.topic} - {*_NO_QUANTITY})
    return sorted(names, key=lambda name: name not in recorded.awaited)


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
    return {
        "title": topic,
        "paths": [{"value": path, "enabled": True, "timestampMethod": "receiveTime"} for path in paths],
        "xAxisVal": "timestamp",
        "isSynced": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showPlotValuesInLegend": True,
    }


def _stacked(ids: Sequence[str]) -> Any:
    """Return a tree with all panels below each other, each as high as the others."""
    first, *others = ids
    if not others:
        return first
    share = round(100 / len(ids), 2)
    return {"direction": "column", "first": first, "second": _stacked(others), "splitPercentage": share}
