"""Untrusted text as JSON that every parser can read."""

from __future__ import annotations

import json
import math
import re
from typing import Any

_LONE = re.compile(r"[\ud800-\udbff](?![\udc00-\udfff])|(?<![\ud800-\udbff])[\udc00-\udfff]")


def json_text(value: Any) -> str:
    r"""Return plain data as the text of a JSON file: ASCII, two blanks to a level, a line end at the end.

    Half of a surrogate pair, as Python makes of a file name that is not UTF-8, could be written as `\ud800`,
    but strict parsers refuse it; it is shown as ⟨U+D800⟩. A number that JSON does not have (infinity, not a
    number) becomes null.
    """
    return json.dumps(_readable(value), indent=2, ensure_ascii=True, allow_nan=False) + "\n"


def readable(text: str) -> str:
    """Return a text with halves of surrogate pairs shown by their numbers."""
    return _LONE.sub(lambda found: f"⟨U+{ord(found[0]):04X}⟩", text)


def _readable(value: Any) -> Any:
    if isinstance(value, str):
        return readable(value)
    if isinstance(value, dict):
        return {_readable(key): _readable(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_readable(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
