"""`grade play RESULTS_DIR SESSION`: what was recorded of a session, on the ROS graph of this terminal."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from grader.commands.arguments import add_flag, parser_of, print_note
from grader.errors import RecordingError, UsageError
from grader.recording.session import SESSION_FILE
from grader.report.escape import terminal_text
from grader.result_folder import RECORDINGS

if TYPE_CHECKING:
    from grader.live.ros_node.player import Player

#: So long it waits for subscriptions, which take a moment to find it, before it begins.
_DISCOVERY_S = 2.0

_DESCRIPTION = """\
Publish all that was recorded of a session again, each message as long after the one before it as then, and /clock:
as it was recorded, or else the recording's time. `ros2 topic echo`, RViz and nodes of your own see it as they would
have. It is published on the ROS graph of this terminal (ROS_DOMAIN_ID): not where a real robot would obey it.
"""


def _parser() -> argparse.ArgumentParser:
    parser = parser_of("grade play", _DESCRIPTION)
    parser.add_argument("results", type=Path, metavar="RESULTS_DIR", help="results of a submission: results/alice")
    parser.add_argument("session", nargs="?", metavar="SESSION", help="the session; not needed if there is only one")
    words = "begin so long after the session's start, as the timeline in the report counts (default: %(default)s)"
    parser.add_argument("--from", dest="from_s", type=float, default=0.0, metavar="SECONDS", help=words)
    parser.add_argument("--rate", type=_rate, default=1.0, metavar="X", help="X times as fast (default: %(default)s)")
    parser.add_argument("--topics", nargs="+", default=(), metavar="TOPIC", help="only these")
    add_flag(parser, "--loop", "begin again at the end, until Ctrl-C")
    return parser


def _rate(text: str) -> float:
    rate = float(text)
    if not 0.01 <= rate <= 100:
        raise argparse.ArgumentTypeError("must be from 0.01 to 100")
    return rate


def run(arguments: Sequence[str], console: Console) -> int:
    """Play a recording; returns the exit status."""
    from grader.evidence.recorded import Recorded
    from grader.live.sandbox.environment import require_platform

    options = _parser().parse_args(arguments)
    folder = _recording(options.results, options.session)
    try:
        recorded = Recorded.open(folder)
    except (OSError, ValueError) as problem:
        raise RecordingError("this recording cannot be read", location=str(folder), remedy=str(problem)) from problem
    require_platform()
    from grader.live.ros_node.player import Player

    player = Player(recorded.bag, options.topics)
    try:
        _print_topics(console, player, folder.name)
        player.await_subscription(_DISCOVERY_S)
        start_ns = recorded.record.started_ns + round(options.from_s * 1e9)
        while (count := player.play(start_ns, options.rate)) and options.loop:
            print_note(console, f"{count} messages published; again from the beginning", "")
        console.print(f"{count} messages published.")
    except KeyboardInterrupt:
        print_note(console, "Stopped.", "")
        return 130
    finally:
        player.close()
    return 0


def _recording(results: Path, session: str | None) -> Path:
    """Return the folder of a session's recording; raises UsageError if there is none, or it is not said which."""
    recordings = results / RECORDINGS
    names = sorted(file.parent.name for file in recordings.glob(f"*/{SESSION_FILE}"))
    if not names:
        remedy = "Give the results of one submission, such as results/alice."
        raise RecordingError("there are no recordings in it", location=str(results), remedy=remedy)
    if session is None and len(names) == 1:
        return recordings / names[0]
    if session not in names:
        problem = "there are several sessions" if session is None else f"there is no session {session!r}"
        raise UsageError(problem, location=str(results), remedy=f"Name one of {', '.join(names)}.")
    return recordings / session


def _print_topics(console: Console, player: Player, session: str) -> None:
    """Print what is played and what is not."""
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    console.print(Text(f"Playing {session!r} with ROS_DOMAIN_ID {domain}; Ctrl-C stops it.", "bold"))
    table = Table.grid(padding=(0, 2))
    plain = [info for info in player.played if "/_" not in info.topic]
    for info in plain:
        table.add_row(
            "", *(escape(terminal_text(text)) for text in (info.topic, info.topic_type, f"{info.count} messages"))
        )
    for topic, why in player.left_out.items():
        table.add_row("", escape(terminal_text(topic)), f"[yellow]not played: {escape(terminal_text(why))}")
    console.print(table)
    if hidden := len(player.played) - len(plain):
        console.print(f"  and {hidden} hidden topics, of services and actions")
