"""Words of a command line in XML and YAML launch files."""

from __future__ import annotations

import shlex
from typing import Any

from ._base import Substitution
from .substitutions import TextSubstitution


def parse_words(line: str, parser: Any) -> list[list[Substitution]]:
    """Return the words of a command line, each as a list of substitutions."""
    words: list[list[Substitution]] = [[]]
    for sub in parser.parse_substitution(line):
        if not isinstance(sub, TextSubstitution):
            words[-1].append(sub)
            continue
        split = shlex.split(sub.text)
        # Blanks end a word.
        if not split or (sub.text[0].isspace() and words[-1]):
            words.append([])
        for position, word in enumerate(split):
            if position:
                words.append([])
            words[-1].append(TextSubstitution(text=word))
        if split and sub.text[-1].isspace():
            words.append([])
    return words if words[-1] else words[:-1]
