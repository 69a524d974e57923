"""What was handed in (a folder, an archive, loose files) → a folder of regular files, within limits."""

from grader.intake.extraction import (
    LIMITS,
    Handed,
    Intake,
    Limits,
    Piece,
    confined,
    names_in,
    taken_in,
    text_of,
    texts_in,
)

__all__ = ["LIMITS", "Handed", "Intake", "Limits", "Piece", "confined", "names_in", "taken_in", "text_of", "texts_in"]
