"""Each reader of students' texts takes time in proportion to the text, and raises only documented exceptions."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from grader.checks.launch import parameter_line
from grader.evidence import newer_python
from grader.evidence.crash import diagnosis
from grader.evidence.near_miss import likeness
from grader.evidence.text import markup, printed, prose, result_rows, sources, words
from grader.judging.rubrics import read_rubric
from grader.lab.patterns import Budget, patterns_bounded, search
from grader.recording.session import OutputLine
from grader.report.escape import shown
from grader.submission.file_names import UnfitError, clean_parts, displayed
from grader.submission.packages.colcon import find_packages
from launch_plan.inside import parameter_text
from tests.thorough import examples, part

pytestmark = pytest.mark.slow

NAMES = ("best_effort", "reliable")
PARTS = words.Terms.of(("publisher", "subscriber"), 3)
PYTHON = "<package><name>p</name><export><build_type>ament_python</build_type></export></package>"
#: Limit far above the time of any of these texts, noise included, and far below a quadratic
#: reader's.
MOST_S = 10.0


def _output(text: str) -> list[OutputLine]:
    return [OutputLine(n, "stdout", line) for n, line in enumerate(text.split("\n"))]


def _read_readme(text: str) -> None:
    document = markup.read_markdown(text)
    blocks, _ = prose.visible(document, PARTS, [r"^\W*todo\b(?:\W+\w+){0,6}\W*$"])
    prose.mention(blocks, PARTS, PARTS)
    list(prose.command_lines(blocks, [r"ros2\s+(?:run|launch)\s+\S+\s+\S+"]))
    prose.instruction_line(blocks, ["run"])
    prose.concepts(
        prose.document_passages(document, "R"),
        {"x": ["reliab"], "y": ["*laten"]},
        ["because"],
        ["qos"],
    )


def _read_source(text: str) -> None:
    (facts,) = sources.read_sources({"a.py": text})
    prose.source_passages(facts)
    newer_python.python_needed(text)
    parameter_line(text, 1, "p")


def _read_results(text: str) -> None:
    for loosely in (False, True):
        result_rows.result_row(
            _output(f"best_effort: {text}\n{text}"), NAMES[0], NAMES[1:], loosely=loosely
        )


def _read_statistics(text: str) -> None:
    printed.printed_vector(
        _output(f"Mean {text}"), ["Mean", "average"], after_ns=0, unless="root|square"
    )


def _read_output(text: str) -> None:
    trace = f'Traceback (most recent call last):\n  File "a.py", line 1, in f\nNameError: {text}\n'
    diagnosis.explain(_output(trace + text), ["a.py"])
    diagnosis.advisories(_output(text))


def _read_packages(text: str) -> None:
    for name, others in (
        ("package.xml", {}),
        ("setup.py", {"package.xml": PYTHON}),
        ("setup.cfg", {"package.xml": PYTHON}),
    ):
        find_packages({**others, name: text}, [name, "a.py"])


def _read_parameters(text: str) -> None:
    with suppress(yaml.YAMLError):
        parameter_text.read(text)


def _read_names(text: str) -> None:
    with suppress(UnfitError):
        clean_parts(text[:5000])
    displayed(text[:5000])
    likeness("/joint_states", text[:5000])
    shown(text)


READERS: dict[str, Callable[[str], None]] = {
    "README": _read_readme,
    "source": _read_source,
    "results": _read_results,
    "statistics": _read_statistics,
    "output": _read_output,
    "packages": _read_packages,
    "parameters": _read_parameters,
    "names": _read_names,
}
PIECES = (
    *(
        "1",
        "1 ",
        "1.",
        "+1",
        "1e",
        "1,",
        "1 ms ",
        "1 milli",
        "j1=1 ",
        "avg ",
        "max x ",
        "received ",
        "latenc",
    ),
    *(
        "Mean [",
        "Mean: ",
        " ",
        "a ",
        "\n",
        "`",
        "[a](",
        "![",
        "<a ",
        "<!--",
        "**a",
        "# a\n",
        "a\n===\n",
        "a | b\n",
    ),
    *(
        "1. a\n",
        "http://",
        ".. a::\n",
        "# x = (\n",
        "# @a(\n",
        "'''",
        "f'{",
        "{",
        "(",
        "not ",
        "lambda:",
        "\\",
        '"',
    ),
    *(
        "def f():\n  pass\n",
        "class A:\n  pass\n",
        "Traceback (most recent call last):\n",
        "a.b:",
        "\x1b[0;",
    ),
    *('  File "a.py", line 1, in f\n', "incompatible QoS ", "- ", "&a ", "[", "/"),
)


@pytest.mark.parametrize("reader", READERS)
def test_what_is_hardest_takes_bounded_time(reader: str) -> None:
    """Sixty thousand characters of any piece that opens something, ends a number or begins a label are soon read."""
    for piece in part(PIECES, 3):
        began_s = time.process_time()
        READERS[reader]((piece * 60_000)[:60_000])
        assert time.process_time() - began_s < MOST_S, piece


def test_nested_f_strings_are_read_once_a_level() -> None:
    """A hundred f-strings within each other behind a syntax error take no time to speak of."""
    nested = "x"
    for _ in range(90):
        nested = "f'{" + nested + "}'"
    began_s = time.process_time()
    assert not newer_python.python_needed(f"{nested}\n(")
    assert time.process_time() - began_s < 1.0


def test_files_of_thousands_of_functions_are_read() -> None:
    """The parser accepts the files in linear time; the compiler would take quadratic time."""
    began_s = time.process_time()
    (facts,) = sources.read_sources(
        {"a.py": "def f():\n  pass\n  pass\n  pass\n  pass\n  pass\n" * 4_000}
    )
    assert len(facts.units) == 4_001
    assert time.process_time() - began_s < MOST_S


def test_each_pattern_of_the_rubric_is_bounded() -> None:
    """The lab's patterns stay within their budget, or say that they did not; one that is spent finds nothing more."""
    spec = next(check for check in read_rubric(None).checks() if check.id == "qos.honest")
    pattern = spec.parameters.model_dump()["pattern"]
    for line in ("1msg avg" * 40 + "1ms" * 40 + "max" * 180, "1 msgs avg 1 ms " * 60):
        began_s = time.process_time()
        with patterns_bounded():
            assert search(pattern, line[:1000]) is None
        assert time.process_time() - began_s < 5.0
    with patterns_bounded() as budget:
        assert search("a+b", "aab") is not None
        budget.left_s = 0.0
        assert search("a+b", "aab") is None
    assert Budget().exceeded is False


TEXTS = st.one_of(
    st.text(max_size=2000),
    st.lists(st.sampled_from(PIECES), max_size=200).map("".join),
    st.tuples(st.sampled_from(PIECES), st.integers(1, 500)).map(lambda pair: pair[0] * pair[1]),
)


@pytest.mark.parametrize("reader", READERS)
@settings(max_examples=examples(40), deadline=None)
@given(text=TEXTS)
def test_no_text_is_too_much(reader: str, text: str) -> None:
    """Whatever the text is, it is read in bounded time, and nothing is raised that the reader does not document."""
    began_s = time.process_time()
    READERS[reader](text)
    assert time.process_time() - began_s < MOST_S
