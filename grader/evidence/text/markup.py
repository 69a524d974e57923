"""The outline of a README: Markdown, and of reStructuredText and plain text what can be written in Markdown too.

Tolerant on purpose: students mix the three. Nothing raises, and the time grows with the length of the text.
"""

from __future__ import annotations

import html
import re
from dataclasses import dataclass, field

from markdown_it import MarkdownIt

#: Characters that are read; no README written by hand comes near.
SIZE_LIMIT = 200_000

LINE_LIMIT = 20_000

#: Its rules for what stands within a line are not used, nor those for tables and HTML, which say where lines break.
_MARKDOWN = MarkdownIt("commonmark").disable(["inline", "html_block"])

#: Comments, and what a text tells programs in its first lines.
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
    #: Its text; markup inside the line is left as it is, a row's cells are parted by ` | `.
    text: str
    #: Its first line, counted from 1.
    line: int


@dataclass(frozen=True)
class Section:
    """A heading with what stands below it, up to the next heading of any level."""

    #: Empty for what stands above the first heading.
    title: str
    #: From 1; 0 above the first heading.
    level: int
    #: Line of the heading.
    line: int
    #: In the order of their lines.
    blocks: list[Block] = field(default_factory=list)


def read_markdown(text: str) -> tuple[Section, ...]:
    """Return the sections of a README in Markdown, reStructuredText or plain text. Never raises."""
    text = _as_markdown(text)
    sections = [Section("", 0, 1)]
    items = level = 0
    for token in _MARKDOWN.parse(text):
        line = token.map[0] + 1 if token.map else 0
        if token.type in ("list_item_open", "list_item_close"):
            items += token.nesting
        elif token.type == "heading_open":
            level = int(token.tag[1:])
        elif token.type == "fence":
            sections[-1].blocks.append(Block("code", token.content.rstrip("\n"), line + 1))
        elif token.type == "code_block" and not _is_sentence(token.content):
            sections[-1].blocks.append(Block("code", token.content.rstrip("\n"), line))
        elif token.type in ("inline", "code_block"):
            # Several lines above a rule are a paragraph, whatever Markdown makes of them.
            if level and "\n" not in token.content:
                sections.append(Section(plain_text(token.content), level, line))
            else:
                _read_lines(token.content, line, "item" if items else "paragraph", sections)
            level = 0
    return tuple(s for s in sections if s.level or s.blocks)


def _is_sentence(code: str) -> bool:
    """Whether what is indented like code begins with a sentence, as in a text that is laid out with blanks."""
    first = code.strip().partition("\n")[0]
    return len(first.split()) >= _SENTENCE_WORDS and not first.startswith(("$", "ros2 ", "python"))


def _read_lines(content: str, first: int, kind: str, sections: list[Section]) -> None:
    """Add the lines of a paragraph: headings, rows of tables, and the text between them."""
    held: list[str] = []
    for number, line in enumerate([*content.split("\n"), ""], first):
        line = line.strip()
        tag = _HTML_HEADING.match(line)
        bold = _BOLD_HEADING.fullmatch(line) if number == first and kind == "paragraph" else None
        is_row, is_rule = (
            line.count("|") > 1 or " | " in line,
            _TABLE_RULE.fullmatch(line) is not None,
        )
        if line and not (tag or bold or is_row or is_rule):
            held.append(line)
            continue
        if held:
            sections[-1].blocks.append(Block(kind, "\n".join(held), number - len(held)))
            held = []
        if tag is not None:
            sections.append(Section(plain_text(tag[2]), int(tag[1]), number))
        elif bold is not None:
            sections.append(Section(plain_text(bold[1]), 6, number))
        elif is_row and not is_rule:
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            sections[-1].blocks.append(Block("row", " | ".join(cells), number))


def _as_markdown(text: str) -> str:
    """Return a text whose headings, lists and code are written as Markdown has them, line for line."""
    text = (
        text[:SIZE_LIMIT]
        .removeprefix("\ufeff")
        .replace("\r\n", "\n")
        .replace("\r", "\n")
        .replace("\0", "")
    )
    text = _NOT_SEEN.sub(lambda match: "\n" * match[0].count("\n"), text)
    text = _OPTION.sub("", _BULLET.sub(r"\1-", _HEADING_WITHOUT_BLANK.sub(r"\1 ", text)))
    lines = [line[:LINE_LIMIT].rstrip() for line in text.split("\n")]
    for at, line in enumerate(lines):
        if (directive := _DIRECTIVE.fullmatch(line)) is not None:
            lines[at] = directive[2] if " " in directive[2] else ""
            if directive[1].lower() in _CODE_DIRECTIVES:
                end = next(
                    (n for n in range(at + 1, len(lines)) if lines[n] and lines[n][0] not in " \t"),
                    len(lines),
                )
                if end - 1 > at and (end == len(lines) or not lines[end - 1]):
                    lines[at], lines[end - 1] = "```", lines[end - 1] or "```"
        elif (rule := _UNDERLINE.fullmatch(line)) is not None:
            above, over = (lines[at - n] if at >= n else "" for n in (1, 2))
            if line in lines[at + 2 : at + 3] and lines[at + 1]:
                lines[at] = ""
            elif rule[1] not in "=-" and 0 < len(above) <= len(line) and not over:
                lines[at - 1 : at + 1] = [f"### {above}", ""]
    return "\n".join(lines)


_IMAGE = re.compile(r"!\[([^\[\]]{0,300})\]\([^()]{0,1000}\)")
_LINK = re.compile(r"\[([^\[\]]{0,300})\](?:\([^()]{0,1000}\)|\[[^\[\]]{0,100}\])")
_RST_LINK = re.compile(r"`([^`<>]{0,200})<[^`<>]{0,500}>`_{1,2}")
_TAG = re.compile(r"</?[A-Za-z][^<>]{0,300}>")
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
