"""The outline of a README: Markdown, reStructuredText or plain text, told by its lines.

Tolerant on purpose: students mix the three. Nothing raises, and all is linear in the length of the text.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from dataclasses import dataclass, field

SIZE_LIMIT = 200_000
"""Characters that are read; no README written by hand comes near."""

LINE_LIMIT = 20_000

_FENCE = re.compile(r"[ \t]*(?:>[ \t]?)?(`{3,}|~{3,})[ \t]*([^`]*)$")
_ATX = re.compile(r" {0,3}(#{1,6})[ \t]*(?=[^\s#!])(.*)$")
_UNDERLINE = re.compile(r"([=\-~^\"'`*+#:.])\1{2,}[ \t]*$")
_RULE = re.compile(r"[ \t]*(?:([-*_=+])[ \t]*)(?:\1[ \t]*){2,}$")
_ITEM = re.compile(r"([ \t]*)(?:[-*+•‣–][ \t]+|\(?(?:\d{1,3}|[a-zA-Z])[.)][ \t]+)(?=\S)(.*)$")
_TABLE_RULE = re.compile(r"[ \t:=+|-]+$")
_HTML_HEADING = re.compile(r"[ \t]*<h([1-6])\b[^>]{0,200}>(.*)$", re.IGNORECASE)
_TAG = re.compile(r"</?[A-Za-z][^<>]{0,300}>")
_DIRECTIVE = re.compile(r"[ \t]*\.\.[ \t]+([\w-]+)::[ \t]*(.*)$")
_CODE_DIRECTIVES = frozenset(["code", "code-block", "sourcecode", "parsed-literal", "highlight"])
_SILENT_DIRECTIVES = frozenset(["image", "figure", "contents", "toctree", "include", "raw", "math"])
_SENTENCE_WORDS = 5
_PSEUDO_TITLE = re.compile(r"(?:\*\*|__)(?=\S)([^*_].{0,100}?)(?:\*\*|__):?[ \t]*$")


@dataclass(frozen=True)
class Block:
    """A piece of a document.

    Attributes
    ----------
    kind : str
        "paragraph", "item" (of a list), "row" (of a table) or "code".
    text : str
        Its text; markup inside the line is left as it is, a row's cells are parted by ` | `.
    line : int
        Its first line, counted from 1.
    """

    kind: str
    text: str
    line: int


@dataclass(frozen=True)
class Section:
    """A heading with what stands below it, up to the next heading of any level.

    Attributes
    ----------
    title : str
        Empty for what stands above the first heading.
    level : int
        From 1; 0 above the first heading.
    line : int
        Line of the heading.
    blocks : tuple of Block
        In the order of their lines.
    """

    title: str
    level: int
    line: int
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Document:
    """A text in sections; `lines` is how many it has."""

    sections: tuple[Section, ...]
    lines: int

    def blocks(self, *kinds: str) -> Iterator[Block]:
        """Its blocks of some kinds, of all kinds if none is named."""
        for section in self.sections:
            for block in section.blocks:
                if not kinds or block.kind in kinds:
                    yield block


@dataclass
class _Open:
    title: str
    level: int
    line: int
    blocks: list[Block] = field(default_factory=list)


def read_markdown(text: str) -> Document:
    """Read a README in Markdown, reStructuredText or plain text. Never raises."""
    return _Reader(text).document()


class _Reader:
    """Goes over the lines once, holding the block that is being read."""

    def __init__(self, text: str) -> None:
        text = text[:SIZE_LIMIT].removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
        text = _without_html_comments(text)
        self.lines = [line[:LINE_LIMIT].replace("\0", "") for line in text.split("\n")]
        self.number = 0
        self.sections = [_Open("", 0, 1)]
        self.kind = ""
        self.start = 0
        self.held: list[str] = []
        self.levels: dict[str, int] = {}

    def document(self) -> Document:
        """All sections, the first one only where something stands above the first heading."""
        self.number = self._behind_front_matter()
        while self.number < len(self.lines):
            self.number += self._step(self.lines[self.number])
        self._flush()
        kept = [s for s in self.sections if s.level or s.blocks]
        sections = tuple(Section(s.title, s.level, s.line, tuple(s.blocks)) for s in kept)
        return Document(sections, len(self.lines))

    def _behind_front_matter(self) -> int:
        if self.lines[0].strip() == "---":
            for number, line in enumerate(self.lines[1:60], 1):
                if line.strip() == "---":
                    return number + 1
                if line.strip() and ":" not in line and not line.startswith((" ", "-", "#")):
                    break
        return 0

    def _step(self, line: str) -> int:
        """Read what begins at the current line; how many lines that took."""
        stripped = line.strip()
        if not stripped:
            self._flush()
            return 1
        if fence := _FENCE.match(line):
            return self._fenced(fence[1])
        if directive := _DIRECTIVE.match(line):
            return self._directive(directive[1].lower(), directive[2])
        taken = self._heading(line)
        if taken:
            return taken
        if not self.kind and self._is_indented_code():
            return self._indented("code")
        self._text(line)
        return 1

    # -- headings --------------------------------------------------------------------------------------

    def _heading(self, line: str) -> int:
        if atx := _ATX.match(line):
            rest = atx[2].strip()
            if line.lstrip()[len(atx[1])] in " \t" or not rest[0].islower():
                self._open(rest.rstrip("#").strip(), len(atx[1]))
                return 1
        if tag := _HTML_HEADING.match(line):
            self._open(plain_text(tag[2]), int(tag[1]))
            return 1
        below = self._line(1)
        if self._is_title(line) and self._underlines(line, below):
            self._open(line.strip(), self._level(below[0]))
            return 2
        if _UNDERLINE.match(line) and line.strip() == self._line(2).strip() and self._is_title(below):
            self._open(below.strip(), self._level(line[0]))
            return 3
        if _RULE.match(line) and not self.held:
            return 1
        pseudo = _PSEUDO_TITLE.match(line.strip())
        if pseudo and not self._line(-1).strip() and len(line) < 120:
            self._open(pseudo[1], 6)
            return 1
        return 0

    def _is_title(self, line: str) -> bool:
        return bool(line.strip()) and len(line) < 160 and "|" not in line and not self.held

    def _underlines(self, title: str, below: str) -> bool:
        match = _UNDERLINE.match(below)
        if match is None or _ITEM.match(title) or _UNDERLINE.match(title):
            return False
        return match[1] in "=-" or len(below.strip()) >= len(title.strip()) // 2

    def _level(self, mark: str) -> int:
        """Marks rank as Markdown has them, others as they first appear."""
        fixed = {"=": 1, "-": 2}.get(mark)
        return fixed or self.levels.setdefault(mark, 3 + min(len(self.levels), 3))

    def _open(self, title: str, level: int) -> None:
        self._flush()
        self.sections.append(_Open(plain_text(title), level, self.number + 1))

    # -- code ------------------------------------------------------------------------------------------

    def _fenced(self, fence: str) -> int:
        self._flush()
        first = self.number + 1
        last = first
        while last < len(self.lines):
            closing = self.lines[last].strip().lstrip(">").strip()
            if closing.startswith(fence) and not closing.strip(fence[0]):
                break
            last += 1
        self._add("code", self.lines[first:last], first + 1)
        return min(last + 1, len(self.lines)) - self.number

    def _directive(self, name: str, argument: str) -> int:
        self._flush()
        if name in _CODE_DIRECTIVES:
            return self._indented("code", skip=1)
        if name in _SILENT_DIRECTIVES:
            return self._indented("", skip=1)
        if argument:
            self._add("paragraph", [argument], self.number + 1)
        return 1

    def _is_indented_code(self) -> bool:
        """Whether indented code begins here: below `::`, or unlike sentences and not in a list."""
        line = self.lines[self.number]
        if not line.startswith(("    ", "\t")) or _ITEM.match(line):
            return False
        blocks = self.sections[-1].blocks
        if blocks and blocks[-1].kind == "paragraph" and blocks[-1].text.endswith("::"):
            return True
        if blocks and blocks[-1].kind == "item":
            return False
        return len(line.split()) < _SENTENCE_WORDS or line.strip().startswith(("$", "ros2 ", "python"))

    def _indented(self, kind: str, skip: int = 0) -> int:
        """Take the indented lines that begin `skip` lines on; how many lines that took in all."""
        first = self.number + skip
        last = first
        while last < len(self.lines) and (self.lines[last].startswith((" ", "\t")) or not self.lines[last].strip()):
            last += 1
        content = [line for line in self.lines[first:last] if not re.match(r"\s*:[\w-]+:", line)]
        if kind and any(line.strip() for line in content):
            self._add(kind, content, first + 1)
        return max(last - self.number, 1)

    # -- text ------------------------------------------------------------------------------------------

    def _text(self, line: str) -> None:
        line = re.sub(r"^[ \t]*>[ \t]?", "", line)
        if _is_row(line):
            self._flush()
            if not _is_table_rule(line):
                cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
                self._add("row", [" | ".join(cells)], self.number + 1)
            return
        if _is_table_rule(line):
            self._flush()
            return
        if item := _ITEM.match(line):
            self._flush()
            self.kind, self.start, self.held = "item", self.number + 1, [item[2]]
            return
        if not self.kind:
            self.kind, self.start = "paragraph", self.number + 1
        self.held.append(line.strip())

    def _flush(self) -> None:
        if self.held:
            self._add(self.kind, self.held, self.start)
        self.kind, self.held = "", []

    def _add(self, kind: str, lines: list[str], start: int) -> None:
        self.sections[-1].blocks.append(Block(kind, "\n".join(lines), start))

    def _line(self, offset: int) -> str:
        place = self.number + offset
        return self.lines[place] if 0 <= place < len(self.lines) else ""


def _is_row(line: str) -> bool:
    stripped = line.strip()
    return (stripped.startswith("|") and stripped.count("|") >= 2) or stripped.count(" | ") >= 1


def _is_table_rule(line: str) -> bool:
    return _TABLE_RULE.match(line) is not None and ("--" in line or "==" in line)


def _without_html_comments(text: str) -> str:
    """`text` with `<!-- -->` comments blanked out, line for line."""
    pieces: list[str] = []
    position = 0
    while (start := text.find("<!--", position)) >= 0:
        end = text.find("-->", start)
        if end < 0:
            break
        pieces.append(text[position:start])
        pieces.append("\n" * text.count("\n", start, end))
        position = end + 3
    pieces.append(text[position:])
    return "".join(pieces)


_IMAGE = re.compile(r"!\[([^\[\]]{0,300})\]\([^()]{0,1000}\)")
_LINK = re.compile(r"\[([^\[\]]{0,300})\](?:\([^()]{0,1000}\)|\[[^\[\]]{0,100}\])")
_RST_LINK = re.compile(r"`([^`<>]{0,200})<[^`<>]{0,500}>`_{1,2}")
_URL = re.compile(r"<?(?:https?|ftp)://[^\s<>)]{0,2000}>?")
_CODE_SPAN = re.compile(r"(`{1,2})(?!`)([^`]{1,500})\1")
_ROLE = re.compile(r":[a-z]{2,20}:(?=`)")


def plain_text(text: str) -> str:
    """`text` without markup, link targets and images; the words of code spans stay."""
    return _strip(text, keep_code=True)


def own_text(text: str) -> str:
    """`text` without markup, links, images and code spans: what its author put into words."""
    return _strip(text, keep_code=False)


def code_spans(text: str) -> list[str]:
    """The code that stands between backquotes in `text`."""
    return [match[2].strip() for match in _CODE_SPAN.finditer(text)]


def _strip(text: str, keep_code: bool) -> str:
    if "`" in text:
        text = _RST_LINK.sub(r"\1", _ROLE.sub("", text))
        text = _CODE_SPAN.sub(r" \2 " if keep_code else " ", text)
    if "[" in text:
        text = _LINK.sub(r"\1", _IMAGE.sub(" ", text))
    if ":" in text:
        text = _URL.sub(" ", text)
    if "<" in text:
        text = _TAG.sub(" ", text)
    if "&" in text:
        text = html.unescape(text)
    return re.sub(r"\*+|__+|~~|(?<!\w)_|_(?!\w)", " ", text).strip()
