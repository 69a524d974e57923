"""Names of files, as students, their tools and attackers write them, and safe, displayable paths for them."""

from __future__ import annotations

import re
import unicodedata

#: Folders that tools make; a copy of a student's file in them is not the student's file.
TOOL_FOLDERS = frozenset(
    {
        "build",
        "install",
        "log",
        ".venv",
        "venv",
        "site-packages",
        "dist-packages",
        "node_modules",
        "__pycache__",
    }
    | {".git", ".hg", ".svn", ".mypy_cache", ".pytest_cache", ".ruff_cache", ".vscode", ".idea"}
    | {"__MACOSX", "$RECYCLE.BIN", "System Volume Information"}
)
#: Files that file managers and version control leave behind.
_LITTER = frozenset(
    {".ds_store", "thumbs.db", "desktop.ini", "icon", ".git", ".gitkeep", ".directory"}
)
#: Suffixes of sources and headers in C and C++.
C_SUFFIXES = frozenset({".c", ".cc", ".cpp", ".cxx", ".h", ".hh", ".hpp", ".hxx"})
#: Suffixes of text files that the judging half reads.
TEXT_SUFFIXES = frozenset(
    {
        ".py",
        ".md",
        ".rst",
        ".txt",
        ".xml",
        ".cfg",
        ".toml",
        ".yaml",
        ".yml",
        ".launch",
        ".org",
        ".adoc",
        "",
    }
    | {".msg", ".srv", ".action"}
    | C_SUFFIXES
)
#: Largest text that is read.
MAX_TEXT_BYTES = 512 * 1024
_COMPILED = re.compile(r"\.(py[cod]|so(\.\d+)*|dll|dylib|o|a|lib|exe|class|wasm)$", re.IGNORECASE)
#: `alice.tar.gz` is called `alice`.
_PACKED = re.compile(
    r"(\.tar)?\.(zip|tar|gz|tgz|bz2|tbz2?|xz|txz|zst|7z|rar|whl|egg|jar)$", re.IGNORECASE
)

#: Characters of the longest raw name that is read.
_MOST_CHARACTERS = 1_000
_MOST_PART_BYTES = 200
_MOST_PATH_BYTES = 500
_MOST_SHOWN = 160
#: Control, format, surrogate and unassigned characters, line and paragraph separators.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Cn", "Zl", "Zp"})
#: Invisible characters that some scripts and emoji need.
_JOINERS = "\u200c\u200d"
_DRIVE = re.compile(r"[A-Za-z]:")


class UnfitError(ValueError):
    """Raised with the reason for a member that is not extracted."""


def clean_parts(name: str) -> tuple[str, ...]:
    """Return the parts of a safe path for a file; raises UnfitError if there is none.

    Backslashes separate folders, because some Windows tools write them. Text is converted to Unicode's form NFC, as
    Python's imports expect. Invisible and reordering characters, and dots and spaces at the end of a name, are dropped.
    """
    if len(name) > _MOST_CHARACTERS:
        raise UnfitError("its path is too long")
    parts = _parts(_decoded(name))
    if ".." in parts:
        raise UnfitError("a path that leads outside the submission")
    cleaned = tuple(_clean_part(part) for part in parts)
    has_drive = bool(cleaned) and _DRIVE.match(cleaned[0]) is not None
    if has_drive or name.startswith(("/", "\\")):
        raise UnfitError("an absolute path, which leads outside the submission")
    if not cleaned or "" in cleaned:
        raise UnfitError("its name has no character that can be displayed")
    lengths = [len(part.encode()) for part in cleaned]
    whole = sum(lengths) + len(lengths)
    if max(lengths) > _MOST_PART_BYTES or whole > _MOST_PATH_BYTES:
        raise UnfitError("its path is too long")
    return cleaned


def _parts(name: str) -> tuple[str, ...]:
    text = unicodedata.normalize("NFC", name).replace("\\", "/")
    return tuple(part for part in text.split("/") if part not in ("", "."))


def _clean_part(part: str) -> str:
    visible = ""
    for character in part:
        is_hidden = unicodedata.category(character) in _HIDDEN
        if character in _JOINERS or not is_hidden:
            visible += character
    return unicodedata.normalize("NFC", visible).rstrip(". ").lstrip(" ")


def _decoded(name: str) -> str:
    """Return a name with bytes that are not UTF-8 decoded as Western Windows encodes them."""
    try:
        raw = name.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:
        return name.encode("utf-8", "replace").decode()
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return raw.decode("cp1252", "replace")


def differ(name: str, parts: tuple[str, ...]) -> bool:
    """Return whether cleaning dropped characters of a name; separators of folders do not matter."""
    return parts != _parts(name)


def collision_key(parts: tuple[str, ...]) -> str:
    """Return a key that is equal for paths that Windows or macOS cannot keep apart."""
    return unicodedata.normalize("NFC", "/".join(parts).casefold())


def slashed(name: str) -> str:
    """Return a member's name with slashes, and without a leading `./`."""
    return re.sub(r"^(\./+)+", "", name.replace("\\", "/"))


def tool_folder(parts: tuple[str, ...]) -> str | None:
    """Return the outermost folder of a file's path that a tool made, if there is one."""
    for depth, part in enumerate(parts[:-1], 1):
        if part in TOOL_FOLDERS:
            return "/".join(parts[:depth])
    return None


def is_litter(name: str) -> bool:
    """Return whether file managers or version control made a file, by its name."""
    return name.lower() in _LITTER or name.startswith("._")


def is_compiled(name: str) -> bool:
    """Return whether a file holds compiled code, by its name."""
    return _COMPILED.search(name) is not None


def is_packed(name: str) -> bool:
    """Return whether a file is an archive or otherwise packed, by its name."""
    return _PACKED.search(name) is not None


def without_archive_suffix(name: str) -> str:
    """Return a file's name without the suffixes of archives: `alice.tar.gz` becomes `alice`."""
    return _PACKED.sub("", name) or name


def displayed(name: str) -> str:
    """Return any name as one displayable line of text, with escapes for other characters."""
    if len(name) > _MOST_SHOWN:
        name = name[: _MOST_SHOWN - 1] + "…"
    shown = []
    for character in name:
        if not character.isprintable():
            character = character.encode("unicode_escape").decode("ascii")
        shown.append(character)
    return "".join(shown)
