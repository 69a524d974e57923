"""`grade play RESULTS_DIR SESSION`: publish a recording on the ROS graph of this terminal."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NoReturn

from rich.console import Console

from confine.helpers import become, python
from grader.commands.arguments import add_flag, parser_of, print_note
from grader.errors import RecordingError, UsageError
from grader.lab.similar_words import meant
from grader.recording.session import SESSION_FILE
from grader.result_folder import RECORDINGS

#: Environment variables that name settings files of the middleware.
_PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
#: Environment variable that hands PYTHONPATH, needed for interface types, to an interpreter that ignores PYTHONPATH.
_CALLERS_PYTHONPATH = "_GRADER_PLAY_PYTHONPATH"
#: Environment variables that list folders of programs and libraries.
_SEARCH_PATHS = ("AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "PATH", _CALLERS_PYTHONPATH)

_DESCRIPTION = """\
Publish the messages of a recorded session at the original intervals, on the ROS graph of this terminal (ROS_DOMAIN_ID).
`ros2 topic echo`, RViz and your own nodes receive them as in the session. /clock is published as recorded, or, if
no recorded one is played, with the recording's time. Do not play on the network of a real robot: it would obey the
recorded commands.
"""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = parser_of("grade play", _DESCRIPTION)
    parser.add_argument(
        "results",
        type=Path,
        metavar="RESULTS_DIR",
        help="results of a submission, e.g. results/alice",
    )
    parser.add_argument(
        "session",
        nargs="?",
        metavar="SESSION",
        help="session to play (default: the only one)",
    )
    words = "start at this time, in seconds on the report's timeline (default: %(default)s)"
    parser.add_argument(
        "--from", dest="from_s", type=float, default=0.0, metavar="SECONDS", help=words
    )
    parser.add_argument(
        "--rate",
        type=float,
        default=1.0,
        metavar="X",
        help="speed, as a multiple of the original speed (default: %(default)s)",
    )
    parser.add_argument(
        "--topics", nargs="+", default=(), metavar="TOPIC", help="topics to play (default: all)"
    )
    add_flag(parser, "--loop", "repeat until Ctrl-C")
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Play a recording; returns the exit status."""
    parser = make_parser()
    options = parser.parse_args(arguments)
    from grader.evidence.recorded import Recorded
    from grader.live.sandbox.environment import require_platform

    if not 0 < options.rate < float("inf"):
        parser.error("--rate must be a number above 0")
    folder = _recording(options.results, options.session)
    try:
        recorded = Recorded.open(folder)
    except (OSError, ValueError) as problem:
        raise RecordingError(
            "this recording cannot be read",
            location=str(folder),
            remedy=f"Grade the submission again. ({problem})",
        ) from problem
    require_platform()
    if not sys.flags.isolated:
        _play_isolated(options)
    sys.path += filter(None, os.environ.get(_CALLERS_PYTHONPATH, "").split(os.pathsep))
    from grader.live.ros_node.player import Player

    player = Player(recorded.bag, options.topics)
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    print_note(
        console,
        f"Playing '{folder.name}' with ROS_DOMAIN_ID {domain}; press Ctrl-C to stop.",
        "bold",
    )
    for topic, what in player.topics.items():
        print_note(console, f"{topic}: {what}", "")
    start_ns, played = recorded.record.started_ns + round(options.from_s * 1e9), 0
    try:
        player.await_subscription()
        while (count := player.play(start_ns, options.rate)) and options.loop:
            played += count
        print_note(console, f"Messages published: {played + count}.", "")
    except KeyboardInterrupt:
        return 130
    finally:
        player.close()
    return 0


def _play_isolated(options: argparse.Namespace) -> NoReturn:
    """Replace this process by one that loads neither modules nor settings from the working folder, often a student's."""
    results = options.results.resolve()
    command = python(sys.executable, "-m", "grader.cli", "play", str(results))
    if options.session is not None:
        command.append(options.session)
    command += [f"--from={options.from_s}", f"--rate={options.rate}"]
    if options.loop:
        command.append("--loop")
    if options.topics:
        command += ["--topics", *options.topics]
    become(command, environment=isolated_environment(Path.cwd(), results, os.environ))


def isolated_environment(
    working: Path, results: Path, environment: Mapping[str, str]
) -> dict[str, str]:
    """Return an environment without DDS profiles in the working folder or the results, and without relative paths.

    A DDS profile is kept if its path is absolute and leads outside both folders. A search path keeps its absolute folders.
    """
    kept = dict(environment)
    kept["SKIP_DEFAULT_XML_FILE"] = "1"
    kept[_CALLERS_PYTHONPATH] = environment.get("PYTHONPATH", "")
    for name in _PROFILES:
        file = Path(os.path.realpath(kept.get(name, "")))
        is_inside = not {working, results}.isdisjoint(file.parents)
        if not kept.get(name, "").startswith("/") or is_inside:
            kept.pop(name, None)
    for name in _SEARCH_PATHS:
        folders = kept.get(name, "").split(os.pathsep)
        kept[name] = os.pathsep.join(each for each in folders if each.startswith("/"))
        if not kept[name]:
            del kept[name]
    return kept


def _recording(results: Path, session: str | None) -> Path:
    """Return the folder of a session's recording.

    Raises
    ------
    RecordingError
        If there are no recordings.
    UsageError
        If the session does not exist, or if no session is named and there are several.
    """
    recordings = results / RECORDINGS
    names = sorted(file.parent.name for file in recordings.glob(f"*/{SESSION_FILE}"))
    if not names:
        remedy = "Name the results of one submission, e.g. results/alice."
        raise RecordingError("there are no recordings in it", location=str(results), remedy=remedy)
    problem = ""
    if session is None and len(names) > 1:
        problem = "there are several sessions"
    elif session is not None and session not in names:
        problem = f"there is no session {session!r}{meant(session, names)}"
    if problem:
        raise UsageError(
            problem, location=str(results), remedy=f"Name one session: {', '.join(names)}."
        )
    return recordings / (session or names[0])
