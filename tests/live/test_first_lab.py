"""The tutorial "Your first lab": its commands are run, its files written, and its outputs compared, as they stand."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.documentation import ROOT, Block, blocks

pytestmark = pytest.mark.live

PAGE = ROOT / "docs/first-lab.md"
APPENDED = "at the end of "


def is_shown(output: str, shown: str) -> bool:
    """Say if an output matches the page; `…` there stands for anything, and blanks for blanks."""
    pattern = ".*?".join(map(re.escape, " ".join(shown.split()).split("…")))
    return re.fullmatch(pattern, " ".join(output.split())) is not None


def test_what_is_not_shown_is_noticed() -> None:
    """The test below can fail."""
    assert is_shown("A  lab:\n 3.2 s\n", "A lab: … s")
    assert not is_shown("A lab: 3.2 s, failed", "A lab: … s")


def run(block: Block, folder: Path) -> str:
    """Run a block like a reader, and give its output. Only `grade` may find something wrong."""
    there = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "COLUMNS": "100",
    }
    done = subprocess.run(
        ["bash", "-c", block.text],
        cwd=folder,
        env=there,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert done.returncode == 0 or block.text.splitlines()[-1].startswith("grade "), done.stdout
    return done.stdout


def write(block: Block, folder: Path) -> None:
    """Write the file that a block is, or put it where its title says."""
    file = folder / block.title.removeprefix(APPENDED)
    assert file.exists() == block.title.startswith(APPENDED), file
    file.parent.mkdir(exist_ok=True)
    with file.open("a", encoding="utf-8") as opened:
        opened.write(block.text)


def follow(steps: list[Block], folder: Path) -> None:
    """Run and write each block in its turn; fails if an output is not the one on the page."""
    output = ""
    for block in steps:
        if block.language == "text":
            assert is_shown(output, block.text), output
        elif block.language == "bash":
            output = run(block, folder)
        else:
            write(block, folder)


def test_the_tutorial_works_as_it_is_written(tmp_path: Path) -> None:
    """Each block in its turn; a block of text is the output of the commands before it."""
    listed = blocks(PAGE)
    steps = [block for block in listed if block.language in ("bash", "text") or block.title]
    assert [block.language for block in steps].count("text") >= 4
    follow(steps, tmp_path)
    quoted = [block for block in listed if block.language == "yaml" and not block.title]
    rubric = (tmp_path / "my-lab/rubric.yaml").read_text(encoding="utf-8")
    assert [block.text for block in quoted if block.text not in rubric] == []
