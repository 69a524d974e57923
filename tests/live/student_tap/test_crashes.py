"""Frames of compiled programs that crash: named by the library, and read with care."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from grader.live.builds.crash_library import crash_library
from grader.live.student_tap.crashes import LIBRARY, crash_variables, frames_in
from grader.recording.session import StackFrame

#: Crashes by the way in its argument.
PROGRAM = """\
#include <stdlib.h>
#include <string.h>
static int deeper(volatile char *before) {
  char more[4096];
  more[0] = before ? before[1] : 1;
  return deeper(more) + more[0];
}
static int first(const int *volatile values) { return *values; }
int main(int count, char **arguments) {
  char way = count > 1 ? arguments[1][0] : 'n';
  if (way == 'n') return first(NULL);
  if (way == 'l') return strlen(getenv("NOT_SET"));
  if (way == 'd') return deeper(NULL);
  abort();
}
"""
needs_a_compiler = pytest.mark.skipif(crash_library() is None, reason="there is no compiler for C")


def crashed(folder: Path, way: str, *options: str) -> tuple[int, list[StackFrame]]:
    """Compile the program, let it crash, and return its status and the named frames."""
    library = crash_library()
    assert library is not None
    (folder / LIBRARY).symlink_to(library)
    source = folder / "install/source.c"
    source.parent.mkdir()
    source.write_text(PROGRAM, encoding="utf-8")
    program = source.parent / "program"
    subprocess.run(["cc", "-g1", *options, "-o", program, source], check=True)
    read, write = os.pipe()
    variables = {**crash_variables(str(folder), str(source.parent)), "GRADER_TAP_FD": str(write)}
    done = subprocess.run([program, way], env=variables, pass_fds=(write,), check=False)
    os.close(write)
    with os.fdopen(read, encoding="utf-8") as said:
        return done.returncode, frames_in(said.read(), f"{source.parent}/")


@needs_a_compiler
@pytest.mark.parametrize(
    ("way", "status", "innermost"),
    [
        ("n", -11, StackFrame("source.c", 8, "first")),
        ("l", -11, StackFrame("source.c", 12, "main")),
        ("d", -11, StackFrame("source.c", 3, "deeper")),
        ("a", -6, StackFrame("source.c", 14, "main")),
    ],
)
def test_a_crash_names_its_frames(
    way: str, status: int, innermost: StackFrame, tmp_path: Path
) -> None:
    """A bad pointer, also in a function of the system, an endless recursion and an abort keep their signal."""
    found = crashed(tmp_path, way)
    assert found[0] == status
    assert found[1][0] == innermost
    assert len(found[1]) < 100


@needs_a_compiler
def test_a_program_with_the_address_sanitizer_starts(tmp_path: Path) -> None:
    """The sanitizer explains a crash by itself, and nothing is named twice."""
    assert crashed(tmp_path, "n", "-fsanitize=address") == (1, [])


@needs_a_compiler
def test_programs_of_the_system_are_left_alone(tmp_path: Path) -> None:
    """A shell passes the library on to a student's program, and is no such program itself."""
    variables = crash_variables(str(crash_library()), str(tmp_path))
    variables["LD_PRELOAD"] = str(crash_library())
    shell = ["sh", "-c", "echo $LD_PRELOAD; kill -SEGV $$"]
    done = subprocess.run(shell, env=variables, capture_output=True, text=True, check=False)
    assert done.returncode == -11
    assert done.stdout.strip() == str(crash_library())


def test_a_hostile_text_is_bounded() -> None:
    """Numbers without end, other lines and endless lists are left out."""
    begin = "Crash (innermost frame first):\n"
    assert frames_in(begin + "f\n/a.c:99999999999\n", "/") == []
    assert frames_in(begin + "f\nrelative.c:1\n??\n??:0\n", "/") == []
    assert frames_in("f\n/a.c:1\n", "/") == []
    whole = frames_in(begin + f"{'f' * 5000}\n/a.c:1\n" * 5000, "/")
    assert len(whole) == 60
    assert len(whole[0].function) == 300
