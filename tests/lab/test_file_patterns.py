"""Patterns of files, compared with Python's own glob."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.errors import RubricError
from grader.judging.rubrics import read_rubric
from grader.lab.file_patterns import matches, mistake_in

CASES = [
    ("x.py", "x.py", True),
    ("x.py", "a/x.py", False),
    ("**/x.py", "x.py", True),
    ("**/x.py", "a/b/x.py", True),
    ("**/pkg/x.py", "pkg/x.py", True),
    ("**/pkg/x.py", "ws/src/pkg/x.py", True),
    ("**/pkg/x.py", "ws/pkg/y/x.py", False),
    ("**/pkg/**/x.py", "ws/pkg/y/z/x.py", True),
    ("**/pkg/**/x.py", "ws/pkg/x.py", True),
    ("src/*.py", "src/x.py", True),
    ("src/*.py", "src/a/x.py", False),
    ("*/x.py", "a/x.py", True),
    ("*/x.py", "x.py", False),
    ("src/**", "src/a/x.py", True),
    ("**/*launch.py", "a/b_launch.py", True),
    ("**/X.py", "x.py", False),
    ("**/x[12].py", "a/x2.py", True),
    ("**/x?.py", "a/x2.py", True),
]


@pytest.mark.parametrize(("pattern", "path", "is_match"), CASES)
def test_a_pattern_matches_as_written(pattern: str, path: str, is_match: bool) -> None:
    """A star stays within a name, and two stars are any folders."""
    assert matches(pattern, PurePosixPath(path)) is is_match


def test_globs_of_python_find_the_same(tmp_path: Path) -> None:
    """Every pattern finds the same files in a real folder as `Path.glob`."""
    names = sorted({path for _, path, _ in CASES})
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    for pattern in sorted({pattern for pattern, _, _ in CASES if not pattern.endswith("**")}):
        found = {str(path.relative_to(tmp_path)) for path in tmp_path.glob(pattern)}
        assert found == {name for name in names if matches(pattern, PurePosixPath(name))}, pattern


@given(st.text(alphabet="a*?[]/.", max_size=20), st.text(alphabet="ab./", min_size=1, max_size=20))
def test_any_pattern_has_an_answer(pattern: str, path: str) -> None:
    """No pattern raises an exception."""
    assert matches(pattern, PurePosixPath(path)) in (True, False)
    assert isinstance(mistake_in(pattern), str)


RUBRIC = """\
lab: {id: x, title: X, points: 1}
artifacts:
  it:
    file: it.py
    find:
      - it.py
      - PATTERN
criteria:
  - {id: a, title: A, points: 1, checks: [{id: b, points: 1, by: person}]}
"""


@pytest.mark.parametrize(
    "pattern",
    ["/it.py", "./it.py", "../it.py", "src//it.py", "src/", "'src\\it.py'", "''", "C:/it.py"],
)
def test_a_pattern_that_matches_nothing_is_a_mistake_of_the_rubric(
    pattern: str, tmp_path: Path
) -> None:
    """A pattern without a match is reported with its line, as by `grade lab check`."""
    (tmp_path / "rubric.yaml").write_text(RUBRIC.replace("PATTERN", pattern))
    with pytest.raises(RubricError) as caught:
        read_rubric(tmp_path / "rubric.yaml")
    (mistake,) = caught.value.mistakes
    assert "match" in mistake
    assert mistake.startswith("rubric.yaml:7:"), mistake


@pytest.mark.parametrize("pattern", ["/it.py", "it.py/"])
def test_a_file_name_that_matches_nothing_is_a_mistake_too(pattern: str, tmp_path: Path) -> None:
    """The name of an artifact's file is its first pattern."""
    text = RUBRIC.replace("file: it.py", f"file: {pattern}").replace("      - PATTERN\n", "")
    (tmp_path / "rubric.yaml").write_text(text)
    with pytest.raises(RubricError) as caught:
        read_rubric(tmp_path / "rubric.yaml")
    assert any(m.startswith("rubric.yaml:4:") for m in caught.value.mistakes), caught.value.mistakes
