"""`grade checks`: list the checks that a rubric can use."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from rich.console import Console


def run(arguments: Sequence[str], console: Console) -> int:
    """List the checks; returns the exit status."""
    from grader.checks import REGISTRY

    argparse.ArgumentParser(prog="grade checks", description="List the checks that a rubric can use.").parse_args(
        arguments
    )
    for name, check in REGISTRY.items():
        console.print(f"[bold]{name}[/]: {' '.join((check.parameters.__doc__ or '').split())}")
        for key, field in check.parameters.model_fields.items():
            kind = getattr(field.annotation, "__name__", str(field.annotation)).replace("typing.", "")
            need = "required" if field.is_required() else f"default {field.get_default(call_default_factory=True)!r}"
            console.print(f"    {key}: {kind}, {need}. {field.description or ''}".rstrip(), markup=False)
    return 0
