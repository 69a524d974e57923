"""The parsers of all commands in one, for the completion of shells and for the manual page."""

from __future__ import annotations

import argparse
import importlib

from grader.commands import COMMANDS
from grader.commands import grade as grading


def parser_of_all() -> argparse.ArgumentParser:
    """Return a parser with the options of grading, and with each command as a part."""
    root = grading.make_parser()
    root.epilog = None
    paths = [action for action in root._actions if not action.option_strings]
    for action in paths:
        root._remove_action(action)
    commands = root.add_subparsers(metavar="COMMAND", dest="command", title="commands")
    for name, words in COMMANDS.items():
        own = importlib.import_module(f"grader.commands.{name}").make_parser()
        commands.add_parser(
            name,
            parents=[own],
            add_help=False,
            help=words,
            description=own.description,
            epilog=own.epilog,
            formatter_class=own.formatter_class,
        )
    return root
