"""Messages of the director to its session: lines of JSON on standard output, `[kind, value]`.

A kind is "answer", or the name of a list of the session's record that takes the value, e.g. "problems".
"""

from __future__ import annotations

import json
import sys
from typing import Any


def report(kind: str, value: Any) -> None:
    """Write a message."""
    # As records are written, without a copy of all values.
    sys.stdout.write(json.dumps([kind, value], default=vars) + "\n")
    sys.stdout.flush()
