"""Programs to which nobody has added anything."""

from __future__ import annotations

import pytest

from grader.evidence.text.starter import untouched

GIVEN = "import rclpy\n\n\ndef main():\n    rclpy.init()  # TODO: your node\n\n\nmain()\n"
EMPTY = 'class Talker(Node):\n    def talk(self):\n        """Talk."""\n\n\ndef main():\n    pass\n\n\nmain()\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GIVEN, "is the file that the lab gave out, without a change"),
        (GIVEN.replace("  # TODO: your node", "\n\n    # mine"), "is the file that the lab"),
        (GIVEN.replace("rclpy.init()", "rclpy.init(args=None)"), ""),
        (EMPTY, "has only empty functions"),
        (EMPTY.replace("pass", "return None"), "has only empty functions"),
        (EMPTY.replace("pass", "rclpy.init()"), ""),
        ("rclpy.init()\n", ""),
        ("def main(:\n", ""),
    ],
)
def test_a_program_without_a_change_is_known(text: str, words: str) -> None:
    """Comments make no difference, one argument does."""
    found = untouched(text, ["no Python (", GIVEN])
    assert found.startswith(words)
    assert bool(found) == bool(words)
