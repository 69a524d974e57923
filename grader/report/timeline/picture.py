"""A timeline as inline SVG: a lane a row, times in parts of the width, so that it can be any width, and be zoomed."""

from __future__ import annotations

from dataclasses import dataclass, replace

from markupsafe import Markup

from grader.report.escape import line
from grader.report.figures.svg import rect, short, tag, text, ticks
from grader.report.timeline.moments import Moment, Timeline

#: Heights, in CSS pixels, which the style sheet's rows of names have too.
HEAD, ROW = 30, 26
_TICKS = 8
#: What is shorter is drawn so long, in parts of a hundred.
_SHORTEST = 0.2
#: Nothing is written on a bar of a smaller part of the width.
_WRITTEN_FROM = 0.02

#: Style of a bar -> its height, and where it lies from the middle of its lane.
_BARS = {
    "wait": (4, 0),
    "delay": (3, 9),
    "feedback": (4, 0),
    "traffic": (8, 0),
    "step": (10, 0),
}
_BAR = (16, 0)
#: Style of a mark -> its path, around the moment.
_PATHS = {
    "found": "M4 0a4 4 0 1 1 -8 0a4 4 0 1 1 8 0z",
    "first": "M-3 -5.5L5 0L-3 5.5z",
    "warning": "M0 -6L6 5H-6z",
    "logged-error": "M0 -6L6 5H-6z",
    "raised": "M-5.5 -5.5h11v11h-11zM-2.5 -2.5l5 5m0 -5l-5 5",
    "interrupt": "M0 -11V9M-4 5L0 9L4 5",
    "exit": "M0 -8V8",
    "bad-exit": "M0 -8V8",
    "cancel": "M-4 -4l8 8m0 -8l-8 8",
    "call-accepted": "M4 0a4 4 0 1 1 -8 0a4 4 0 1 1 8 0z",
    "call-refused": "M0 -5l5 5l-5 5l-5 -5z",
    "call-silent": "M-4 -4l8 8m0 -8l-8 8",
    "more": "M-4 0h1m3 0h1m3 0h1",
}
#: What each style means, in the order of the key; goals and states are told by their words.
MEANINGS = {
    "run": "a process runs",
    "found": "in the graph (discovery)",
    "first": "first message",
    "traffic": "messages come",
    "window": "observed for the checks",
    "wait": "the lab waits",
    "step": "the lab does something",
    "call-accepted": "call answered",
    "call-refused": "call answered: false",
    "call-silent": "call without an answer",
    "goal": "a goal, until its result",
    "goal-silent": "a goal without a result",
    "feedback": "feedback on a goal",
    "cancel": "cancelling",
    "warning": "warning",
    "logged-error": "error in the log",
    "raised": "exception",
    "interrupt": "Ctrl-C",
    "bad-exit": "ended with an error",
    "delay": "waited for a core",
    "stall": "the computer stalled",
    "lost": "points lost here",
    "open": "points open",
}


@dataclass(frozen=True)
class Scale:
    """Where a time lies, in parts of a hundred of the width."""

    length_s: float

    def at(self, time_s: float) -> str:
        """Return where a time lies."""
        return _percent(100 * time_s / self.length_s)

    def width(self, start_s: float, end_s: float) -> str:
        """Return how wide a span is, which is never too narrow to be seen."""
        return _percent(max(_SHORTEST, 100 * (end_s - start_s) / self.length_s))


def _percent(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".") + "%"


def picture(timeline: Timeline) -> Markup:
    """Return the picture; each mark is a link to the moment's row in the list."""
    scale, height = Scale(timeline.length_s), HEAD + ROW * len(timeline.lanes)
    parts = [*_windows(timeline, scale, height), *_axis(timeline, scale, height)]
    middles = {id(lane): HEAD + ROW * n + ROW / 2 for n, lane in enumerate(timeline.lanes)}
    ends = (middle + ROW / 2 for middle in middles.values())
    parts += [tag("line", x1="0%", x2="100%", y1=end, y2=end, class_="tl-grid") for end in ends]
    # Marks lie on bars.
    rows = sorted(timeline.rows, key=lambda row: row[2].style in _PATHS)
    parts += [_linked(name, moment, scale, middles[id(lane)]) for name, lane, moment in rows]
    return tag("svg", Markup("").join(parts), width="100%", height=height, class_="tl-picture", aria_hidden="true")


def _axis(timeline: Timeline, scale: Scale, height: float) -> list[Markup]:
    """Return the times at the head; the page's script puts finer ones in their place as it zooms."""
    parts = []
    for time_s in ticks(0.0, timeline.length_s, _TICKS):
        at = scale.at(time_s)
        side = "start" if time_s == 0 else "end" if time_s > timeline.length_s * 0.97 else "middle"
        parts.append(tag("line", x1=at, x2=at, y1=HEAD - 8, y2=height, class_="tl-grid tl-when"))
        parts.append(tag("text", short(time_s), x=at, y=12, text_anchor=side, class_="tl-when"))
    return parts


def _windows(timeline: Timeline, scale: Scale, height: float) -> list[Markup]:
    windows = [moment for _, _, moment in timeline.rows if moment.style == "window"]
    return [
        tag("rect", "", x=scale.at(w.start_s), y=HEAD - 8, width=scale.width(w.start_s, w.end_s or w.start_s),
            height=height - HEAD + 8, class_="tl-observed")
        for w in windows
    ]  # fmt: skip


def _linked(name: str, moment: Moment, scale: Scale, middle: float) -> Markup:
    drawn = _mark(moment, scale, middle) if moment.style in _PATHS else _bar(moment, scale, middle)
    return tag("a", drawn, href=f"#{name}", tabindex="-1")


def _mark(moment: Moment, scale: Scale, middle: float) -> Markup:
    """Return a mark at the beginning of a moment, with a thin bar for as long as it lasts."""
    shape = tag("path", d=_PATHS[moment.style], class_=f"tl-{moment.style}")
    mark = tag("svg", shape, x=scale.at(moment.start_s), y=middle, overflow="visible")
    if moment.end_s is None or moment.end_s - moment.start_s < _SHORTEST / 100 * scale.length_s:
        return mark
    return _bar(replace(moment, style="wait"), scale, middle) + mark


def _bar(moment: Moment, scale: Scale, middle: float) -> Markup:
    high, below = _BARS.get(moment.style, _BAR)
    end_s = moment.start_s if moment.end_s is None else moment.end_s
    share = (end_s - moment.start_s) / scale.length_s
    at = scale.at(moment.start_s)
    drawn = tag("rect", "", x=at, y=middle + below - high / 2, width=scale.width(moment.start_s, end_s), height=high,
                rx=2, class_=f"tl-{moment.style}")  # fmt: skip
    if high < _BAR[0] or share < _WRITTEN_FROM or moment.style == "run":
        return drawn
    width = scale.width(moment.start_s, end_s)
    written = text(5, 12, line(moment.text, 160), "start", "tl-on")
    return drawn + tag("svg", written, x=at, y=middle - 8, width=width, height=16)


def key_of(timeline: Timeline) -> list[tuple[str, str]]:
    """Return the styles that a timeline shows and what they mean."""
    shown = {moment.style for lane in timeline.lanes for moment in lane.moments}
    return [(style, meaning) for style, meaning in MEANINGS.items() if style in shown]


def mark_sample(style: str) -> Markup:
    """Return what stands for a style in the key, in a box of 26 by 22."""
    if style in _PATHS:
        return tag("path", d=_PATHS[style], transform="translate(13 11)", class_=f"tl-{style}")
    high = min(_BARS.get(style, _BAR)[0], 12)
    return rect(2, 11 - high / 2, 22, high, f"tl-{style}")
