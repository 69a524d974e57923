"""Where in a launch file something stands, read off its text."""

from __future__ import annotations

import ast

from grader.python_source import parse_python


def parameter_line(text: str, node_line: int | None, parameter: str) -> int | None:
    """Find the line of a Python launch file that gives a node a parameter.

    Parameters
    ----------
    text : str
        The launch file.
    node_line : int or None
        The line on which the node is made, counted from 1.
    parameter : str
        Name of the parameter.

    Returns
    -------
    int or None
        The parameter's line; else that of the node's `parameters`; else the node's own.
    """
    try:
        tree = parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return node_line
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and node_line is not None]
    around = [call for call in calls if call.lineno <= (node_line or 0) <= (call.end_lineno or call.lineno)]
    given = [keyword.value for call in around for keyword in call.keywords if keyword.arg == "parameters"]
    if not given:
        return node_line
    keys = [key for part in ast.walk(given[-1]) if isinstance(part, ast.Dict) for key in part.keys]
    found = [key.lineno for key in keys if isinstance(key, ast.Constant) and key.value == parameter]
    return found[0] if found else given[-1].lineno
