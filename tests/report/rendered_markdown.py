"""Markdown as GitHub renders it: GitHub's own parser, and the links and pictures that GitHub adds afterwards."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import cmarkgfm
from cmarkgfm.cmark import Options

#: Text outside of code that GitHub turns into links or pictures after it has rendered Markdown.
MADE_ACTIVE = re.compile(
    r"@[A-Za-z0-9]|#\d|\bGH-\d|:[a-z0-9+-]+:|https?://|ftp://|www\.|mailto:|\b[0-9a-f]{7,40}\b",
    re.IGNORECASE,
)


class Page(HTMLParser):
    """The elements, and the text within and outside of code, of rendered Markdown."""

    def __init__(self, markdown: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, tuple[tuple[str, str | None], ...]]] = []
        self.text = ""
        self.prose = ""
        self._codes = 0
        self.feed(
            cmarkgfm.github_flavored_markdown_to_html(
                markdown, Options.CMARK_OPT_UNSAFE | Options.CMARK_OPT_FOOTNOTES
            )
        )
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note an element."""
        self.elements.append((tag, tuple(attrs)))
        self._codes += tag == "code"
        if tag == "code":
            self.prose += "\0"  # Texts on both sides of code are apart.

    def handle_endtag(self, tag: str) -> None:
        """Note an element's end."""
        self._codes -= tag == "code"

    def handle_data(self, data: str) -> None:
        """Note text."""
        self.text += data
        if not self._codes:
            self.prose += data
