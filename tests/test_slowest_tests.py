"""The table of the slowest tests: the longest first, and the sum of all."""

from __future__ import annotations

import runpy
from pathlib import Path

TOOL = runpy.run_path(str(Path(__file__).resolve().parents[1] / "tools/slowest-tests"))
JUNIT = """<testsuites><testsuite name="pytest">
<testcase classname="tests.live.test_smoke" name="test_all" time="35.52" />
<testcase classname="tests.test_words" name="test_a_path[lab|report]" time="0.50"><skipped /></testcase>
</testsuite></testsuites>
"""


def test_the_longest_come_first_and_the_sum_last(tmp_path: Path) -> None:
    """Names are without the common package, and cannot end a cell of the table."""
    file = tmp_path / "quick.xml"
    file.write_text(JUNIT, encoding="utf-8")
    tests = TOOL["durations"](file)
    lines = TOOL["table"](tests * 20).splitlines()
    assert lines[2] == "| 35.5 | `live.test_smoke::test_all` |"
    assert lines[-2] == "| 0.5 | `test_words::test_a_path[lab report]` |"
    assert len(lines) == 2 + TOOL["ROWS"] + 1
    assert lines[-1].startswith("| 720 | all 40 tests, side by side on ")
