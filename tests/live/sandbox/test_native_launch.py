"""The real launch is found in a sourced environment, without the modules of a submission."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from grader.live.sandbox.environment import find_native_launch
from grader.live.sandbox.installation import wheels_of
from tests.launch_plan.evaluations import ORIGINAL, needs_the_original

pytestmark = pytest.mark.live


@needs_the_original
def test_the_real_launch_is_found_without_the_modules_of_a_submission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A workspace that was built in the submission and sourced is on the path, and nothing of it is imported."""
    modules = tmp_path / "install/lib"
    modules.mkdir(parents=True)
    mark = tmp_path / "mark"
    for name in ("launch", "json", "typing", "yaml"):
        (modules / f"{name}.py").write_text(f"open({str(mark)!r}, 'w')\n", encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", f"{modules}:{ORIGINAL}")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}/install:{ORIGINAL / 'prefix'}")
    found = find_native_launch(wheels_of(Path(sys.executable)), "native", [tmp_path])
    assert found is not None
    assert not mark.exists()
    assert str(modules) not in found.python_path
    assert found.prefixes == [str(ORIGINAL / "prefix")]
