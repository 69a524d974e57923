"""Amount of trials: a part in every run, all with THOROUGH=1 (`make thorough`), and more examples with more.

Live cases have variables of their own, because all of them take hours: FIXTURES=all and ATTACKS=all, as `make fixtures`
and `make attacks` set them.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TypeVar

THOROUGH = int(os.environ.get("THOROUGH") or 0)
EVERY_FIXTURE = os.environ.get("FIXTURES") == "all"
EVERY_ATTACK = os.environ.get("ATTACKS") == "all"
_Case = TypeVar("_Case")


@cache
def _commit() -> int:
    """Return the commit's name as a number; 0 outside a checkout."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"]
    head = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    return int(head.strip() or "0", 16)


def examples(most: int = 100) -> int:
    """Return how many examples to draw: a quarter of `most` in every run, and with THOROUGH=20 twenty times as many."""
    return most * THOROUGH or max(most // 4, 5)


def part(cases: Sequence[_Case], of: int, everything: bool = THOROUGH > 0) -> Sequence[_Case]:
    """Return every so manieth of many cases, others for another commit; with THOROUGH, all."""
    return cases if everything else cases[_commit() % of :: of]
