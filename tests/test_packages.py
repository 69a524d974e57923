"""Rules that hold for the modules of all packages."""

from __future__ import annotations

import ast

from tests.packages import ROOT, modules


def test_only_one_module_sets_limits() -> None:
    """No other module of the wheel's packages asks the kernel for a limit by itself."""
    found = set()
    for file in modules():
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute) and node.attr in ("setrlimit", "prlimit"):
                found.add(file.relative_to(ROOT).as_posix())
    assert found == {"confine/limits.py"}
