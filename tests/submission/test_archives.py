"""Zip and tar files by tools and by attackers: entries read, and resources used."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import resource
import stat
import struct
import tarfile
import tempfile
import time
import uuid
import zipfile
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grader.errors import SubmissionError
from grader.submission.extraction import names_in, open_submission
from grader.submission.members import Kind, format_of, members_of_archive
from tests.submission.hostile_archives import (
    MEBIBYTE,
    overlapping_zip,
    tar_header,
    tar_of,
    zeros_in_bzip2,
    zeros_in_gzip,
    zeros_in_xz,
    zip_of,
    zip_of_entries,
)
from tests.thorough import examples

pytestmark = pytest.mark.slow

FILES = [
    ("lab/a.py", b"print(1)\n"),
    ("lab/größe.md", "Größe\n".encode() * 999),
    ("lab/empty.txt", b""),
]
LONG = "/".join(["a" * 90] * 4) + "/node.py"
PACKERS: dict[str, Callable[[bytes], bytes]] = {
    "tar": bytes,
    "tar.gz": gzip.compress,
    "tar.bz2": bz2.compress,
    "tar.xz": lzma.compress,
}


def contents(packed: bytes) -> dict[str, bytes | str]:
    """Read an archive: the content of files, and the kind of other entries."""
    found: dict[str, bytes | str] = {}
    for member in members_of_archive(io.BytesIO(packed)):
        if member.kind is Kind.FILE:
            found[member.name] = b"".join(member.pieces())
            assert len(found[member.name]) <= member.size_bytes
        else:
            found[member.name] = member.kind.value
    return found


# -- as tools write them -----------------------------------------------------------------------------


def test_a_zip_is_read() -> None:
    """Names and contents come back as they went in."""
    assert contents(zip_of(FILES)) == dict(FILES)


@pytest.mark.parametrize("packer", PACKERS)
@pytest.mark.parametrize("form", [tarfile.USTAR_FORMAT, tarfile.GNU_FORMAT, tarfile.PAX_FORMAT])
def test_a_tar_is_read(packer: str, form: int) -> None:
    """In each format and compression, names and contents come back as they went in."""
    packed = PACKERS[packer](tar_of(FILES, form))
    assert format_of(packed[:512]) == packer
    assert contents(packed) == dict(FILES)


@pytest.mark.parametrize("form", [tarfile.GNU_FORMAT, tarfile.PAX_FORMAT])
def test_long_names_in_a_tar(form: int) -> None:
    """A name that has no room in the header is read from the one before it, and stands for that file alone."""
    packed = tar_of([(LONG, b"1"), ("short.py", b"2")], form)
    assert contents(packed) == {LONG: b"1", "short.py": b"2"}


def test_several_pieces_packed_one_after_another() -> None:
    """A file packed piece by piece, and padded with zeros, is one archive."""
    whole = tar_of(FILES)
    for pack in (gzip.compress, bz2.compress, lzma.compress):
        packed = b"".join(pack(whole[at : at + 3000]) for at in range(0, len(whole), 3000)) + bytes(
            4096
        )
        assert contents(packed) == dict(FILES)


def test_a_tar_that_lacks_its_last_blocks() -> None:
    """Some tools end a tar with its last file; that is enough."""
    assert contents(tar_of([("a.py", b"x" * 512)])[: 2 * 512]) == {"a.py": b"x" * 512}


def test_what_is_no_file_is_reported() -> None:
    """Links, devices and pipes are named by their kind, in both kinds of archive."""
    kinds = {
        tarfile.SYMTYPE: Kind.LINK,
        tarfile.LNKTYPE: Kind.HARD_LINK,
        tarfile.FIFOTYPE: Kind.SPECIAL,
        tarfile.CHRTYPE: Kind.SPECIAL,
        tarfile.BLKTYPE: Kind.SPECIAL,
        tarfile.DIRTYPE: Kind.FOLDER,
    }
    members = []
    for kind in kinds:
        info = tarfile.TarInfo(f"it-{kind.decode()}")
        info.type, info.linkname = kind, "/etc/passwd"
        members.append((info, b""))
    packed = tar_of([*members, ("after.py", b"x")])
    assert contents(packed) == {
        f"it-{kind.decode()}": told.value for kind, told in kinds.items()
    } | {"after.py": b"x"}

    link, pipe = zipfile.ZipInfo("link"), zipfile.ZipInfo("pipe")
    link.external_attr, pipe.external_attr = (
        (stat.S_IFLNK | 0o777) << 16,
        (stat.S_IFIFO | 0o644) << 16,
    )
    link.create_system = pipe.create_system = 3
    packed = zip_of([(link, b"/etc/passwd"), (pipe, b""), ("folder/", b"")])
    assert contents(packed) == {
        "link": Kind.LINK.value,
        "pipe": Kind.SPECIAL.value,
        "folder/": Kind.FOLDER.value,
    }


def test_sparse_files_are_reported_and_what_follows_is_read() -> None:
    """A sparse file in a tar is skipped, in both ways of writing it."""
    old = bytearray(tar_header("bag.mcap", 512))
    old[156:157] = tarfile.GNUTYPE_SPARSE
    old[482] = 1  # another block of the map follows
    old[148:156] = b"%06o\0 " % (sum(old[:148]) + 8 * 0x20 + sum(old[156:]))
    packed = bytes(old) + bytes(512) + b"x" * 512 + tar_of([("after.py", b"y")])
    assert contents(packed) == {"bag.mcap": Kind.SPARSE.value, "after.py": b"y"}
    info = tarfile.TarInfo("bag.mcap")
    info.pax_headers = {
        "GNU.sparse.major": "1",
        "GNU.sparse.minor": "0",
        "GNU.sparse.realsize": str(10**15),
    }
    assert contents(tar_of([(info, b"1\n0\n512\n".ljust(1024, b"\0")), ("after.py", b"y")])) == {
        "bag.mcap": Kind.SPARSE.value,
        "after.py": b"y",
    }


def test_names_without_a_hint_how_to_read_them() -> None:
    """Names of macOS are UTF-8 although the zip does not say so; other bytes are read as old tools wrote them."""
    packed = zip_of([("x" * len("größe.py".encode()), b"1")])
    assert list(contents(packed.replace(b"x" * 10, "größe.py".encode()))) == ["größe.py"]
    assert list(contents(packed.replace(b"x" * 10, b"gr\x94\xe1e12.py"))) == ["größe12.py"]


def test_times_of_members() -> None:
    """A zip's time has no zone unless Unix's or NTFS's field says it in UTC; the epoch of zip is no time at all."""
    utc = datetime(2026, 3, 2, 22, 41, tzinfo=UTC)
    plain, unknown, unix, ntfs = (zipfile.ZipInfo(name, (2026, 3, 2, 23, 41, 0)) for name in "abcd")
    unknown.date_time = (1980, 1, 1, 0, 0, 0)
    unix.extra = b"UT\x05\x00\x01" + int(utc.timestamp()).to_bytes(4, "little")
    ticks = (int(utc.timestamp()) + 11_644_473_600) * 10**7
    ntfs.extra = (
        b"\x0a\x00\x20\x00" + bytes(4) + b"\x01\x00\x18\x00" + ticks.to_bytes(8, "little") * 3
    )
    packed = zip_of([(info, b"") for info in (plain, unknown, unix, ntfs)])
    told = {m.name: m.modified for m in members_of_archive(io.BytesIO(packed))}
    assert told == {"a": datetime(2026, 3, 2, 23, 41), "b": None, "c": utc, "d": utc}

    whole, exact = tarfile.TarInfo("a"), tarfile.TarInfo("b")
    whole.mtime, exact.mtime = int(utc.timestamp()), utc.timestamp() + 0.5
    members = members_of_archive(io.BytesIO(tar_of([(whole, b""), (exact, b"")])))
    assert [m.modified for m in members] == [utc, utc.replace(microsecond=500_000)]


def test_what_is_no_archive() -> None:
    """Texts and other files are not taken for archives, whatever their first letters."""
    for head in (b"", b"PK", b"import rclpy\n" * 50, bytes(512), b"BZ", b"%PDF-1.7"):
        assert format_of(head[:512]) is None


# -- damaged and protected ---------------------------------------------------------------------------


def damaged(packed: bytes) -> str:
    """Say why an archive is refused as damaged."""
    with pytest.raises(SubmissionError, match="damaged") as caught:
        contents(packed)
    return caught.value.problem


@pytest.mark.parametrize("packer", PACKERS)
def test_a_truncated_tar_is_refused(packer: str) -> None:
    """Wherever it was cut off within its files, that is noticed."""
    packed = PACKERS[packer](tar_of([("a.py", bytes(range(256)) * 40)]))
    for length in (
        (512 + 100, len(packed) // 2)
        if packer == "tar"
        else (40, len(packed) // 2, len(packed) - 1)
    ):
        assert damaged(packed[:length])


def test_a_truncated_zip_is_refused() -> None:
    """Without its directory, or with a part of it, nothing is read."""
    packed = zip_of(FILES)
    for length in (len(packed) // 2, len(packed) - 1, len(packed) - 30):
        assert damaged(packed[:length])


def test_changed_contents_are_noticed() -> None:
    """A bit that fell over in a file is noticed by its checksum, in a packed tar also behind the last file."""
    packed = bytearray(zip_of([("a.py", b"x" * 100)]))
    packed[40] ^= 1
    assert damaged(bytes(packed))
    packed = bytearray(gzip.compress(tar_of([("a.py", b"x" * 100)])))
    packed[-6] ^= 1
    assert damaged(bytes(packed))


def test_protected_members_are_refused() -> None:
    """A member that has a password is not taken for a damaged one."""
    packed = bytearray(zip_of([("a.py", b"x" * 100)]))
    for at in (6, packed.index(b"PK\x01\x02") + 8):
        packed[at] |= 1
    with pytest.raises(SubmissionError, match="password"):
        contents(bytes(packed))


def test_methods_of_packing() -> None:
    """Whatever Python unpacks is unpacked; a member that is packed in another way is named as such."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA, zipfile.ZIP_STORED):
            archive.writestr(f"{method}.py", b"x" * 100, method)
    packed = bytearray(file.getvalue())
    packed[packed.rindex(b"0.py") - 46 + 10] = 99
    assert contents(bytes(packed)) == {
        "12.py": b"x" * 100,
        "14.py": b"x" * 100,
        "0.py": Kind.METHOD.value,
    }


def read_all(packed: bytes) -> None:
    """Read an archive that may be anything."""
    with suppress(SubmissionError):
        contents(packed)


WHOLE = [
    zip_of(FILES),
    *(pack(tar_of([*FILES, (LONG, b"1")])) for pack in PACKERS.values()),
    zip_of_entries(3),
]


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None, max_examples=examples(300))
@given(
    st.sampled_from(WHOLE),
    st.lists(st.tuples(st.floats(0, 1), st.binary(min_size=1, max_size=8)), max_size=6),
)
def test_any_damage_is_reported(whole: bytes, changes: list[tuple[float, bytes]]) -> None:
    """Reading an archive with any bytes changed ends, with no error but those expected."""
    packed = bytearray(whole)
    for place, change in changes:
        at = int(place * (len(packed) - 1))
        packed[at : at + len(change)] = change
    read_all(bytes(packed))


@settings(deadline=None)
@given(
    st.sampled_from([b"PK\x03\x04", b"PK\x05\x06", b"\x1f\x8b\x08\x00", b"BZh9", b"\xfd7zXZ\x00"]),
    st.binary(),
)
def test_any_bytes_are_reported(magic: bytes, rest: bytes) -> None:
    """Data with only the first bytes of an archive end in an expected error."""
    read_all(magic + rest)


# -- bombs ---------------------------------------------------------------------------------------------


#: The most time until a bomb is refused: half of the kernel's limit.
SOON_S = 10.0


def refused_soon(packed: bytes, folder: Path) -> str:
    """Hand in an archive that is too much; returns why it is refused, after little time and with nothing left."""
    path = folder / "bomb"
    path.write_bytes(packed)
    prefix = f"{uuid.uuid4().hex}-"  # folders of tests that run side by side may have the same name
    started_s = time.process_time() + children_s()
    with pytest.raises(SubmissionError) as caught, open_submission(path, prefix=prefix):
        pass
    assert time.process_time() + children_s() - started_s < SOON_S
    assert not list(Path(tempfile.gettempdir()).glob(f"{prefix}*"))
    assert caught.value.exit_status == 3
    return f"{caught.value.problem}. {caught.value.remedy}"


def children_s() -> float:
    """Return the time that processes which have ended took of a core."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@pytest.mark.parametrize("pack", [zeros_in_gzip, zeros_in_bzip2, zeros_in_xz])
def test_ten_gibibytes_are_given_up_early(
    pack: Callable[[bytes, int], bytes], tmp_path: Path
) -> None:
    """A tar of 10 GiB of zeros is refused, whether its headers say so or not."""
    for header in (tar_header("a.py", 10 * 1024**3), bytes(1024)):
        said = refused_soon(pack(header, 10 * 1024), tmp_path)
        assert "MiB when it is unpacked. Hand it in without recordings" in said


def test_a_million_entries_in_a_zip_are_not_read(tmp_path: Path) -> None:
    """A directory that is too large is given up while it is read into memory."""
    assert "of memory. Hand it in without recordings" in refused_soon(
        zip_of_entries(1_000_000), tmp_path
    )


def test_a_class_in_one_zip_is_listed(tmp_path: Path) -> None:
    """A class of two hundred students and more fits the memory for reading."""
    (tmp_path / "class.zip").write_bytes(zip_of_entries(60_000))
    assert len(names_in(tmp_path / "class.zip") or []) == 60_000


def test_what_unpacks_at_once_is_given_up(tmp_path: Path) -> None:
    """Gibibytes out of one piece, which Python's readers of zip would take into memory, do not get there."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_BZIP2) as archive:
        archive.writestr("a.py", bytes(200 * MEBIBYTE))
    packed = bytearray(file.getvalue())
    directory = packed.index(b"PK\x01\x02")
    for at in (22, directory + 24):
        packed[at : at + 4] = struct.pack("<I", MEBIBYTE // 2)  # the claimed size
    assert refused_soon(bytes(packed), tmp_path)


def test_a_header_that_claims_to_be_huge_is_refused(tmp_path: Path) -> None:
    """An extended header is read into memory, and memory is limited."""
    header = bytearray(tar_header("x", 500 * MEBIBYTE))
    header[156:157] = tarfile.XHDTYPE
    header[148:156] = b"%06o\0 " % (sum(header[:148]) + 8 * 0x20 + sum(header[156:]))
    assert refused_soon(bytes(header) + bytes(MEBIBYTE), tmp_path)
    assert "memory" in refused_soon(zeros_in_gzip(bytes(header), 1000), tmp_path)


def test_headers_after_headers_are_given_up(tmp_path: Path) -> None:
    """Extended headers without a file take as much of the limit as files do."""
    header = bytearray(tar_header("x", MEBIBYTE))
    header[156:157] = tarfile.XHDTYPE
    header[148:156] = b"%06o\0 " % (sum(header[:148]) + 8 * 0x20 + sum(header[156:]))
    assert refused_soon(gzip.compress((bytes(header) + bytes(MEBIBYTE)) * 130, 1), tmp_path)


def test_empty_pieces_by_the_thousand_are_harmless(tmp_path: Path) -> None:
    """Pieces that unpack to nothing cost time and nothing else."""
    for pack in (gzip.compress, bz2.compress, lzma.compress):
        assert refused_soon(pack(tar_header("a.py", 10**6)) + pack(b"") * 30_000, tmp_path)


def test_overlapping_entries_do_not_multiply(tmp_path: Path) -> None:
    """A hundred names for one piece of zeros give nothing that is extracted."""
    assert refused_soon(overlapping_zip(100, 7 * MEBIBYTE), tmp_path)


def test_a_size_below_zero_ends(tmp_path: Path) -> None:
    """A tar with a file of negative size is damaged, and not read for ever."""
    header = bytearray(tar_header("x", 0))
    header[124:136] = b"\xff" * 10 + b"\xfc\x00"
    header[148:156] = b"%06o\0 " % (sum(header[:148]) + 8 * 0x20 + sum(header[156:]))
    assert "damaged" in refused_soon(
        tar_of([("a.py", b"1")])[:1024] + bytes(header) + bytes(2048), tmp_path
    )
