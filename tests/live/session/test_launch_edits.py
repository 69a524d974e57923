"""One edit mends a launch file, or none is made."""

from __future__ import annotations

import ast

import pytest

from grader.live.session.launch_edits import edit
from launch_plan.plan import Problem

HEAD = "from launch import LaunchDescription\nfrom launch_ros.actions import Node\n"
GOOD = (
    HEAD
    + """

def generate_launch_description():
    talker = Node(package='demo', executable='talker')
    return LaunchDescription([
        talker,
        Node(package='demo', executable='listener', remappings=[('a', 'b'), ('c', 'd')]),
    ])
"""
)


def broken(old: str, new: str) -> tuple[str, Problem]:
    """The good file with a fault, and the problem that Python finds in it."""
    assert old in GOOD
    text = GOOD.replace(old, new)
    try:
        ast.parse(text)
    except SyntaxError as error:
        return text, Problem("syntax_error", f"syntax error: {error.msg}", "x.py", error.lineno)
    raise AssertionError("the text has no fault")


@pytest.mark.parametrize(
    ("old", "new", "done"),
    [
        ("        talker,\n", "        talker\n", "a comma was added in line 8"),
        (
            "package='demo', executable='t",
            "package='demo' executable='t",
            "a comma was added in line 6",
        ),
        ("executable='talker')", "executable='talker'", "')' was added in line 6"),
        ("('c', 'd')]),", "('c', 'd')],", "')' was added in line 9"),
        ("    ])", "    ]", "')' was added in line 10"),
        ("    ])", "    )", "']' was added in line 9"),
        ("executable='talker')", "executable='talker'))", "')' was taken out of line 6"),
        ("description():", "description()", "':' was added in line 5"),
    ],
)
def test_a_sign_is_added_or_taken_out(old: str, new: str, done: str) -> None:
    """A missing comma, bracket or colon, and a bracket too many, is one edit."""
    text, problem = broken(old, new)
    mended = edit(text, problem)
    assert mended is not None
    assert mended.done == done
    assert ast.dump(ast.parse(mended.text)) == ast.dump(ast.parse(GOOD))


@pytest.mark.parametrize(
    ("old", "new", "kind", "message"),
    [
        ("    return LaunchDescription", "    LaunchDescription", "wrong_return", ""),
        ("    return LaunchDescription", "    ld = LaunchDescription", "wrong_return", ""),
        ("    ])\n", "    ]),\n", "wrong_return", ""),
        ("'talker')\n", "'talker'),\n", "not_an_action", ""),
        ("('a', 'b'), (", "('a', 'b') (", "exception", "TypeError: 'tuple' object is not callable"),
    ],
)
def test_a_return_and_a_comma_are_mended(old: str, new: str, kind: str, message: str) -> None:
    """The description is returned, and no call becomes a tuple."""
    assert old in GOOD
    lines = {"exception": 9}
    mended = edit(GOOD.replace(old, new), Problem(kind, message, "x.py", lines.get(kind, 4)))
    assert mended is not None
    good = ast.unparse(ast.parse(GOOD))
    assert (
        ast.unparse(ast.parse(mended.text))
        .replace("ld = ", "return ")
        .replace("\n    return ld", "")
        == good
    )


def test_a_name_is_imported_from_its_home() -> None:
    """The import of a name from a wrong module is moved, and a missing import is added."""
    remedy = "Import it from 'launch.substitutions'."
    message = "'launch.actions' has no 'LaunchConfiguration'"
    wrong = "from launch.actions import LogInfo, LaunchConfiguration\n"
    mended = edit(wrong, Problem("unknown_import", message, "x.py", 1, remedy))
    assert mended is not None
    expected = (
        "from launch.actions import LogInfo\nfrom launch.substitutions import LaunchConfiguration\n"
    )
    assert mended.text == expected
    remedy = "Import it: from launch.actions import LogInfo"
    problem = Problem("unknown_name", "name 'LogInfo' is not defined", "x.py", 5, remedy)
    mended = edit(GOOD, problem)
    assert mended is not None
    assert mended.text == GOOD.replace(HEAD, f"{HEAD}from launch.actions import LogInfo\n")


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("def f(:\n  )]x = = 3 4 (\n", "syntax_error"),
        ("type X = int\nx = [1 2]\n", "syntax_error"),
        ("x = (" * 300, "syntax_error"),
        ("x = [1 2]\n" * 50_000, "syntax_error"),
        (GOOD, "exception"),
        (GOOD, "wrong_return"),
        (GOOD, "endless"),
    ],
)
def test_other_files_stay_as_they_are(text: str, kind: str) -> None:
    """Several mistakes, syntax of a newer Python, absurd texts and other problems are not edited."""
    assert edit(text, Problem(kind, "ValueError: so", "x.py", 1)) is None
