"""XML and YAML launch files, brought into the same actions as Python ones."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from .._base import InvalidLaunchFileError
from .expose import expose_action, expose_substitution

__all__ = ["Entity", "InvalidFrontendLaunchFileError", "Parser", "expose_action", "expose_substitution"]


class InvalidFrontendLaunchFileError(InvalidLaunchFileError):
    """An XML or YAML launch file is not what it should be."""


def __getattr__(name: str) -> Any:
    if name in ("Entity", "Parser"):
        from . import _parser

        return getattr(_parser, name)
    from .._catalogue import missing_name

    return missing_name(__name__, name)


def read_launch_file(path: str) -> Any:
    """The launch description of an XML or YAML launch file.

    Raises
    ------
    InvalidMarkupError
        It is neither.
    """
    from ._parser import Parser
    from ._readers import InvalidMarkupError, read_xml, read_yaml

    try:
        text = Path(path).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InvalidMarkupError("a character of this file is not encoded in UTF-8", (path, line)) from error
    # The name tells only what is tried first.
    is_xml = markup_of(text) == "xml" or (path.endswith(".xml") and markup_of(text) is None)
    root = read_xml(text, path) if is_xml else read_yaml(text, path)
    return Parser(path).parse_description(root)


def markup_of(text: str) -> str | None:
    """The language in which a text seems to be written: `xml`, `yaml`, or none of them."""
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        return "xml"
    return "yaml" if re.match(r"\ufeff?\s*(#.*\n\s*)*(%YAML|---|launch\s*:)", text) else None
