"""Everything that docs/stability.md promises is still there, as the kept files of the first version say."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.stable.interfaces import INTERFACES, kept_file

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", INTERFACES)
def test_nothing_promised_is_gone_or_changed(name: str) -> None:
    """Each kept fact is a fact of this version; new ones are allowed."""
    kept = kept_file(name).read_text(encoding="utf-8").splitlines()
    assert len(kept) > 5
    assert sorted(set(kept) - set(INTERFACES[name]())) == []


def test_the_policy_names_each_interface() -> None:
    """The page has a row for each kept file."""
    page = (ROOT / "docs/stability.md").read_text(encoding="utf-8")
    for name in INTERFACES:
        assert f"tests/stable/{name}.txt" in page
