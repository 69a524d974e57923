"""Untrusted text in Markdown as GitHub renders it: one function, for paragraphs, lists and cells of tables."""

from __future__ import annotations

import re

from grader.report.untrusted import line

_LONGEST = 600
#: What GitHub makes something of after Markdown is done with, so that only a code span keeps it from that:
#: mentions, addresses, numbers of issues, emoji, URLs, commits, ticket numbers. Names of files and topics
#: (with a point, an underscore, a leading slash) are set as code because they read better so.
_CODE = re.compile(
    r"[@#_]|:(?!$)|^\W*/|www\.|\w\.[^\W\d_]{2}|(?<![^\W_])[0-9a-f]{7,}(?![^\W_])|[A-Za-z]-\d", re.IGNORECASE
)
_STOPS = ".,;:!?…"
_PAIRS = {")": "(", '"': '"', "'": "'", "’": "‘", "”": "“"}
#: Within a code span these would end it, part a table's cells, or open a formula.
_NOT_IN_CODE = re.compile(r"([`|$])")
#: What would make a line a list, a rule, or the underline of a heading or of a table's first row.
_BLOCK = re.compile(r"[-+=:]|\d+[.)]")
#: ASCII characters that are never markup within a line.
_INERT = frozenset(",.;:%()'\"?/+-= ")


def markdown_text(text: str, longest: int = _LONGEST) -> str:
    """Return one line of Markdown that is rendered as `untrusted.line` shows the text, and does nothing.

    Notes
    -----
    Escapes of Markdown are not enough: mentions, e-mail addresses and issue numbers are made into links
    in the text that comes out of it. So a word that could become one is set as code, which is left alone,
    and elsewhere every character that could be markup is written by its number. The result holds no
    backquote, `|` or `$` but those that begin and end code spans, so it has the same meaning in a table.

    References
    ----------
    GitHub Flavored Markdown Spec 0.29, 4.10 (tables), 6.2 (entities), 6.3 (code spans), 6.9 (autolinks).
    """
    words = [_word(word) for word in line(text, longest).split(" ")]
    whole = " ".join(words)
    return f"&#{ord(whole[0])};{whole[1:]}" if _BLOCK.match(whole) else whole


def _word(word: str) -> str:
    if not _CODE.search(word):
        return _prose(word)
    begin, end = _core(word)
    core = "".join(f"`{part}`" if n % 2 == 0 else _prose(part) for n, part in _pieces(word[begin:end]))
    return _prose(word[:begin]) + core + _prose(word[end:])


def _core(word: str) -> tuple[int, int]:
    """Return where in a word its code begins and ends: without stops, nor brackets and quotes that stand alone."""
    begin, end = 0, len(word)
    while begin < end and word[begin] in _PAIRS.values() and _unclosed(word[begin], word[begin:end]):
        begin += 1
    while begin < end and (word[end - 1] in _STOPS or _unopened(word[end - 1], word[begin:end])):
        end -= 1
    return begin, end


def _unclosed(opening: str, text: str) -> bool:
    return any(_odd(opening, closing, text) for closing, other in _PAIRS.items() if other == opening)


def _unopened(closing: str, text: str) -> bool:
    return closing in _PAIRS and _odd(_PAIRS[closing], closing, text)


def _odd(opening: str, closing: str, text: str) -> bool:
    return text.count(opening) % 2 == 1 if opening == closing else text.count(opening) != text.count(closing)


def _pieces(core: str) -> list[tuple[int, str]]:
    return [(n, part) for n, part in enumerate(_NOT_IN_CODE.split(core)) if part]


def _prose(text: str) -> str:
    return "".join(c if c.isalnum() or c in _INERT or not c.isascii() else f"&#{ord(c)};" for c in text)
