"""Values of expressions in a setup.py, by parsing alone."""

from __future__ import annotations

import ast
from typing import Any

import pytest

from grader.setup_script import UNREADABLE, SetupScript, keyword_of_setup

PATHS = ["setup.py", "arm/__init__.py", "arm/talk.py", "arm/hear.py"]
CONSTANTS = "NAME: str = 'arm'\nNODES = ['talk', 'hear']\nTABLE = {'a': 'talk', 'b': 'hear'}\n"


def value(expression: str, before: str = CONSTANTS) -> Any:
    """Evaluate an expression that is given as a keyword of setup()."""
    tree = ast.parse(f"{before}setup(wanted={expression})")
    given = keyword_of_setup(tree, "wanted")
    assert given is not None
    return SetupScript(tree, PATHS).value(given)


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("[f'{n}={NAME}.{n}:main' for n in NODES]", ["talk=arm.talk:main", "hear=arm.hear:main"]),
        ("[k + '=' + v for k, v in TABLE.items()]", ["a=talk", "b=hear"]),
        ("['%s=%s' % (a, b) for a, b in zip(NODES, TABLE.keys())]", ["talk=a", "hear=b"]),
        ("[n for n in NODES if n != 'talk' and not n.startswith('x')]", ["hear"]),
        ("[p.removesuffix('.py') for p in glob('arm/*.py') if '__init__' not in p]", ["arm/talk", "arm/hear"]),
        ("[a + b for a in 'xy' for b in NODES[:0] or ['1']]", UNREADABLE),
        ("[a + b for a in ['x', 'y'] for b in [] or ['1']]", ["x1", "y1"]),
        ("{n: NODES[0] for n in NODES}", {"talk": "talk", "hear": "talk"}),
        ("','.join(sorted(NODES))", "hear,talk"),
        ("'yes' if NAME == 'arm' else 'no'", "yes"),
        ("[os.path.splitext(os.path.basename(p))[0] for p in glob('arm/[th]*')]", ["talk", "hear"]),
        ("NODES[-1]", "hear"),
        ("[str(i) for i, _ in enumerate(NODES)]", ["", ""]),
        ("open('x').read()", UNREADABLE),
        ("[n for n in read()]", UNREADABLE),
        ("f'{NAME!r}'", UNREADABLE),
        ("f'{NAME:>9}'", UNREADABLE),
        ("__import__('os').getcwd()", UNREADABLE),
        ("{**TABLE}", UNREADABLE),
    ],
)
def test_expressions_are_evaluated_or_not_understood(expression: str, expected: Any) -> None:
    """What can be told by reading is told rightly, and nothing is made up."""
    if expected is UNREADABLE:
        with pytest.raises(UNREADABLE):
            value(expression)
    else:
        assert value(expression) == expected


@pytest.mark.parametrize(
    "change", ["NODES.append('x')", "NODES += ['x']", "NODES = other", "for NODES in (): pass", "NODES.insert(0, 'x')"]
)
def test_a_name_that_is_changed_is_not_known(change: str) -> None:
    """A list that grows after its literal does not count as the literal."""
    with pytest.raises(UNREADABLE):
        value("NODES", f"{CONSTANTS}{change}\n")


def test_names_within_functions_are_not_those_of_the_file() -> None:
    """A local variable changes nothing outside."""
    assert value("NAME", CONSTANTS + "def helper():\n    NAME = 'x'\n    NODES.append(NAME)\n") == "arm"


@pytest.mark.parametrize(
    "expression",
    [
        "[a + b + c + d for a in L for b in L for c in L for d in L]",
        "S.replace('a', S).replace('a', S).replace('a', S)",
        "S.join([S] * 3)",
        "S.join(list(S)).join(list(S))",
    ],
)
def test_what_would_take_without_end_is_not_understood(expression: str) -> None:
    """A file made to do harm is given up early."""
    before = f"L = {['x' * 50] * 50}\nS = {'a' * 5000!r}\n"
    with pytest.raises(UNREADABLE):
        value(expression, before)
