"""The outline of a README in Markdown, and in reStructuredText or plain text as far as Markdown can express it.

The reader is tolerant because students mix the three. Nothing raises, and the time is linear in the length of the text.
"""

from __future__ import annotations

import html
import re
from dataclasses import dataclass, field

from markdown_it import MarkdownIt
from markdown_it.token import Token

#: Characters that are read; no README written by hand comes near.
SIZE_LIMIT = 200_000
#: Characters of a line that are read.
LINE_LIMIT = 20_000

#: Parser without the rules for the inside of lines, and for tables and HTML, which decide about line breaks.
_MARKDOWN = MarkdownIt("commonmark").disable(["inline", "html_block"])

#: Comments, and metadata for programs in the first lines.
_NOT_SEEN = re.compile(
    r"<!--.*?(?:-->|\Z)|\A---\n(?:(?:\w[\w-]*:|[ #-])[^\n]*\n){1,60}?---\n", re.DOTALL
)
_HEADING_WITHOUT_BLANK = re.compile(r"^( {0,3}#{1,6})(?=[^\s#!a-z])", re.MULTILINE)
_BULLET = re.compile(r"^([ \t]*)[•‣–](?=[ \t])", re.MULTILINE)
_OPTION = re.compile(r"^[ \t]+:[\w-]+:.*$", re.MULTILINE)
_UNDERLINE = re.compile(r"([=\-~^\"'*+#])\1{2,}")
_DIRECTIVE = re.compile(r"[ \t]*\.\.[ \t]+([\w-]+)::[ \t]*(?![ \t])(.*)")
_CODE_DIRECTIVES = frozenset(["code", "code-block", "sourcecode", "parsed-literal"])
_HTML_HEADING = re.compile(r"[ \t]*<h([1-6])\b[^>]{0,200}>(.*)", re.IGNORECASE)
_BOLD_HEADING = re.compile(r"(?:\*\*|__)(?=\S)([^*_].{0,100}?)(?:\*\*|__):?[ \t]*")
_TABLE_RULE = re.compile(r"[ \t:=+|-]{3,}")
_SENTENCE_WORDS = 5


@dataclass(frozen=True)
class Block:
    """A piece of a document."""

    #: "paragraph", "item" (of a list), "row" (of a table) or "code".
    kind: str
    #: The text with its inline markup; cells of a row are separated by ` | `.
    text: str
    #: First line, counted from 1.
    line: int


@dataclass(frozen=True)
class Section:
    """A heading with the blocks below it, up to the next heading of any level."""

    #: Empty above the first heading.
    title: str
    #: From 1; 0 above the first heading.
    level: int
    #: Line of the heading.
    line: int
    #: In the order of their lines.
    blocks: list[Block] = field(default_factory=list)


def read_markdown(text: str) -> tuple[Section, ...]:
    """Return the sections of a README in Markdown, reStructuredText or plain text. Never raises."""
    outline = _Outline()
    for token in _MARKDOWN.parse(_as_markdown(text)):
        outline.read(token)
    return tuple(section for section in outline.sections if section.level or section.blocks)


class _Outline:
    """The sections of the tokens that were read."""

    def __init__(self) -> None:
        self.sections = [Section("", 0, 1)]
        #: Number of the open items of lists.
        self._items = 0
        #: Level of the heading that is open; 0 outside headings.
        self._level = 0

    def read(self, token: Token) -> None:
        line = token.map[0] + 1 if token.map else 0
        if token.type in ("list_item_open", "list_item_close"):
            self._items += token.nesting
        elif token.type == "heading_open":
            self._level = int(token.tag[1:])
        elif token.type == "fence":
            # The line above the code opens the fence.
            self._read_code(token.content, line + 1)
        elif token.type == "code_block" and not _is_sentence(token.content):
            self._read_code(token.content, line)
        elif token.type in ("inline", "code_block"):
            self._read_text(token.content, line)

    def _read_code(self, content: str, line: int) -> None:
        self.sections[-1].blocks.append(Block("code", content.rstrip("\n"), line))

    def _read_text(self, content: str, line: int) -> None:
        # Markdown takes several lines above a rule for a heading; they are a paragraph.
        if self._level and "\n" not in content:
            self.sections.append(Section(plain_text(content), self._level, line))
        else:
            kind = "item" if self._items else "paragraph"
            _read_lines(content, line, kind, self.sections)
        self._level = 0


def _is_sentence(code: str) -> bool:
    """Return whether text that is indented like code begins with a sentence, as in a layout made with blanks."""
    first = code.strip().partition("\n")[0]
    if first.startswith(("$", "ros2 ", "python")):
        return False
    return len(first.split()) >= _SENTENCE_WORDS


def _read_lines(content: str, first: int, kind: str, sections: list[Section]) -> None:
    """Add the lines of a paragraph: headings, rows of tables, and the text between them."""
    held: list[str] = []
    # The empty line ends the last text.
    for number, line in enumerate([*content.split("\n"), ""], first):
        line = line.strip()
        can_be_bold = number == first and kind == "paragraph"
        heading = _heading(line, number, can_be_bold=can_be_bold)
        is_row = line.count("|") > 1 or " | " in line
        is_rule = _TABLE_RULE.fullmatch(line) is not None
        is_text = heading is None and not is_row and not is_rule
        if line and is_text:
            held.append(line)
            continue
        if held:
            text = "\n".join(held)
            sections[-1].blocks.append(Block(kind, text, number - len(held)))
            held = []
        if heading is not None:
            sections.append(heading)
        elif is_row and not is_rule:
            cells = map(str.strip, line.strip("|").split("|"))
            sections[-1].blocks.append(Block("row", " | ".join(cells), number))


def _heading(line: str, number: int, *, can_be_bold: bool) -> Section | None:
    """Return the section of a heading in HTML, or in bold; None for another line."""
    tag = _HTML_HEADING.match(line)
    if tag is not None:
        return Section(plain_text(tag[2]), int(tag[1]), number)
    bold = _BOLD_HEADING.fullmatch(line) if can_be_bold else None
    if bold is not None:
        return Section(plain_text(bold[1]), 6, number)
    return None


def _as_markdown(text: str) -> str:
    """Return a text with its headings, lists and code written in Markdown, line for line."""
    text = text[:SIZE_LIMIT].removeprefix("\ufeff")
    text = text.replace("\r\n", "\n").replace("\r", "\n").replace("\0", "")
    text = _NOT_SEEN.sub(lambda match: "\n" * match[0].count("\n"), text)
    text = _HEADING_WITHOUT_BLANK.sub(r"\1 ", text)
    text = _BULLET.sub(r"\1-", text)
    text = _OPTION.sub("", text)
    lines = [line[:LINE_LIMIT].rstrip() for line in text.split("\n")]
    for at, line in enumerate(lines):
        directive = _DIRECTIVE.fullmatch(line)
        if directive is not None:
            lines[at] = directive[2] if " " in directive[2] else ""
            if directive[1].lower() in _CODE_DIRECTIVES:
                _fence(lines, at)
            continue
        rule = _UNDERLINE.fullmatch(line)
        if rule is not None:
            _mark_heading(lines, at, rule[1])
    return "\n".join(lines)


def _fence(lines: list[str], at: int) -> None:
    """Turn the code below a directive into a fenced block, in the lines of the directive and of the blank after it."""
    end = at + 1
    while end < len(lines) and (not lines[end] or lines[end][0] in " \t"):
        end += 1
    is_last = end == len(lines)
    if end - 1 > at and (is_last or not lines[end - 1]):
        lines[at] = "```"
        lines[end - 1] = lines[end - 1] or "```"


def _mark_heading(lines: list[str], at: int, sign: str) -> None:
    """Remove a line over a heading, or mark the heading above a line that Markdown does not know."""
    rule = lines[at]
    if rule in lines[at + 2 : at + 3] and lines[at + 1]:
        lines[at] = ""
        return
    above = lines[at - 1] if at >= 1 else ""
    before = lines[at - 2] if at >= 2 else ""
    if sign not in "=-" and 0 < len(above) <= len(rule) and not before:
        lines[at - 1] = f"### {above}"
        lines[at] = ""


_IMAGE = re.compile(r"!\[([^\[\]]{0,300})\]\([^()]{0,1000}\)")
_LINK = re.compile(r"\[([^\[\]]{0,300})\](?:\([^()]{0,1000}\)|\[[^\[\]]{0,100}\])")
_RST_LINK = re.compile(r"`([^`<>]{0,200})<[^`<>]{0,500}>`_{1,2}")
_TAG = re.compile(r"</?[A-Za-z][^<>]{0,300}>")
_URL = re.compile(r"<?(?:https?|ftp)://[^\s<>)]{0,2000}>?")
_CODE_SPAN = re.compile(r"(`{1,2})(?!`)([^`]{1,500})\1")
_ROLE = re.compile(r":[a-z]{2,20}:(?=`)")


def plain_text(text: str) -> str:
    """Return a text without markup, link targets and images; the words of code spans stay."""
    return _strip(text, keep_code=True)


def own_text(text: str) -> str:
    """Return a text without markup, links, images and code spans: the author's own words."""
    return _strip(text, keep_code=False)


def code_spans(text: str) -> list[str]:
    """Return the code between backquotes in a text."""
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
