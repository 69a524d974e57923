"""Expected answers of the lab's nodes."""

from collections.abc import Mapping
from typing import Any


def straight_line(
    request: Mapping[str, Any], parameters: Mapping[str, Any], seed: int
) -> dict[str, Any]:
    """Plan three poses from the origin to the goal."""
    goal = request["goal"]["pose"]["position"]
    found = {}
    for n in range(3):
        share = (2 - n if parameters.get("reversed") else n) / 2
        for axis in ("x", "y"):
            found[f"plan.poses[{n}].pose.position.{axis}"] = share * goal.get(axis, 0.0)
    return found
