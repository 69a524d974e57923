"""Texts of files: their encoding, and those that a lab gives out."""

from __future__ import annotations

from grader.lab.rubric import FINGERPRINTS_ENDING, Rubric
from grader.submission.file_names import MAX_TEXT_BYTES, TEXT_SUFFIXES

#: Byte order marks of UTF-16; editors of Windows call this encoding "Unicode".
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")


def is_text(content: bytes) -> bool:
    """Return whether the content of a file is a text; others have zero bytes."""
    return b"\0" not in content or content.startswith(_UTF_16)


def decode_text(content: bytes) -> str:
    """Decode a text file as UTF-8, with or without byte order mark, as UTF-16 with one, else as Latin-1; never fails."""
    if content.startswith(_UTF_16):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def given_texts(rubric: Rubric) -> dict[str, str]:
    """Return the texts of the lab's handout, a file or a folder; nothing if the handout is not here."""
    if rubric.lab.handout is None:
        return {}
    handout = rubric.folder / rubric.lab.handout
    if handout.is_file():
        paths = [handout]
    else:
        paths = sorted(handout.rglob("*"))
    texts = {}
    for path in paths:
        if path.suffix.lower() in {*TEXT_SUFFIXES, FINGERPRINTS_ENDING} and path.is_file():
            name = path.relative_to(rubric.folder).as_posix()
            texts[name] = decode_text(path.read_bytes()[:MAX_TEXT_BYTES])
    return texts
