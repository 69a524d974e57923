"""Parts of a result as `result.json` holds them, and of a rubric as its YAML does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def checks_of(plain: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the checks of all criteria."""
    found: list[dict[str, Any]] = []
    for criterion in plain["criteria"]:
        found += criterion["checks"]
    return found
