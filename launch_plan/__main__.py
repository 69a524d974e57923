"""Print the plan of a launch file: `python -m launch_plan FILE name:=value`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from launch_plan.evaluation import evaluate
from launch_plan.text import as_text


def main(words: Sequence[str] | None = None) -> int:
    """Print a plan; return 0 if the file can be launched, else 1."""
    parser = argparse.ArgumentParser(
        prog="python -m launch_plan",
        description="Print the processes that `ros2 launch` would start. The launch file is executed, unconfined.",
    )
    parser.add_argument("file", type=Path, help="launch file in Python, XML or YAML")
    parser.add_argument("arguments", nargs="*", metavar="name:=value", help="launch arguments")
    parser.add_argument("--json", action="store_true", help="print the plan as JSON")
    parser.add_argument(
        "--native",
        action="store_true",
        help="evaluate with the real launch of a sourced ROS installation",
    )
    options = parser.parse_args(words)
    given: dict[str, str] = {}
    for word in options.arguments:
        name, _, value = word.partition(":=")
        if word.find(":=") < 1:
            parser.error(f"'{word}' is not of the form name:=value")
        given[name] = value
    plan = evaluate(options.file, given, native=options.native)
    print(json.dumps(plan.to_plain(), indent=1) if options.json else as_text(plan))
    return 0 if plan.outcome == "ok" else 1


if __name__ == "__main__":
    sys.exit(main())
