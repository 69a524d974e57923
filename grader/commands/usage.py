"""Errors of usage. This module is imported at each start, so it imports little."""

from __future__ import annotations

import argparse
import sys
from typing import NoReturn

from grader.errors import UsageError


class WrongUsage(SystemExit):
    """Wrong arguments of a command; `message` is the text by argparse.

    Uncaught, this exception ends the program with the status of wrong usage.
    """

    def __init__(self, parser: argparse.ArgumentParser, message: str) -> None:
        super().__init__(UsageError.exit_status)
        self.parser, self.message = parser, message

    def print(self) -> None:
        """Print usage and message as argparse does."""
        self.parser.print_usage(sys.stderr)
        print(f"{self.parser.prog}: error: {self.message}", file=sys.stderr)


class Parser(argparse.ArgumentParser):
    """A parser that raises its errors, because the arguments may be meant for another command.

    Its help begins with `examples`, if there are any.
    """

    examples = ""

    def format_help(self) -> str:
        """Return the help."""
        return self.examples + super().format_help()

    def error(self, message: str) -> NoReturn:
        """Raise `WrongUsage`."""
        raise WrongUsage(self, message)
