"""Values of keywords in a setup.py, by parsing alone."""

from __future__ import annotations

from typing import Any

import pytest

from grader.submission.packages.setup_script import NotRecognisedError, keyword_of_setup

CONSTANTS = "NAME: str = 'arm'\nNODES = ['talk', 'hear']\nTABLE = {'a': 'talk', 'b': 'hear'}\n"


def value(expression: str, before: str = CONSTANTS) -> Any:
    """Evaluate an expression that is given as a keyword of setup()."""
    return keyword_of_setup(f"{before}setup(wanted={expression})", "wanted")


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("TABLE", {"a": "talk", "b": "hear"}),
        ("[f'{n}={NAME}.{n}:main' for n in NODES]", None),
        ("dict(a=NODES + ['x'])", None),
        ("{'a': NODES + ['x']}", {"a": ["talk", "hear", "x"]}),
        ("('x', NAME + '/' + 'y')", ["x", "arm/y"]),
        ("sorted(NODES)", None),
        ("[n for n in NODES if n != 'talk']", None),
        ("open('x').read()", None),
        ("[n for n in read()]", None),
        ("f'{NAME!r}'", None),
        ("f'{NAME:>9}'", None),
        ("__import__('os').getcwd()", None),
        ("{**TABLE}", None),
        ("'a' + 1", None),
        ("{[]: 1}", None),
    ],
)
def test_values_are_recognised_or_not(expression: str, expected: Any) -> None:
    """Readable expressions get their value, and no value is invented for others."""
    if expected is None:
        with pytest.raises(NotRecognisedError):
            value(expression)
    else:
        assert value(expression) == expected


@pytest.mark.parametrize(
    "change",
    [
        *(
            "NODES.append('x')",
            "NODES += ['x']",
            "NODES = other",
            "for NODES in (): pass",
            "NODES[0] = 'x'",
        ),
        "def helper(NODES): pass",
    ],
)
def test_a_name_that_is_changed_is_not_known(change: str) -> None:
    """A list that grows after its literal does not count as the literal."""
    with pytest.raises(NotRecognisedError):
        value("NODES", f"{CONSTANTS}{change}\n")


def test_what_would_take_without_end_is_not_recognised() -> None:
    """A file made to do harm is given up early."""
    doubled = "a0 = 'x'\n" + "".join(f"a{n} = a{n - 1} + a{n - 1}\n" for n in range(1, 40))
    nested = "a0 = ['x']\n" + "".join(
        f"a{n} = [*a{n - 1}, a{n - 1}, a{n - 1}]\n" for n in range(1, 40)
    )
    for before in (doubled, nested, "a39 = a39 + a39\n"):
        with pytest.raises(NotRecognisedError):
            value("a39", before)
