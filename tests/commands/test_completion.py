"""Completion in real shells, and the manual page."""

from __future__ import annotations

import os
import pty
import select
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from grader.cli import main
from grader.commands import COMMANDS
from grader.commands.completion import completion_for

ROOT = Path(__file__).resolve().parents[2]
#: Silence of a terminal after which nothing more is expected from it, in s.
SILENT_S = 30.0
#: For bash: completes the words of `COMP_LINE`, and prints the candidates.
IN_BASH = """\
source {script}
COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); COMP_LINE="${{COMP_WORDS[*]}}"; COMP_POINT=${{#COMP_LINE}}
{function}
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


def needs(shell: str) -> pytest.MarkDecorator:
    """Skip a test without a shell; `tools/install-system-packages dev` installs it."""
    return pytest.mark.skipif(shutil.which(shell) is None, reason=f"{shell} is not installed")


def in_bash(words: str, folder: Path) -> set[str]:
    """Return the candidates of bash for words; an empty last word is ''."""
    script = folder / "grade.bash"
    script.write_text(completion_for("bash"), encoding="utf-8")
    program = IN_BASH.format(script=script, words=words, function="_shtab_grade")
    done = subprocess.run(
        ["bash", "--norc", "-c", program], capture_output=True, text=True, cwd=folder, check=False
    )
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


def in_fish(line: str, folder: Path) -> set[str]:
    """Return the candidates of fish for a line."""
    script = folder / "grade.fish"
    script.write_text(completion_for("fish"), encoding="utf-8")
    program = f"source {script}; complete -C '{line}'"
    done = subprocess.run(
        ["fish", "--no-config", "-c", program],
        capture_output=True,
        text=True,
        cwd=folder,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return {candidate.split("\t")[0] for candidate in done.stdout.splitlines()}


def in_zsh(line: str, wanted: str, folder: Path) -> str:
    """Type a line and two tabs in an interactive zsh; return the screen as soon as it has a text."""
    (folder / "_grade").write_text(completion_for("zsh"), encoding="utf-8")
    rc = f"fpath=({folder} $fpath); autoload -Uz compinit; compinit -u -d {folder}/dump; PS1='$ '\n"
    (folder / ".zshrc").write_text(rc, encoding="utf-8")
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(folder)
        environment = {**os.environ, "ZDOTDIR": str(folder), "TERM": "dumb", "COLUMNS": "200"}
        os.execvpe("zsh", ["zsh", "-i"], environment)
    try:
        until("$ ", terminal)
        os.write(terminal, f"{line}\t\t".encode())
        return until(wanted, terminal)
    finally:
        os.write(terminal, b"\x03exit\n")
        os.close(terminal)
        os.waitpid(pid, 0)


def until(text: str, terminal: int) -> str:
    """Read from a terminal until a text."""
    screen = ""
    while text not in screen:
        ready, _, _ = select.select([terminal], [], [], SILENT_S)
        assert ready, screen
        screen += os.read(terminal, 65536).decode(errors="replace")
    return screen


@needs("bash")
def test_bash(tmp_path: Path) -> None:
    """Commands, parts of commands, options and choices are completed; other words are left to files."""
    assert {"review", "regrade", "report"} <= in_bash("grade re", tmp_path)
    assert in_bash("grade lab c", tmp_path) == {"check", "copy"}
    assert "--class-list" in in_bash("grade --cla", tmp_path)
    assert "--fail-under" in in_bash("grade regrade --f", tmp_path)
    assert in_bash("grade completion f", tmp_path) == {"fish"}
    assert in_bash("grade export results --to mo", tmp_path) == {"moodle"}
    (tmp_path / "submissions").mkdir()
    assert in_bash("grade open subm", tmp_path) == {"submissions"}
    assert in_bash("grade subm", tmp_path) == set()
    assert "complete -o bashdefault -o default -F" in completion_for("bash")


@needs("fish")
def test_fish(tmp_path: Path) -> None:
    """Commands, parts of commands, options and files are completed."""
    (tmp_path / "submissions").mkdir()
    assert {"review", "regrade", "report"} <= in_fish("grade re", tmp_path)
    assert {"check", "copy"} <= in_fish("grade lab c", tmp_path)
    assert "--class-list" in in_fish("grade --cla", tmp_path)
    assert "submissions/" in in_fish("grade subm", tmp_path)


@needs("zsh")
@pytest.mark.slow
def test_zsh(tmp_path: Path) -> None:
    """Commands with their descriptions, parts of commands and options are completed."""
    screen = in_zsh("grade re", "review", tmp_path)
    assert "-- Judge recordings again" in screen
    in_zsh("grade lab c", "copy", tmp_path)
    in_zsh("grade --cla", "grade --class-list", tmp_path)
    (tmp_path / "submissions").mkdir()
    in_zsh("grade subm", "grade submissions/", tmp_path)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_command_prints_it(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Each script has all commands and no error of the generator."""
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    for command in COMMANDS:
        assert command in script


def test_the_manual_page_is_the_current_one() -> None:
    """`tools/write-manual` writes it from the parsers."""
    kept = (ROOT / "docs/grade.1").read_text(encoding="utf-8")
    program = f"import runpy; print(runpy.run_path({str(ROOT / 'tools/write-manual')!r})['manual'](), end='')"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == kept
    assert str(Path.home()) not in kept


@needs("man")
def test_man_has_nothing_to_say_about_it() -> None:
    """The page is shown without warnings."""
    done = subprocess.run(
        ["man", "--warnings", "-l", str(ROOT / "docs/grade.1")],
        capture_output=True,
        text=True,
        env={**os.environ, "MANWIDTH": "100", "LC_ALL": "C.UTF-8"},
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "grade COMMAND" in done.stdout
