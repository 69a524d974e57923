"""What would run on a student's machine and does not where it is graded."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.diagnosis import Diagnosis
from grader.evidence.elsewhere import is_newer_python, only_elsewhere

NEWER = [
    "type Wave = tuple[float, float]\nx: Wave = (1, 2)\n",
    "type Pair[T] = tuple[T, T]\n",
    "def first[T](items: list[T]) -> T:\n    return items[0]\n",
    "class Buffer[T]:\n    def get(self):\n        return 1\n",
    "d = {'a': 1}\nprint(f'{d['a']}')\n",
    'd = {"a": 1}\nprint(f"x {d["a"]:.2f} y", f"{", ".join(["a", "b"])}")\n',
    'print(f"{f"{1}"}")\n',
    'print(f"{\n    1\n}")\n',
]
BROKEN = [
    "x = (1\n",
    "print(f'{d['a']')\n",
    "def f(:\n    pass\n",
    "print(f'{x'\n",
    "type = = 3\n",
    "type X = (\n",
    "class A[T:\n",
]


@pytest.mark.parametrize("text", NEWER)
def test_newer_syntax_is_recognised(text: str) -> None:
    """Aliases, type parameters and f-strings with their own quotation marks are right since Python 3.12."""
    assert is_newer_python(text)


@pytest.mark.parametrize("text", BROKEN)
def test_what_no_python_reads_is_a_mistake(text: str) -> None:
    """An error stays one, also beside newer syntax."""
    assert not is_newer_python(text)
    assert not is_newer_python(NEWER[0] + text)


@pytest.mark.parametrize(
    "text", ["x = 1\n", "print(f'{1 + 1:.2f}', f\"{'a'}\")\n", 'print(f"""{"a"}""")\n', "type = 3\n"]
)
def test_what_was_always_right_is_not_newer(text: str) -> None:
    """A text without newer syntax is none, so that an error at run time is not excused."""
    assert not is_newer_python(text)


@given(st.text(alphabet="f{}\"'x\\\n[]( :!=", max_size=60))
def test_no_text_breaks_it(text: str) -> None:
    """Whatever it is, there is an answer."""
    assert is_newer_python(text) in (True, False)


def test_a_field_without_end_is_given_up() -> None:
    """An f-string's field that goes on for a hundred thousand spaces is not searched for its conversion."""
    assert not is_newer_python("x = f'{a" + " " * 99_000 + "!'\n")


def test_a_library_that_is_missing_is_for_a_person_to_decide() -> None:
    """A well-known library is told, a name that nobody knows is none."""
    known = only_elsewhere(Diagnosis("missing-module", "", "", subject="matplotlib.pyplot"), {})
    assert known is not None
    assert "needs matplotlib" in known
    assert only_elsewhere(Diagnosis("missing-interface", "", "", subject="control_msgs.msg"), {}) is not None
    assert only_elsewhere(Diagnosis("missing-module", "", "", subject="my_lab_trajectories"), {}) is None
    assert only_elsewhere(Diagnosis("exception", "", "", subject="matplotlib"), {}) is None
    assert only_elsewhere(None, {}) is None


def test_a_file_in_newer_syntax_is_for_a_person_to_decide() -> None:
    """The file and its line are named; a mistake is no newer syntax."""
    found = Diagnosis("syntax-error", "", "", file="it.py", line=1)
    told = only_elsewhere(found, {"it.py": NEWER[0]})
    assert told is not None
    assert told.startswith("it.py (line 1) is written in Python 3.12")
    assert only_elsewhere(found, {"it.py": BROKEN[0]}) is None
    assert only_elsewhere(found, {}) is None
