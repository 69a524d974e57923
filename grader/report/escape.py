"""Untrusted text made fit to be shown: in a page, on a terminal, in the log of a CI job and in Markdown.

Characters that would steer a terminal, hide or reorder text become visible; commands to another reader stay text.
Libraries escape for HTML and XML.
"""

from __future__ import annotations

import re
import unicodedata

LONGEST = 4000

#: Sequences that a terminal obeys and does not show: CSI, OSC and other strings, and two-character escapes.
_ANSI = re.compile(
    r"(?:\x1b\[|\x9b)[0-?]*[ -/]*[@-~]"
    # A string ends before the next one begins: thousands of beginnings would each be read to the end.
    r"|(?:\x1b[\]PX^_]|[\x9d\x90\x98\x9e\x9f])[^\x07\x1b\x9c\x9d\x90\x98\x9e\x9f]{0,4000}(?:\x07|\x1b\\|\x9c)"
    r"|\x1b[ -/]*[0-~]"
)
_MOST_MARKS = 3
#: Line end, tab, and the joiners that some scripts and emoji are written with.
_KEPT = "\n\t\u200c\u200d"
#: Control, format (direction, no width), surrogate, private, no character at all, line and paragraph separators.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})


def shown(text: str, longest: int = LONGEST) -> str:
    """Return a text as it can be shown, cut after `longest` characters, with a mark at the cut.

    Terminal sequences are left out. A character that is hidden, or changes the direction of text, is shown by its
    number, such as ⟨U+202E⟩. Line ends and tabs stay, and at most three combining marks on a letter.
    """
    if len(text) <= longest and text.isascii() and text.isprintable():
        return text  # Nearly all texts end here.
    cut = len(text) > longest * 2
    text = _ANSI.sub("", text[: longest * 2])
    cut = cut or len(text) > longest
    kept: list[str] = []
    marks = 0
    for character in text[:longest].replace("\r\n", "\n"):
        marks = marks + 1 if unicodedata.combining(character) else 0
        if marks <= _MOST_MARKS:
            hidden = character not in _KEPT and unicodedata.category(character) in _HIDDEN
            if hidden:
                character = f"⟨U+{ord(character):04X}⟩"
            kept.append(character)
    if cut:
        kept.append(" … (cut)")
    return "".join(kept)


def line(text: str, longest: int = 300) -> str:
    """Return a text as one line that can be shown; cut with an ellipsis."""
    most = longest * 4
    words = shown(" ".join(text[:most].split()), most)
    # A terminal sequence between two blanks has left both.
    whole = " ".join(words.split())
    if len(text) > most or len(whole) > longest:
        return whole[: longest - 1] + "…"
    return whole


# -- terminal and CI log -----------------------------------------------------------------------
# GitHub's runner reads each printed line for `::name properties::data` at its start (after blanks) and for
# `##[name properties]data` anywhere in it. Azure Pipelines and TeamCity use `##word[` in the same way.

#: First of two colons that can begin a command, wherever a line may be broken.
_COLONS = re.compile(r":(?=:[^\s:])")
_BRACKET = re.compile(r"##(?=[A-Za-z]*\[)")


def command_data(text: str, longest: int = LONGEST) -> str:
    """Return a text as the data of a workflow command; line ends stay, in the runner's notation."""
    return _percent(uncommanded(shown(text, longest)))


def command_property(text: str, longest: int = LONGEST) -> str:
    """Return a text as the value of a property of a workflow command, on one line."""
    return _percent(line(text, longest)).replace(":", "%3A").replace(",", "%2C")


def uncommanded(text: str) -> str:
    """Return a text without any workflow command, at whatever place its lines are broken when it is printed.

    A blank parts two colons before a name with two more after it, and `##` from a bracket. Names of two parts in C++
    stay.
    """
    last = text.rfind("::")

    def parting(found: re.Match[str]) -> str:
        return ": " if found.start() + 2 <= last else ":"

    parted = _COLONS.sub(parting, text)
    return _BRACKET.sub("## ", parted)


def _percent(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def terminal_text(text: str, limit: int = 400) -> str:
    """Return a text as one line that neither a terminal nor a CI log obeys, wherever it is broken, cut to a length."""
    whole = uncommanded(line(text, limit))
    if len(whole) <= limit:
        return whole
    return whole[: limit - 1] + "…"


# -- Markdown as GitHub renders it -------------------------------------------------------------

#: Words that GitHub turns into links or pictures after it has rendered Markdown, except in a code span: mentions,
#: addresses, numbers of issues, emoji, URLs, commits, ticket numbers. Names of files and topics (with a point, an
#: underscore, a leading slash) are set as code to be easier to read.
_CODE = re.compile(
    r"[@#_]|:(?!$)|^\W*/|www\.|\w\.[^\W\d_]{2}|(?<![^\W_])[0-9a-f]{7,}(?![^\W_])|[A-Za-z]-\d",
    re.IGNORECASE,
)
#: A word without the stops, brackets and quotes around it; the brackets of a call belong to the word.
_AROUND = re.compile(r"([(\"'‘“]*)(.*?(?:\(\))?)([)\"'’”.,;:!?…]{0,20})", re.DOTALL)
#: Characters that end a code span, part a table's cells, or open a formula.
_NOT_IN_CODE = re.compile(r"([`|$])")
#: Beginning of a list, a rule, or the underline of a heading or of a table's first row.
_BLOCK = re.compile(r"[-+=:]|\d+[.)]")
#: ASCII characters that are never markup within a line.
_INERT = frozenset(",.;:%()'\"?/+-= ")


def markdown_text(text: str, longest: int = 600) -> str:
    """Return one line of Markdown, also for a table, that is rendered as `line` shows the text, and does nothing.

    Escapes are not enough: mentions, addresses and issue numbers become links in rendered Markdown. Therefore a word
    that could become one is set as code, and elsewhere each character that could be markup is written by its number.

    References
    ----------
    GitHub Flavored Markdown Spec 0.29, 4.10 (tables), 6.2 (entities), 6.3 (code spans), 6.9 (autolinks).
    """
    words = [_word(word) for word in line(text, longest).split(" ")]
    whole = " ".join(words)
    if _BLOCK.match(whole):
        return f"&#{ord(whole[0])};{whole[1:]}"
    return whole


def _word(word: str) -> str:
    if not _CODE.search(word):
        return _prose(word)
    around = _AROUND.fullmatch(word)
    assert around is not None
    core = ""
    for n, part in enumerate(_NOT_IN_CODE.split(around[2])):
        if n % 2:
            core += _prose(part)
        elif part:
            core += f"`{part}`"
    return _prose(around[1]) + core + _prose(around[3])


def _prose(text: str) -> str:
    """Write each character that could be markup by its number: `*` as `&#42;`."""
    written = ""
    for character in text:
        is_inert = character.isalnum() or character in _INERT
        if character.isascii() and not is_inert:
            character = f"&#{ord(character)};"
        written += character
    return written
