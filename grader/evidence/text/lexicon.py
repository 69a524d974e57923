"""The vocabularies of `lexicon.yaml`."""

from __future__ import annotations

import functools
from pathlib import Path

import yaml


@functools.cache
def _lexicon() -> dict[str, list[str]]:
    lexicon: dict[str, list[str]] = yaml.load(Path(__file__).with_suffix(".yaml").read_bytes(), yaml.CSafeLoader)
    return lexicon


def one_of(name: str) -> str:
    """Return a regular expression that matches any entry of a vocabulary."""
    return f"(?:{'|'.join(_lexicon()[name])})"
