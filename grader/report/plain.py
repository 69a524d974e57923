"""Untrusted text made fit for a terminal: one function, used for all that a student may have written."""

from __future__ import annotations

import unicodedata

_CUT = "…"


def terminal_text(text: str, limit: int = 400) -> str:
    """Return text without control characters, escapes or direction overrides, cut to a length.

    A terminal obeys escape sequences and carriage returns; what is not printable is shown as its code.
    """
    shown = []
    for character in text[: limit + 1]:
        category = unicodedata.category(character)
        if character in "\n\t":
            shown.append(" ")
        elif category in ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"):
            shown.append(f"\\x{ord(character):02x}" if ord(character) < 256 else f"\\u{ord(character):04x}")
        else:
            shown.append(character)
    whole = "".join(shown)
    return whole if len(whole) <= limit else whole[: limit - 1] + _CUT
