"""Printed results of several rows, in the many forms that students use."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.text.result_rows import ResultRow, lines_naming, plain_numbers, result_row
from grader.recording.session import OutputLine
from tests.counted import calls_of

FAST_AND_SLOW = [
    # The lab's own form, and other units.
    "fast  :  998 msgs, avg latency: 0.50ms, max: 2.00ms\nslow  :  997 msgs, avg latency: 0.70ms, max: 3.00ms",
    "fast: 998 msgs, avg latency: 0.0005 s, max: 0.002 s\nslow: 997 msgs, avg latency: 0.0007 s, max: 0.003 s",
    "fast: 998 messages, mean 500 us, max 2000 us\nslow: 997 messages, mean 700 µs, max 3000 µs",
    "fast: received=998 mean=5.0e-4 s max=2e-3 s\nslow: received=997 mean=7.0e-4 s max=3e-3 s",
    "fast: mean 0.5 milliseconds, max 2 milliseconds, 998 messages\n"
    "slow: mean 0.7 milliseconds, max 3 milliseconds, 997 messages",
    "fast: sent=1000 received=998 lost=2 avg=0.5ms max=2.0ms\nslow: sent=1000 received=997 lost=3 avg=0.7ms max=3.0ms",
    "fast (depth 1): 998 msgs, avg-latency 0.5 ms, max-latency 2.0 ms\n"
    "slow (depth 10): 997 msgs, avg-latency 0.7 ms, max-latency 3.0 ms",
    "test_fast -> 998 mensajes, media 0.5 ms, máx 2.0 ms\ntest_slow -> 997 mensajes, media 0.7 ms, máx 3.0 ms",
    "fast：收到 998 条，平均延迟 0.5 ms，最大 2.0 ms\nslow：收到 997 条，平均延迟 0.7 ms，最大 3.0 ms",
    # Tables, with and without a header.
    "profile | msgs | mean (ms) | max (ms)\n--- | --- | --- | ---\nfast | 998 | 0.5 | 2.0\nslow | 997 | 0.7 | 3.0",
    "profile   msgs   mean_us   max_us\nfast      998    500.0     2000.0\nslow      997    700.0     3000.0",
    "│ profil │  msgs │ moy (s) │ max (s) │\n│ fast   │   998 │  0.0005 │   0.002 │\n"
    "│ slow   │   997 │  0.0007 │   0.003 │",
    "profile,sent,received,lost,min_ms,mean_ms,max_ms\nfast,1000,998,2,0.1,0.5,2.0\nslow,1000,997,3,0.1,0.7,3.0",
    "profile  max [ms]  mean [ms]  count\nfast     2.0       0.5        998\nslow     3.0       0.7        997",
    "fast | 998 | 0.5 | 2.0 | 0.0 %\nslow | 997 | 0.7 | 3.0 | 0.1 %",
    "fast  998  0.5  2.0\nslow  997  0.7  3.0",
    "fast: n=998,avg=0.5,max=2.0\nslow: n = 997, avg = 0.7, max = 3.0",
    # Blocks of lines, JSON, a logger.
    "[fast]\n  messages received: 998\n  average latency: 500.0 us\n  maximum latency: 2000.0 us\n"
    "[slow]\n  messages received: 997\n  average latency: 700.0 us\n  maximum latency: 3000.0 us",
    '{"fast": {"count": 998, "avg_ms": 0.5, "max_ms": 2.0},\n "slow": {"count": 997, "avg_ms": 0.7, "max_ms": 3.0}}',
    '{\n  "fast": {\n    "count": 998,\n    "avg_ms": 0.5,\n    "max_ms": 2.0\n  },\n'
    '  "slow": {\n    "count": 997,\n    "avg_ms": 0.7,\n    "max_ms": 3.0\n  }\n}',
    "[INFO] [1700.25] [qos]: fast: 998 msgs, avg 0.5 ms, max 2.0 ms\n"
    "[INFO] [1700.26] [qos]: slow: 997 msgs, avg 0.7 ms, max 3.0 ms",
    "fast: got 998 of 1000 messages, Ø 0.5 ms, max 2.0 ms\nslow: got 997 of 1000 messages, Ø 0.7 ms, max 3.0 ms",
    "fast: 998 Nachrichten, mittlere Latenz 0,50 ms, maximale Latenz 2,00 ms\n"
    "slow: 997 Nachrichten, mittlere Latenz 0,70 ms, maximale Latenz 3,00 ms",
    "{'fast': {'settings': '" + 300 * "." + "', 'received': 998, 'avg_ms': 0.5, 'max_ms': 2.0}, "
    "'slow': {'received': 997, 'avg_ms': 0.7, 'max_ms': 3.0}}",
    # Earlier lines about the rows.
    "created fast\ncreated slow\nfast: 998 msgs, avg 0.5 ms, max 2.0 ms\nslow: 997 msgs, avg 0.7 ms, max 3.0 ms",
]


def output(text: str) -> list[OutputLine]:
    """Give a text as a program's output."""
    return [OutputLine(n, "stdout", line) for n, line in enumerate(text.split("\n"))]


@pytest.mark.parametrize("text", FAST_AND_SLOW)
def test_results_are_read_however_they_are_printed(text: str) -> None:
    """Count, mean and maximum in seconds, each of its own row."""
    fast, slow = (
        result_row(output(text), "fast", ["slow"]),
        result_row(output(text), "slow", ["fast"]),
    )
    assert fast is not None
    assert slow is not None
    assert [fast.count, fast.mean_s, fast.max_s] == pytest.approx([998, 0.0005, 0.002])
    assert [slow.count, slow.mean_s, slow.max_s] == pytest.approx([997, 0.0007, 0.003])
    assert fast.t_ns < slow.t_ns or "\n" not in text


@pytest.mark.parametrize(
    ("text", "count", "mean_s"),
    [
        ("fast: 0 msgs, no latency data", 0, None),
        ("fast: 998 msgs", 998, None),
        ("fast: 998", 998, None),
        ("fast: 998 messages, latency 0.5 ms", 998, 0.0005),
        ("fast: 998 msgs, avg latency: -0.50 ms, max: 1.0 ms", 998, -0.0005),
    ],
)
def test_what_is_not_said_is_not_made_up(text: str, count: int, mean_s: float | None) -> None:
    """A bare count has no latency, and a negative one stays negative."""
    row = result_row(output(text), "fast", [])
    assert row is not None
    assert row.count == count
    assert row.mean_s == (pytest.approx(mean_s) if mean_s is not None else None)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "fast",
        "fast: depth 1, best effort",
        "breakfast: 998 msgs",
        "fast_2: 998 msgs",
        "fast took 10.0 s",
    ],
)
def test_where_nothing_is_said_there_is_no_row(text: str) -> None:
    """A name within another word, or without a count, is none."""
    assert result_row(output(text), "fast", ["slow"]) is None


def test_a_row_does_not_take_its_neighbours_numbers() -> None:
    """A row without results does not get the next row's."""
    text = "fast:\nslow: 997 msgs, avg 0.7 ms, max 3.0 ms"
    assert result_row(output(text), "fast", ["slow"]) is None
    assert result_row(output(text), "slow", ["fast"]) == ResultRow(1, 997, 0.7 * 1e-3, 3.0 * 1e-3)


def test_names_stand_by_themselves() -> None:
    """A name may follow `test_` or a slash, and is no part of another word."""
    assert lines_naming(["/test_fast: 1", "'fast'", "fast_lane", "steadfast"], "fast") == [0, 1]


@given(st.text(max_size=200), st.text(max_size=200))
def test_no_text_breaks_it(before: str, behind: str) -> None:
    """Whatever is printed, the answer is a row or none."""
    row = result_row(output(f"{before}fast{behind}\n{before}"), "fast", ["slow"])
    assert row is None or row.count >= 0


@pytest.mark.parametrize(
    "line",
    [
        "fast 1 2 3",
        "| fast | 1 | 2 | 3 |",
        "fast received 1 avg 1 ms max",
        "fast " + "1msgs avg1ms " * 500,
    ],
)
def test_endless_results_are_read_in_few_steps(line: str) -> None:
    """Only the first and the last of twenty thousand lines about a row are read closely."""
    output = [OutputLine(n, "stdout", line) for n in range(20_000)]
    assert calls_of(lambda: result_row(output, "fast", ["slow"])) < 1_000_000


def test_the_last_results_count_behind_thousands_of_lines_with_the_name() -> None:
    """A tool that prints each message still has its results read."""
    said = ["fast got one"] * 5000 + ["fast : 998 msgs, avg latency: 0.50ms, max: 2.00ms"]
    output = [OutputLine(n, "stdout", line) for n, line in enumerate(said)]
    row = result_row(output, "fast", ["slow"])
    assert row is not None
    assert row.count == 998
    assert row.mean_s == pytest.approx(0.0005)


@pytest.mark.parametrize("cell", ["1e999", "9" * 250, "-1e999", "1.5"])
def test_a_count_beyond_all_numbers_breaks_nothing(cell: str) -> None:
    """A cell of a table that means infinity, or a part of a message, is not taken for so many messages."""
    said = ["profile | msgs | mean (ms) | max (ms)", f"fast | {cell} | 0.5 | 2.0"]
    row = result_row(
        [OutputLine(n, "stdout", line) for n, line in enumerate(said)], "fast", ["slow"]
    )
    assert row is None or row.mean_s is None or row.count > 10**9


@pytest.mark.parametrize(
    ("line", "plain"),
    [
        ("fast: 1,001 msgs, avg: 1,234.5ms", "fast: 1001 msgs, avg: 1234.5ms"),
        ("fast: 1,001 messages", "fast: 1001 messages"),
        ("│ fast │ 1.001 │ 442,1 │ 3.630,6 │", "│ fast │ 1001 │ 442.1 │ 3630.6 │"),
        ("fast;1001;0,49;2,150", "fast;1001;0.49;2.150"),
        ("fast,1001,0.49,2.15", "fast,1001,0.49,2.15"),
        ("fast: 1001,490,2150", "fast: 1001,490,2150"),
        ("'fast': [1001,0.49]", "'fast': [1001,0.49]"),
        ("fast 1001 0.490 2.150", "fast 1001 0.490 2.150"),
        ("fast: 1001,0.49", "fast: 1001,0.49"),
        ("fast: 1001 msgs, avg: 1,234 ms", "fast: 1001 msgs, avg: 1.234 ms"),
        ("[1732250000.123] fast: 1,001 msgs", "[1732250000.123] fast: 1001 msgs"),
        ("2026-11-22 fast: 1,001 msgs", "2026-11-22 fast: 1001 msgs"),
        ("fast ([1,2]) 0,49", "fast ([1,2]) 0,49"),
    ],
)
def test_numbers_are_read_in_the_notation_of_their_line(line: str, plain: str) -> None:
    """Groups of three and a decimal comma are told from commas and dots that part values."""
    assert plain_numbers(line) == plain


@pytest.mark.parametrize(
    "line",
    [
        "fast: 998 msgs, 0.49 ms avg, 2.15 ms max",
        "fast: 0.49 avg, 2.15 max (n=998)",
        "fast: 998 messages | 490 us mean | 2150 us max",
        "fast: 998 messages, 0.49 milliseconds on average, 2.15 milliseconds max",
        "fast 998 avg 0.49 max 2.15",
        "fast: received 998, average 0.49 ms, max 2.15 ms",
    ],
)
def test_labels_stand_before_their_numbers_or_behind_them(line: str) -> None:
    """A mean is never taken for the maximum, even with a number nearer to the other label."""
    row = result_row(output(line), "fast", ["slow"])
    assert row is not None
    assert row.count == 998
    assert row.mean_s == pytest.approx(0.00049)
    assert row.max_s == pytest.approx(0.00215)


@pytest.mark.parametrize(
    "name", ["BEST_EFFORT", "Best Effort", "best-effort", "BestEffort", "/test_Best_Effort"]
)
def test_a_name_may_be_spelt_otherwise(name: str) -> None:
    """In capitals, apart or with hyphens it is the same name, if that is asked for; rows that begin with it count."""
    text = f"sensor_data ({name}): 9 msgs, avg 9 ms, max 9 ms\n{name}: 998 msgs, avg 0.5 ms, max 2.0 ms"
    row = result_row(output(text), "best_effort", ["sensor_data"], loosely=True)
    assert row == ResultRow(1, 998, 0.5 * 1e-3, 2.0 * 1e-3)
    assert result_row(output(text), "best_effort", ["sensor_data"]) is None


def test_a_block_in_another_spelling_ends_at_the_next_name() -> None:
    """Lines below the next name belong to the next name."""
    text = "Best Effort\n  received: 998\nReliable\n  received: 997\n  average: 0.7 ms"
    row = result_row(output(text), "best_effort", ["reliable"], loosely=True)
    assert row == ResultRow(0, 998, None, None)


@pytest.mark.parametrize(
    ("line", "rounding_s"),
    [
        ("fast: 998 msgs, avg latency 0 ms, max 2 ms", 1e-3),
        ("fast: 998 msgs, avg latency 0.4 ms, max 2.0 ms", 0.05e-3),
        ("fast: 998 msgs, avg latency 0.000 s, max 0.002 s", 0.5e-3),
        ("fast | 998 | 0.00 | 2.00", 0.005e-3),
        ("fast: 998 msgs, avg latency 0 s, max 0 s", 1e-3),
    ],
)
def test_how_far_a_latency_was_rounded_is_known(line: str, rounding_s: float) -> None:
    """Half of the last place, or all of a whole number, which may have been cut off; at most a millisecond."""
    row = result_row(output(line), "fast", [])
    assert row is not None
    assert row.rounding_s == pytest.approx(rounding_s)


def test_only_lines_about_a_thing_are_read_as_numbers() -> None:
    """Thousands of lines of commas are passed over; two calls and a few for each, not one for each of their numbers."""
    output = [OutputLine(n, "stdout", "1," * 500) for n in range(500)]
    output += [OutputLine(500, "stdout", "fast: 998 msgs, avg 0,5 ms, max 2 ms")]
    plain_numbers.cache_clear()
    assert result_row(output, "fast", ["slow"]) == ResultRow(500, 998, 0.0005, 0.002)
    assert plain_numbers.cache_info().misses <= 100
