"""Output for any terminal: signs that its encoding does not have are replaced, never an error."""

from __future__ import annotations

import codecs
import io
import sys

#: Name of the error handler below.
_HANDLER = "grade-plain"
#: Signs of the grader's texts -> replacements in ASCII.
_PLAIN = str.maketrans(
    {
        "✓": "+",
        "✕": "x",
        "✗": "x",
        "◐": "~",
        "○": "o",
        "●": "*",
        "•": "*",
        "·": "-",
        "→": "->",
        "▸": ">",
        "−": "-",
        "–": "-",
        "—": "-",
        "±": "+-",
        "×": "x",
        "≤": "<=",
        "≥": ">=",
        "…": "...",
        "‘": "'",
        "’": "'",
        "“": '"',
        "”": '"',
        "⟨": "<",
        "⟩": ">",
        "\N{NO-BREAK SPACE}": " ",
        "\N{NARROW NO-BREAK SPACE}": " ",
    }
)


def write_to_any_terminal() -> None:
    r"""Make the standard output and the standard error replace signs that they cannot encode.

    Letters of names become escapes such as `\xfc`, and different names stay different. Bytes that are written to the
    buffer below, as exports on the standard output are, stay unchanged.
    """
    codecs.register_error(_HANDLER, _replaced)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


def _replaced(error: UnicodeError) -> tuple[str, int]:
    """Return the replacement of the text that cannot be encoded, and the position after it."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    plain = text.translate(_PLAIN).encode("ascii", "backslashreplace")
    return plain.decode("ascii"), error.end
