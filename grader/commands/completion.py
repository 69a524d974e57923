"""`grade completion SHELL`: print the completion of commands and options for a shell."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import shtab
from rich.console import Console

from grader.commands.arguments import as_sentence, parser_of, rubric_path

_WORDS = "print the completion of commands and options for a shell"
_EPILOG = """\
examples:
  grade completion bash > ~/.local/share/bash-completion/completions/grade
  grade completion zsh > ~/.zfunc/_grade          # with fpath=(~/.zfunc $fpath) before compinit in ~/.zshrc
  grade completion fish > ~/.config/fish/completions/grade.fish
"""
_SHELLS = ("bash", "zsh", "fish")
#: A line of each script, and its replacement: the first word can be a path of a submission, too.
_WITH_PATHS = {
    "bash": ("complete -o bashdefault", "complete -o bashdefault -o default"),
    "zsh": ("_describe 'grade commands' _commands", "_describe 'grade commands' _commands; _files"),
    "fish": (
        "complete -c grade -f\n",
        "complete -c grade -f\ncomplete -c grade -n _shtab_grade_using -F\n",
    ),
}


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = parser_of("grade completion", as_sentence(_WORDS), _EPILOG)
    parser.add_argument("shell", choices=_SHELLS, metavar="SHELL", help=", ".join(_SHELLS))
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Print the completion; returns the exit status."""
    options = make_parser().parse_args(arguments)
    print(completion_for(options.shell))
    return 0


def completion_for(shell: str) -> str:
    """Return the completion for a shell."""
    # Imported late, because it imports all commands, this one included.
    from grader.commands.all_parsers import parser_of_all

    parser = parser_of_all()
    for action in _actions(parser):
        if action.type in (Path, rubric_path) or action.dest == "rubric":
            action.complete = shtab.FILE
        if action.dest == "exports":
            action.choices = action.type.keywords["forms"]
    script: str = shtab.complete(parser, shell)
    line, replacement = _WITH_PATHS[shell]
    return script.replace(line, replacement, 1)


def _actions(parser: argparse.ArgumentParser) -> Iterator[Any]:
    """Yield the actions of a parser and of its parts."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for part in action.choices.values():
                yield from _actions(part)
