"""Launch descriptions as text."""

from __future__ import annotations

from typing import Any


class LaunchIntrospector:
    """Shows launch descriptions to people."""

    def format_launch_description(self, launch_description: Any) -> str:
        """One line for each entity, indented by its depth."""
        return "\n".join(_lines(launch_description, 0))


def _lines(entity: Any, depth: int) -> list[str]:
    lines = [f"{'    ' * depth}{entity.describe()}"]
    for inner in entity.describe_sub_entities() if depth < 20 else []:
        lines += _lines(inner, depth + 1)
    return lines
