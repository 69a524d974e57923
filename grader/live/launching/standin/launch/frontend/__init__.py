"""XML and YAML launch files, brought into the same actions as Python ones."""

from __future__ import annotations

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
    """The launch description of an XML or YAML launch file."""
    from ._parser import Parser
    from ._readers import read_xml, read_yaml

    text = Path(path).read_text()
    is_xml = path.endswith(".xml") or (not path.endswith((".yaml", ".yml")) and text.lstrip().startswith("<"))
    root = read_xml(text, path) if is_xml else read_yaml(text, path)
    return Parser(path).parse_description(root)
