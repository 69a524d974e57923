"""The pages of the documentation as texts: their blocks of code, and the code in their sentences."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "fixtures/README.md", *sorted((ROOT / "docs").glob("*.md"))]
_BLOCK = re.compile(
    r"^( *)```(\w*)(?: title=\"([^\"]+)\")?[^\n]*\n(.*?)^\1```$", re.MULTILINE | re.DOTALL
)
_INLINE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")


@dataclass(frozen=True)
class Block:
    """A fenced block of code: its language, the file that it is, if any, and its text."""

    language: str
    title: str
    text: str


def blocks(page: Path, language: str = "") -> list[Block]:
    """Give the blocks of a page, or those in one language."""
    found = _BLOCK.findall(page.read_text(encoding="utf-8"))
    listed = []
    for indent, kind, title, text in found:
        listed.append(Block(kind, title, re.sub(f"^{indent}", "", text, flags=re.M)))
    return [block for block in listed if language in ("", block.language)]


def inline(page: Path) -> list[str]:
    """Return the code in the sentences and tables of a page."""
    return _INLINE.findall(_BLOCK.sub("", page.read_text(encoding="utf-8")))


def command_lines(page: Path) -> Iterator[str]:
    """Return the lines of a page's shell blocks, joined with their continuations."""
    for block in blocks(page, "bash"):
        yield from filter(None, block.text.replace("\\\n", " ").splitlines())
