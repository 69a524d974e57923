"""A folder as bytes, and bytes as a folder, to grade on another machine."""

from __future__ import annotations

import io
import shutil
import tarfile
from pathlib import Path, PurePosixPath


def packed(folder: Path) -> bytes:
    """Return the regular files below a folder as an archive."""
    return packed_files({p.relative_to(folder).as_posix(): p for p in sorted(folder.rglob("*")) if p.is_file()})


def packed_files(files: dict[str, Path]) -> bytes:
    """Return some files as an archive, by the names that they shall have."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:gz", compresslevel=1, format=tarfile.PAX_FORMAT) as archive:
        for name, path in files.items():
            archive.add(path, name, recursive=False)
    return stream.getvalue()


def unpack(content: bytes, folder: Path) -> None:
    """Write the files of an archive below a folder.

    Raises
    ------
    ValueError
        If there is anything but regular files with plain names.
    """
    with tarfile.open(fileobj=io.BytesIO(content), mode="r:gz") as archive:
        for member in archive:
            path = PurePosixPath(member.name)
            file = archive.extractfile(member) if member.isreg() else None
            if file is None or path.is_absolute() or ".." in path.parts:
                raise ValueError(f"{member.name!r} has no place in a parcel")
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            with (folder / path).open("xb") as written:
                shutil.copyfileobj(file, written)
