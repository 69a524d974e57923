"""Texts of the lab's own, and of the grader's, in a submission."""

from __future__ import annotations

from grader.evidence.text.given import GivenText, is_own_export
from grader.evidence.text.markup import read_markdown

HANDOUT = """# Drive

The robot drives to the goal that the operator sends.
Run it.

```
ros2 run drive drive_node
```

- The node stops in front of walls, and waits for the next goal.
"""
SOURCE = '''"""Drives the robot to the goal of the operator."""
# The robot needs three seconds to come to a stop.
speed = 1.0
'''
GIVEN = GivenText.of({"handout/README.md": HANDOUT, "handout/drive.py": SOURCE})
OWN = "My node brakes early because the floor is wet."


def left(text: str) -> list[str]:
    """Return the text of the blocks that are the student's own."""
    found = []
    for section in GIVEN.without(read_markdown(text)):
        for block in section.blocks:
            found.append(block.text)
    return found


def test_a_copy_of_the_handout_has_nothing_of_its_own() -> None:
    """Paragraphs, items and code of a copy are left out, also with other marks and line breaks."""
    assert left(HANDOUT) == []
    assert left(HANDOUT.replace("drives to", "*drives*\nto")) == []


def test_fingerprints_stand_for_a_text() -> None:
    """A copy is known from the fingerprints alone, own sentences stay, and the file has no word of the text."""
    kept = GivenText.of({"handout/README.md": HANDOUT}).fingerprints()
    assert "robot" not in kept
    known = GivenText.of({"handout/README.sha256": kept})
    document = read_markdown(f"{HANDOUT}\n\n{OWN}\n")
    own = []
    for section in known.without(document):
        for block in section.blocks:
            own.append(block.text)
    assert own == [OWN]


def test_text_from_a_given_source_is_given() -> None:
    """Docstrings and comments of given programs count as the lab's text."""
    assert left("The robot needs three seconds to come to a stop.") == []


def test_a_paragraph_with_a_sentence_of_its_own_stays() -> None:
    """One own sentence makes a paragraph the student's."""
    text = f"The robot drives to the goal that the operator sends. {OWN}"
    assert left(text) == [text]


def test_a_command_of_the_handout_may_be_repeated() -> None:
    """The command for a given program is the same for all students."""
    text = f"# Mine\n\n{OWN} It starts like this, by hand:\n\n```\nros2 run drive drive_node\n```\n"
    assert len(left(text)) == 2


def test_a_short_sentence_is_anybodys() -> None:
    """Two words prove no copy."""
    assert left("Run it.") == ["Run it."]


def test_without_a_handout_everything_is_the_students() -> None:
    """A recording of an earlier version has no given texts."""
    document = read_markdown(HANDOUT)
    assert GivenText.of({}).without(document) == document


def test_a_summary_of_an_earlier_run_is_known() -> None:
    """A CI job can leave the grader's summary in the checkout."""
    assert is_own_export(
        "# Lab: 5 of 9 points\n\nThe evidence for each point is in `report.html`, here.\n"
    )
    assert not is_own_export("# Lab\n\nThe report is in `report.html`.\n")
