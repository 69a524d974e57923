"""The attack corpus in `fixtures/attacks/`: attacks, their layout, and their permitted effects."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from grader.lab.rubric import Rubric

#: The one in C takes a tenth of the time, where there is one.
Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
ROOT = Path(__file__).parents[2]
CORPUS = ROOT / "fixtures" / "attacks"
SOLUTION = "reference/solution"
#: Prefix of the names under which files that an attack replaces lie beside its own.
HONEST = "honest_"
#: Prefix of an attack's output after it got something forbidden.
ESCAPED = "ESCAPED "


@dataclass(frozen=True)
class Expectation:
    """Verdict of a robust grader on an attack; see `fixtures/attacks/README.md`."""

    all: str | None = None
    checks: dict[str, str] = field(default_factory=dict)
    violation: str | None = None
    limit: str | None = None
    refused: bool = False
    either: tuple[str, ...] = ()
    left_out: str | None = None
    no_text: str | None = None
    no_output: str | None = None
    nothing_at: str | None = None


@dataclass(frozen=True)
class Attack:
    """One attack of the corpus.

    Attributes
    ----------
    files_of : tuple of str
        Folders with files to lay below the attack's own.
    twin : str
        The honest submission that it must not outscore: a fixture, or the solution.
    archive : str or None
        Suffix of the archive that is handed in in place of the folder.
    named : str or None
        Name of the folder, where it is not the attack's own.
    gaps : dict
        Isolation level -> first word of a known escape -> reason.
    """

    name: str
    folder: Path
    about: str
    part: str
    sessions: tuple[str, ...]
    files_of: tuple[str, ...]
    without: tuple[str, ...]
    twin: str
    archive: str | None
    named: str | None
    expect: Expectation
    gaps: dict[str, dict[str, str]]

    def most_points(self, rubric: Rubric) -> Decimal:
        """Return the most points that the honest twin earns in the attack's sessions."""
        checks = [c for c in rubric.checks() if c.session is None or c.session in self.sessions]
        if self.twin == SOLUTION:
            return sum((c.points for c in checks), Decimal(0))
        expected = yaml.safe_load(
            (ROOT / "fixtures" / self.twin / "expected.yaml").read_text(encoding="utf-8")
        )
        told: dict[str, dict[str, Any]] = {}
        for criterion in expected["criteria"].values():
            told |= criterion.get("checks") or {}
        return sum((_most_of(told.get(c.id), c.points) for c in checks), Decimal(0))


def _most_of(wanted: dict[str, Any] | None, points: Decimal) -> Decimal:
    if wanted is None:
        return points
    if wanted["outcome"] == "passed":
        return points
    if "earned" in wanted:
        return Decimal(str(wanted["earned"][1]))
    if wanted["outcome"] in ("failed", "not_reached"):
        return Decimal(0)
    return points


def read_attack(folder: Path) -> Attack:
    """Read an attack's `attack.yaml`; a key that does not exist is a mistake."""
    plain = yaml.load((folder / "attack.yaml").read_text(encoding="utf-8"), Loader)
    known = {
        "about",
        "part",
        "sessions",
        "with_files_of",
        "without",
        "twin",
        "archive",
        "named",
        "expect",
        "gaps",
    }
    assert set(plain) <= known, f"{folder.name}: {set(plain) - known}"
    expect = dict(plain.get("expect") or {})
    expect["either"] = tuple(expect.get("either", ()))
    files_of = plain.get("with_files_of", [SOLUTION])
    return Attack(
        folder.name,
        folder,
        plain["about"],
        plain["part"],
        tuple(plain["sessions"]),
        (files_of,) if isinstance(files_of, str) else tuple(files_of),
        tuple(plain.get("without", ())),
        plain.get("twin", SOLUTION),
        plain.get("archive"),
        plain.get("named"),
        Expectation(**expect),
        plain.get("gaps") or {},
    )


@cache
def read_corpus() -> tuple[Attack, ...]:
    """Read all attacks."""
    return tuple(read_attack(path.parent) for path in sorted(CORPUS.glob("*/attack.yaml")))


def lay_out(attack: Attack, parent: Path) -> Path:
    """Make the submission of an attack, in a folder of its own; returns its path."""
    folder = parent / attack.name / (attack.named or attack.name)
    own = {path.name for path in (attack.folder / "submission").glob("*")}
    for base in attack.files_of:
        shutil.copytree(
            ROOT / base, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in attack.without:
        (folder / name).unlink()
    for name in own & {path.name for path in folder.iterdir() if path.suffix == ".py"}:
        (folder / name).rename(folder / f"{HONEST}{name}")
    if own:
        shutil.copytree(attack.folder / "submission", folder, dirs_exist_ok=True)
    if attack.archive:
        archive = folder.parent / f"{attack.name}{attack.archive}"
    else:
        archive = None
    make = attack.folder / "make.py"
    if make.is_file():
        # In a process of its own, because `make.py` may need another working folder.
        arguments = [str(path) for path in (folder, archive) if path is not None]
        subprocess.run([sys.executable, "-I", str(make), *arguments], check=True, timeout=120)
    return archive or folder
