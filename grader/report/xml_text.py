"""Untrusted text in XML: one function, for content and for the values of attributes."""

from __future__ import annotations

from grader.report.untrusted import shown

_LONGEST = 4000
_ESCAPES = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&#39;", "\n": "&#10;", "\t": "&#9;"}
)


def xml_text(text: str, longest: int = _LONGEST) -> str:
    """Return a text that a parser of XML 1.0 gives back as `untrusted.shown` shows it.

    Notes
    -----
    XML 1.0 has no way to write most control characters, lone surrogates, U+FFFE and U+FFFF, not even by
    their number; they are shown as ⟨U+0000⟩. `>` is escaped too, so that `]]>` never stands. Line ends are
    written by number, since a parser makes blanks of those in an attribute.

    References
    ----------
    Extensible Markup Language (XML) 1.0, fifth edition, 2.2 (characters), 2.4 and 3.3.3 (normalization).
    """
    return shown(text, longest).translate(_ESCAPES)
