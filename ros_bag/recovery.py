"""Finishes bags after their recorder was killed."""

from __future__ import annotations

import shutil
from pathlib import Path

from ros_bag.mcap_file import Contents, Row, contents_of, mcap_file_in
from ros_bag.writing import METADATA_FILE, BagWriter

_RECOVERY_FOLDER = ".recovering"


def recover(folder: Path) -> bool:
    """Finish a bag after its recorder was killed, with every readable message; return False if the bag was whole.

    A bag with damage elsewhere than at its end keeps a note of that. Raises `NotADirectoryError` if the folder is
    missing.
    """
    if not folder.is_dir():
        raise NotADirectoryError(f"no bag at {folder}: give the folder that holds the .mcap file")
    if (folder / METADATA_FILE).exists():
        return False
    found = mcap_file_in(folder)
    path = found or folder / (folder.name + ".mcap")
    workshop = folder / _RECOVERY_FOLDER
    shutil.rmtree(workshop, ignore_errors=True)
    _rewrite(contents_of(found), BagWriter(workshop, path.stem))
    (workshop / path.name).replace(path)
    (workshop / METADATA_FILE).replace(folder / METADATA_FILE)
    shutil.rmtree(workshop)
    return True


def _rewrite(contents: Contents, writer: BagWriter) -> None:
    """Write all readable messages in the order of their reception, and close the writer."""
    rows: list[tuple[Row, int]] = []
    for info, messages in contents.topics().values():
        channel = writer.add_topic(info)
        rows += [(row, channel) for row in messages]
    rows.sort(key=lambda item: item[0][0])
    for (received_ns, source_ns, sequence, buffer, start, end), channel in rows:
        data = bytes(buffer[start:end])
        writer.write(channel, data, received_ns=received_ns, source_ns=source_ns, sequence=sequence)
    writer.note_damage(contents.damage_in_words())
    writer.close()
