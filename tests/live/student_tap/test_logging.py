"""Logging of a student's node: the same lines as ever, in less time of a core."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from grader.live.sandbox.environment import INSIDE_FOLDER

pytestmark = pytest.mark.live

_HELPER = """
def tell(logger, text):
    logger.info(text)
"""
_PROGRAM = """
import time
import rclpy, rclpy.logging
from rclpy.node import Node
from helper import tell
rclpy.init()
logger = Node("talker").get_logger()
class Arm:
    def move(self):
        logger.warning("moves")
        logger.info("once only", once=True)
for _ in range(2):
    Arm().move()
    tell(logger, "told")
    exec("logger.info('from a text')")
    rclpy.logging.get_logger("other").error("of no node")
before = time.process_time()
for _ in range(1000):
    tell(logger, "again")
print(time.process_time() - before)
"""


def _run(program: Path, *notes: int, **more: str) -> tuple[float, list[str]]:
    """Return how much CPU time a thousand messages took, in s, and all lines that were logged."""
    form = "{file_name} {line_number} {function_name}: {message}"
    environment = {**os.environ, "RCUTILS_CONSOLE_OUTPUT_FORMAT": form, **more}
    said = subprocess.run(
        [sys.executable, str(program)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        pass_fds=notes,
    )
    return float(said.stdout), said.stderr.splitlines()


def test_lines_are_named_as_ever_and_cost_less(tmp_path: Path) -> None:
    """Whatever logs is named by its file, line and function, as without the tap."""
    (tmp_path / "helper.py").write_text(_HELPER, encoding="utf-8")
    program = tmp_path / "program.py"
    program.write_text(_PROGRAM, encoding="utf-8")
    plain_s, plain = _run(program)
    with (tmp_path / "notes").open("w") as notes:
        tap = {"PYTHONPATH": str(INSIDE_FOLDER), "GRADER_TAP_FD": str(notes.fileno())}
        tapped_s, tapped = _run(program, notes.fileno(), **tap)
    assert tapped == plain
    assert len(plain) == 1009
    assert f"{program} 10 move: moves" in plain
    assert f"{tmp_path / 'helper.py'} 3 tell: told" in plain
    assert tapped_s < plain_s / 2
