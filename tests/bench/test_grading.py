"""Ratios and spreads of measurements."""

from __future__ import annotations

from bench.__main__ import table
from bench.grading import Command, Full, ratio, spread


def test_shares_and_ratios_are_of_medians() -> None:
    """One slow run moves the greatest, not the median."""
    assert spread([3.0, 1.0, 20.0]) == "3.00 s (1.00 – 20.00)"
    assert ratio([3.0, 1.0, 20.0], [2.0, 2.0]) == "1.50"
    assert Full(Command(12.0, 9.0), 5.0, 0).share == 0.8


def test_a_table_has_a_line_for_each_row() -> None:
    """Markdown: the head, the rule, the rows."""
    assert table(["a", "b"], [["1", "2"]]) == "| a | b |\n|---|---|\n| 1 | 2 |"
