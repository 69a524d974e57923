"""A layout for Foxglove, and Lichtblick, that shows a recording: its numbers as plots, and the log.

As in both programs' exported layouts, `configById` has the settings of each panel by its id, which begins with the
panel's type, and `layout` is a tree of these ids.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from numbers import Real
from typing import Any

import numpy as np

from grader.evidence.recorded import Recorded

_LOG = "/rosout"
#: Most readable lines in a plot, and elements of an array that are looked at.
_MOST_LINES = 8
#: Most readable plots in a layout.
_MOST_PLOTS = 4
#: Levels of messages in messages that are looked at.
_DEEPEST = 4
#: Topics of every node and of time, and parts of messages that are not quantities.
_NO_QUANTITY = ("/clock", "/parameter_events", _LOG, "stamp", "layout")


def layout_of(recorded: Recorded) -> str:
    """Return the layout of a session's recording as JSON; equal recordings give equal bytes."""
    panels: dict[str, Any] = {}
    for number, plot in enumerate(islice(_plots(recorded), _MOST_PLOTS), 1):
        panels[f"Plot!{number}"] = plot
    panels["RosOut!log"] = {"topicToRender": _LOG, "minLogLevel": 1, "searchTerms": []}
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _column(panels),
    }
    return json.dumps(layout, indent=1) + "\n"


def _column(panels: Iterable[str]) -> Any:
    """Return the tree that puts the panels below each other."""
    *above, last = panels
    tree: Any = last
    for panel in reversed(above):
        tree = {"direction": "column", "first": panel, "second": tree}
    return tree


def _plots(recorded: Recorded) -> Iterator[dict[str, Any]]:
    """Yield a plot of each topic with numbers; topics that the session waits for come first."""
    topics = set()
    for info in recorded.bag.topics:
        is_left_out = "/_" in info.topic or info.topic in _NO_QUANTITY
        if info.count and not is_left_out:
            topics.add(info.topic)
    awaited = topics & set(recorded.awaited)
    for topic in [*sorted(awaited), *sorted(topics - awaited)]:
        paths = _paths(recorded, topic)
        if paths:
            yield _plot(topic, paths)


def _paths(recorded: Recorded, topic: str) -> list[str]:
    """Return the numbers in a topic's first message, as message paths."""
    stream = recorded.bag.stream(topic)
    (message,) = stream.only(np.arange(len(stream)) == 0).messages
    return [topic + path for path in islice(_numbers(message, _DEEPEST), _MOST_LINES)]


def _numbers(value: Any, depth: int) -> Iterator[str]:
    """Yield the paths of the numbers in a value, such as `.pose.position.x` or `[0]`."""
    if isinstance(value, Real):
        yield ""
    elif depth:
        for step, held in _held(value):
            for path in _numbers(held, depth - 1):
                yield step + path


def _held(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the elements of an array, or the fields of a message, each with its step of a path."""
    if isinstance(value, (list, np.ndarray)):
        for place, element in enumerate(value[:_MOST_LINES]):
            yield f"[{place}]", element
    elif hasattr(value, "__dict__"):
        for name, held in vars(value).items():
            if name not in _NO_QUANTITY and not name.startswith("_"):
                yield f".{name}", held


def _plot(topic: str, paths: Sequence[str]) -> dict[str, Any]:
    lines = [{"value": path, "enabled": True, "timestampMethod": "receiveTime"} for path in paths]
    return {
        "foxglovePanelTitle": topic,
        "paths": lines,
        "xAxisVal": "timestamp",
        "legendDisplay": "floating",
        "isSynced": True,
        "showLegend": True,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showPlotValuesInLegend": True,
    }
