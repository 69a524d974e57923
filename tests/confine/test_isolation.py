"""Command lines of confined programs, their user ids, and the remedies where little can be confined."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from confine.command import confined
from confine.isolation import (
    CONFINED_UIDS,
    ConfinementError,
    Isolation,
    Level,
    first_confined_uid,
)
from confine.landlock import confines_signals, landlock_version
from confine.namespaces import Form
from confine.probing import probe_isolation
from confine.room import Room

pytestmark = pytest.mark.live

PYTHON = Path(sys.executable)


def test_a_level_that_is_required_and_missing_is_an_error() -> None:
    """The error names both levels and the remedy; equal or better levels pass."""
    reduced = Isolation(Level.REDUCED, remedy="Install bubblewrap.")
    with pytest.raises(ConfinementError, match="'reduced' only, and 'no cgroup' is") as caught:
        reduced.require(Level.NO_CGROUP)
    assert caught.value.remedy == "Install bubblewrap."
    reduced.require(Level.REDUCED)
    reduced.require(Level.NONE)


def test_variables_of_a_command_reach_no_program_with_privileges(tmp_path: Path) -> None:
    """The program that gives up privileges has a fixed environment; the command's begins after it."""
    variables = {"LD_PRELOAD": "/ws/theirs.so", "PATH": "/ws/theirs"}
    for form in (Form.ROOT, Form.USER):
        with confined(
            Isolation(
                Level.NO_CGROUP, form, first_uid=first_confined_uid() if form is Form.ROOT else None
            ),
            ["node", "--talk"],
            environment=variables,
            room=Room({"/ws": tmp_path}, {}, PYTHON, covered=()),
            slot=1,
            cwd="/ws",
            group=None,
        ) as (argv, _, info):
            assert info is not None
            os.close(info)
        begins = argv.index("env")
        assert not [word for word in argv[:begins] if "theirs" in word]
        assert argv[begins:] == [
            "env",
            "-i",
            "--",
            "LD_PRELOAD=/ws/theirs.so",
            "PATH=/ws/theirs",
            "node",
            "--talk",
        ]
        assert "setpriv" not in argv[begins:]


@pytest.fixture
def _no_bubblewrap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no bubblewrap be found, so that there are no namespaces."""
    (tmp_path / "bin").mkdir()
    for name in ("unshare", "setpriv", "prlimit", "env", "sh"):
        found = shutil.which(name)
        assert found is not None
        (tmp_path / "bin" / name).symlink_to(found)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives others user ids")
@pytest.mark.skipif(landlock_version() < 1, reason="this kernel has no Landlock")
@pytest.mark.usefixtures("_no_bubblewrap")
def test_code_that_would_run_as_root_is_reported_or_refused(tmp_path: Path) -> None:
    """If other users may not run the interpreter, the remedy names the folder to open, and the gap is listed."""
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o700)
    (closed / "python").symlink_to(PYTHON)
    found = probe_isolation(closed / "python")
    confined = confines_signals()
    assert (found.level, found.own_uid) == (Level.REDUCED if confined else Level.NONE, False)
    assert not confined or any("runs as root" in lack for lack in found.describe()["lacks"])
    shut = next(p for p in reversed((closed / "python").parents) if not p.stat().st_mode & 0o001)
    assert "Install bubblewrap" in found.remedy
    assert f"chmod o+x {shut})" in found.remedy


def first_uid_in(namespaces: list[str]) -> int:
    """Return the first user id of sandboxes in new namespaces."""
    program = "from confine.isolation import first_confined_uid; print(first_confined_uid())"
    paths = os.pathsep.join(path for path in sys.path if path)
    said = subprocess.run(
        ["unshare", *namespaces, sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    return int(said.stdout)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives others user ids")
def test_sandboxes_in_two_networks_have_different_user_ids() -> None:
    """The kernel counts processes by user id, separately for the user namespace of a container."""
    many, few = CONFINED_UIDS
    here, elsewhere = first_confined_uid(), first_uid_in(["--net"])
    assert first_confined_uid() == here
    if here in many:
        assert elsewhere in many
        assert abs(here - elsewhere) > 101
    assert first_uid_in(["--net", "--user", "--map-root-user"]) == few[0]
