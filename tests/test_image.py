"""The image: two sizes from one file, an ordinary user, and a bill of its Python packages."""

from __future__ import annotations

import json
import re
import subprocess

import pytest
from packaging.utils import canonicalize_name

from tests.packages import ROOT
from tests.test_constraints import NO_ANSWER
from tests.test_lock import locked

#: Packages of the system for packages in C and C++ and for own interfaces.
COMPILERS = {"cmake", "g++", "gcc", "libc6-dev", "make", "python3-dev"}


def stages() -> dict[str, str]:
    """Return the instructions of each stage of the Dockerfile, by its name."""
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    parts = re.split(r"^FROM (\S+) AS (\w+)\n", text, flags=re.MULTILINE)[1:]
    return dict(zip(parts[1::3], parts[2::3], strict=True))


def installed(stage: str) -> set[str]:
    """Return the packages of the system that a stage installs."""
    lines = re.findall(r"--no-install-recommends ([^&]+)", stages()[stage])
    return set(" ".join(lines).split())


def test_compilers_are_in_the_full_image_alone() -> None:
    """The slim image has no compiler; the full one is the slim one with compilers, and the default."""
    assert list(stages()) == ["build", "slim", "full"]
    assert installed("full") >= COMPILERS
    assert not installed("slim") & COMPILERS
    assert "FROM slim AS full\n" in (ROOT / "Dockerfile").read_text(encoding="utf-8")


def test_the_full_image_has_what_a_machine_gets() -> None:
    """The packages that `tools/install-system-packages` installs for grading are in the full image."""
    script = (ROOT / "tools/install-system-packages").read_text(encoding="utf-8")
    grading = script.partition('if [ "${1:-}" = dev ]')[0]
    wanted = set()
    for line in re.findall(r'missing="\$missing ([^"]+)"', grading):
        wanted |= set(line.split())
    assert len(wanted) > 6
    assert wanted <= installed("slim") | installed("full")


@pytest.mark.parametrize("stage", ["slim", "full"])
def test_nothing_runs_as_root(stage: str) -> None:
    """Each image ends as an ordinary user, and keeps no lists and archives of packages."""
    text = stages()[stage]
    assert re.findall(r"^USER (\w+)$", text, re.MULTILINE)[-1] == "grader"
    updates = text.count("apt-get update")
    assert updates == text.count("rm -rf /var/lib/apt/lists/* /var/cache/apt/*")


def test_health_is_examined() -> None:
    """`grade doctor` tells an engine whether a container can grade."""
    assert re.search(r'^HEALTHCHECK .* CMD \["grade", "doctor"\]$', stages()["slim"], re.MULTILINE)


@pytest.mark.slow
def test_the_bill_names_each_locked_package() -> None:
    """`make sbom` lists each package of the lock with its version."""
    # The environment of this test is complete: make must not install into it.
    command = ["make", "--assume-old=.venv/.installed-dev", "sbom"]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False
    )
    if any(words in done.stderr for words in NO_ANSWER):
        pytest.skip("the package registry does not answer")
    assert done.returncode == 0, done.stderr
    bill = json.loads((ROOT / "build/sbom.json").read_text(encoding="utf-8"))
    listed: dict[str, str] = {}
    for component in bill["components"]:
        purl = re.fullmatch(r"pkg:pypi/([^@]+)@(.+)", component["purl"])
        assert purl
        listed[canonicalize_name(purl[1])] = purl[2]
    assert bill["bomFormat"] == "CycloneDX"
    for name, (version, _) in locked().items():
        assert listed.get(name) == version
