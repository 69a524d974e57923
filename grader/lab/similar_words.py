"""Words that people have probably meant instead of unknown ones."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return a suggestion for an unknown word, as the end of a sentence: a similar known word, or all known words."""
    names = sorted(set(known))
    near = meant(word, names)
    if near:
        return near
    if not names:
        return ""
    return f"; known are {', '.join(names)}"


def meant(word: str, known: Sequence[str]) -> str:
    """Return the known word that a word is likely to mean, as the end of a sentence; empty if there is none."""
    near = difflib.get_close_matches(word, known, n=1)
    return f"; did you mean '{near[0]}'?" if near else ""
