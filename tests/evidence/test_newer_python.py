"""Newer syntax told from mistakes, held against another parser of all versions."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.newer_python import python_needed

NEWER = [
    "type Wave = tuple[float, float]\nx: Wave = (1, 2)\n",
    "type Pair[T] = tuple[T, T]\n",
    "def first[T](items: list[T]) -> T:\n    return items[0]\n",
    "def most[T: (int, float), *Ts, **P](*items): ...\n",
    "class Buffer[T]:\n    def get(self):\n        return 1\n",
    "d = {'a': 1}\nprint(f'{d['a']}')\n",
    'd = {"a": 1}\nprint(f"x {d["a"]:.2f} y", f"{", ".join(["a", "b"])}")\n',
    'print(f"{f"{1}"}")\n',
    'print(f"{\n    1\n}")\n',
    "print(f'{'a' 'b'}')\n",
    "print(f'{\"\\n\".join(a)}')\n",
    "print(f'{x # a comment\n}')\n",
    "print(f'{x:{'a'}}')\n",
    'print(f"{d["a"]!r:>{w}}")\n',
    "print(f'{d['a'] = }')\n",
    "print(f'{(lambda: d['a'])()}')\n",
    "print(f'{{{d['a']}}}', rf'\\{d['a']}', f'\\N{BULLET}{d['a']}')\n",
    'print(f"""{"""a"""}""")\n',
    "async def g():\n    return f'{await h('x')}'\n",
    "x = f'{d['a']}' f'{y}' 'z'\n",
    "print(f'{*a, 'x'}')\n",
    "print(f'{1, *d['a']}')\n",
]
#: Texts with the syntax of one later Python.
NEWEST = {
    "def first[T = int](x: T): ...\n": "3.13",
    "def f[*Ts = *tuple[int, ...]](x: int): ...\n": "3.13",
    "class A[T, **P = [int, str]]: ...\n": "3.13",
    "try:\n    pass\nexcept A, B:\n    pass\n": "3.14",
    "try:\n    pass\nexcept m.A, (B, C), f(x):  # all\n    pass\nelse:\n    pass\n": "3.14",
    "try:\n    pass\nexcept A,:\n    pass\n": "3.14",
    "try:\n    pass\nexcept A, B,:\n    pass\n": "3.14",
    "try:\n    pass\nexcept* A, B:\n    pass\n": "3.14",
    "try:\n    type X = int\nexcept A, B:\n    try: print(f'{d['a']}')\n    except C, D: pass\n": "3.14",
    "x = t'a {d['b']}' t'{c!r:>3}'\n": "3.14",
    "print(f'{t'{a}'}')\n": "3.14",
}
#: Mistakes in every version; the same field without its mistake would be newer in many.
BROKEN = [
    "x = (1\n",
    "def f(:\n    pass\n",
    "type = = 3\n",
    "type X = (\n",
    "type X.y = 3\n",
    "class A[T:\n",
    "class A[1]: pass\n",
    "def f[](x): pass\n",
    "print 'x'\n",
    "print f'{d['a']}'\n",
    "print(f'{x'\n",
    "print(f'{x')\n",
    "print(f'{d['a']')\n",
    "print(f'{d[\"a\"]')\n",
    "print(f'{d['a']}\n",
    "print(f'{d['a']}}')\n",
    "print(f'}{d['a']}')\n",
    "print(f'{}{d['a']}')\n",
    "print(f'{ }')\n",
    "print(f'{!r}{d['a']}')\n",
    "print(f'{x!}{d['a']}')\n",
    "print(f'{d['a']!z}')\n",
    "print(f'{x:{y!z}}{d['a']}')\n",
    "print(f'{x y}{d['a']}')\n",
    "print(f'{d['a'] +}')\n",
    "print(f'{d['a'] if}')\n",
    "print(f'{d['a'}]')\n",
    "print(f'{x for x in d['a']}')\n",
    "print(f'{lambda: d['a']}')\n",
    "print(f'{return d['a']}')\n",
    "print(f'{import os}')\n",
    "print(f'{0777 + d['a']}')\n",
    "print(f'{d['a']:\n}')\n",
    "print(f'{d['a']:{}}')\n",
    "print(f'{f'{1'}'}')\n",
    "print(f'{d[\\'a\\']}')\n",
    "f'{d['a']}' = 3\n",
    "for x in range(3) print(f'{d['a']}')\n",
    "if x = f'{d['a']}': pass\n",
    "try:\n    pass\nexcept A, B as e:\n    pass\n",
    "try:\n    pass\nexcept A B:\n    pass\n",
    "try:\n    pass\nexcept , A:\n    pass\n",
    "try:\n    pass\nexcept A,, B:\n    pass\n",
    "try:\n    pass\nexcept *A, *B:\n    pass\n",
    "try:\n    pass\nexcept A, B\n    pass\n",
    "try:\n    pass\nexcept A, b = 1:\n    pass\n",
    "try:\n    pass\nexcept A, B:\npass\n",
    "x = t'{a}' 'b'\n",
    "class A[*Ts: int]: pass\n",
    "class A[T = int, U]: pass\n",
]
OLD = ["x = 1\n", "print(f'{1 + 1:.2f}', f\"{'a'}\")\n", 'print(f"""{"a"}""")\n', "type = 3\n"]


@pytest.mark.parametrize("text", NEWER)
def test_newer_syntax_is_recognised(text: str) -> None:
    """Aliases, type parameters and f-strings with free fields are correct since Python 3.12."""
    assert python_needed(text) == "3.12"


@pytest.mark.parametrize(("text", "needed"), NEWEST.items())
def test_the_python_that_is_needed_is_named(text: str, needed: str) -> None:
    """The newest construct of a text decides, also inside another and after an older one."""
    assert python_needed(text) == needed
    assert python_needed(NEWER[0] + text) == needed
    assert python_needed(text + BROKEN[0]) == ""


@pytest.mark.parametrize("text", BROKEN)
def test_a_mistake_in_every_version_stays_one(text: str) -> None:
    """An error is its author's, also beside newer syntax, and inside it."""
    assert python_needed(text) == ""
    assert python_needed(NEWER[0] + text) == ""


def test_a_star_alone_in_a_field_is_a_mistake() -> None:
    """The compiler refuses it, although a parser accepts it."""
    assert python_needed("print(f'{*d['a']}')\n") == ""


@pytest.mark.parametrize("text", OLD)
def test_what_was_always_correct_is_not_newer(text: str) -> None:
    """A text without newer syntax is none, and an error at run time is not excused."""
    assert python_needed(text) == ""


@pytest.mark.parametrize("version", ["3.12", "3.13", "3.14"])
def test_another_parser_agrees(version: str, tmp_path: Path) -> None:
    """Ruff's parser knows each version's syntax: it accepts newer texts, and refuses broken ones."""
    # Ruff accepts some of the defaults for every version.
    later = [text for text, needed in NEWEST.items() if needed == "3.14" > version]
    reached = [text for text, needed in NEWEST.items() if needed <= version]
    accepted = [*NEWER, *OLD, *reached]
    for n, text in enumerate((*accepted, *BROKEN, *later)):
        (tmp_path / f"t{n:03}.py").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "ruff", "check", "--isolated", "--no-cache", "--select=E9"]
    command += [f"--target-version=py{version.replace('.', '')}", "--output-format=json"]
    command.append(str(tmp_path))
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    refused = {Path(each["filename"]).stem for each in json.loads(done.stdout)}
    wrong = range(len(accepted), len(accepted) + len(BROKEN) + len(later))
    assert refused == {f"t{n:03}" for n in wrong}


@pytest.mark.skipif(sys.version_info >= (3, 12), reason="this Python accepts the newer syntax")
@pytest.mark.parametrize("text", NEWER)
def test_this_python_refuses_the_newer_ones(text: str) -> None:
    """The table of newer texts holds nothing that the interpreter of the tests can read."""
    with pytest.raises(SyntaxError):
        ast.parse(text)


@given(st.text(alphabet="f{}\"'x\\\n[]( :!=", max_size=60))
def test_no_text_breaks_it(text: str) -> None:
    """Any text has an answer."""
    assert python_needed(text) in ("", "3.12", "3.13", "3.14")


LONG = [
    "x = f'{a" + " " * 99_000 + "!'\n",
    "f'{'" * 20_000,
    "f'{" * 40_000,
    "f'{d['a']:" * 5_000 + "}'" * 5_000,
    "f'{" + "-" * 50_000 + "d['a']}'\n",
    "x = f'{d['a']}'\n" * 8_000,
    "<!--" * 15_000,
]


@pytest.mark.parametrize("text", LONG, ids=[text[:12] for text in LONG])
def test_a_long_text_is_read_in_bounded_time(text: str) -> None:
    """Nested, unfinished and very many fields take seconds of a slow machine at most."""
    began_s = time.process_time()
    python_needed(text)
    assert time.process_time() - began_s < 15.0
