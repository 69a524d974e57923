"""Read catalogues: files of gettext's form PO with translated templates."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

#: Languages of the catalogues by their tags, each with its own name for itself.
NAMES = {"en": "English", "de": "Deutsch", "es": "Español"}
#: Names of languages in English.
_ENGLISH_NAMES = {"english": "en", "german": "de", "spanish": "es"}
_FOLDER = Path(__file__).parent
_FIELD = re.compile(r"(msgid|msgstr) (\".*\")|(\".*\")")


@dataclass(frozen=True)
class Message:
    """A template, its translation (empty if it is missing), and the files that have it."""

    english: str
    translation: str
    files: tuple[str, ...]


def tag_of(text: str) -> str:
    """Return the tag of a language by its tag or name: `de` for `de`, `de-AT`, `Deutsch` or `German`; empty if unknown."""
    word = text.strip().lower()
    for tag, name in NAMES.items():
        if re.split("[-_]", word)[0] == tag or word == name.lower():
            return tag
    return _ENGLISH_NAMES.get(word, "")


def engine_catalogues(tag: str) -> list[Path]:
    """Return the grader's own catalogues of a language."""
    return sorted((_FOLDER / tag).glob("*.po"))


def read_catalogues(paths: Iterable[Path]) -> list[Message]:
    """Return the messages of catalogues, in their order."""
    found: list[Message] = []
    for path in paths:
        state = path.stat()
        found += _read(path, state.st_mtime_ns, state.st_size)
    return found


@functools.lru_cache(maxsize=64)
def _read(path: Path, _changed_ns: int, _size: int) -> tuple[Message, ...]:
    """Return the messages of a catalogue, which `tools/write-catalogues` has written.

    Babel reads the same in a hundred times the time, which a grading should not take.
    """
    found = []
    for block in path.read_text(encoding="utf-8").split("\n\n"):
        message = _message_in(block)
        if message.english:
            found.append(message)
    return tuple(found)


def _message_in(block: str) -> Message:
    """Return the message of a block: its comments `#: FILE`, `msgid "..."` and `msgstr "..."`, each on several lines."""
    texts = {"msgid": "", "msgstr": ""}
    files: list[str] = []
    name = "msgid"
    for line in block.splitlines():
        if line.startswith("#:"):
            files += line[2:].split()
        field = _FIELD.fullmatch(line)
        if field is not None:
            name = field[1] or name
            texts[name] += json.loads(field[2] or field[3])
    return Message(texts["msgid"], texts["msgstr"], tuple(files))
