"""Text of students made fit to be shown: what would steer a terminal, hide or reorder text becomes visible.

Escaping for HTML is another matter, which the template engine sees to.
"""

from __future__ import annotations

import re
import unicodedata

LONGEST = 4000

#: What a terminal obeys and does not show: CSI, OSC and other string sequences, and two-character escapes.
_ANSI = re.compile(
    r"(?:\x1b\[|\x9b)[0-?]*[ -/]*[@-~]"
    # No string goes on over the beginning of another: thousands of them would each be read to the end.
    r"|(?:\x1b[\]PX^_]|[\x9d\x90\x98\x9e\x9f])[^\x07\x1b\x9c\x9d\x90\x98\x9e\x9f]{0,4000}(?:\x07|\x1b\\|\x9c)"
    r"|\x1b[ -/]*[0-~]"
)
_MOST_MARKS = 3
#: Line end, tab, and the joiners that some scripts and emoji are written with.
_KEPT = "\n\t\u200c\u200d"
#: Control, format (direction, no width), surrogate, private, no character at all, line and paragraph separators.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})


def shown(text: str, longest: int = LONGEST) -> str:
    """Return a text as it can be shown.

    Parameters
    ----------
    longest : int
        Characters after which it is cut, with a mark that says so.

    Notes
    -----
    Terminal sequences are left out. Control characters, characters that change the direction of text or have
    no width, lone surrogates and characters that no text may hold are shown by their number, e.g. ⟨U+202E⟩.
    Line ends and tabs stay. At most three combining marks stay on a letter.
    """
    if len(text) <= longest and text.isascii() and text.isprintable():
        return text  # Nearly all is, and there is much of it.
    cut = len(text) > longest * 2
    text = _ANSI.sub("", text[: longest * 2])
    cut = cut or len(text) > longest
    kept: list[str] = []
    marks = 0
    for character in text[:longest].replace("\r\n", "\n"):
        marks = marks + 1 if unicodedata.combining(character) else 0
        if marks <= _MOST_MARKS:
            kept.append(character if _harmless(character) else f"⟨U+{ord(character):04X}⟩")
    return "".join(kept) + (" … (cut)" if cut else "")


def line(text: str, longest: int = 300) -> str:
    """Return a text as one line that can be shown; cut with an ellipsis."""
    # Split again, since where a terminal sequence stood between blanks, two are left.
    whole = " ".join(shown(" ".join(text[: longest * 4].split()), longest * 4).split())
    return whole if len(whole) <= longest and len(text) <= longest * 4 else whole[: longest - 1] + "…"


def _harmless(character: str) -> bool:
    return character in _KEPT or unicodedata.category(character) not in _HIDDEN
