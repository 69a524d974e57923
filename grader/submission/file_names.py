"""Names of files as students, their tools and attackers write them → parts of a path that is safe and can be shown."""

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
#: Files that file managers and version control leave behind, and that nobody means to hand in.
_LITTER = frozenset(
    {".ds_store", "thumbs.db", "desktop.ini", "icon", ".git", ".gitkeep", ".directory"}
)
#: Kinds of files whose text the judging half may read.
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
)
_COMPILED = re.compile(r"\.(py[cod]|so(\.\d+)*|dll|dylib|o|a|lib|exe|class|wasm)$", re.IGNORECASE)
#: `alice.tar.gz` is called `alice`.
_PACKED = re.compile(
    r"(\.tar)?\.(zip|tar|gz|tgz|bz2|tbz2?|xz|txz|zst|7z|rar|whl|egg|jar)$", re.IGNORECASE
)

#: Characters of a raw name beyond which nobody looks at it.
_MOST_CHARACTERS = 1_000
_MOST_PART_BYTES = 200
_MOST_PATH_BYTES = 500
_MOST_SHOWN = 160
#: Control, format, surrogate and unassigned characters, line and paragraph separators.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Cn", "Zl", "Zp"})
#: With these, some scripts and emoji are written.
_JOINERS = "\u200c\u200d"
_DRIVE = re.compile(r"[A-Za-z]:")


class UnfitError(ValueError):
    """Something that is not extracted; its text says why."""


def clean_parts(name: str) -> tuple[str, ...]:
    """Return the parts of the path under which a file is kept; raises UnfitError if there is none.

    Backslashes separate folders, since some Windows tools write them so. Text is brought to Unicode's form NFC, as
    Python's imports expect it. Characters that nobody sees or that reorder what is shown, and dots and spaces at the
    end of a name, are dropped.
    """
    if len(name) > _MOST_CHARACTERS:
        raise UnfitError("its path is too long")
    parts = _parts(_decoded(name))
    if ".." in parts:
        raise UnfitError("a path that leads outside the submission")
    cleaned = tuple(_clean_part(part) for part in parts)
    if name.startswith(("/", "\\")) or (cleaned and _DRIVE.match(cleaned[0])):
        raise UnfitError("an absolute path, which leads outside the submission")
    if not cleaned or "" in cleaned:
        raise UnfitError("its name has no character that can be displayed")
    lengths = [len(part.encode()) for part in cleaned]
    if max(lengths) > _MOST_PART_BYTES or sum(lengths) + len(lengths) > _MOST_PATH_BYTES:
        raise UnfitError("its path is too long")
    return cleaned


def _parts(name: str) -> tuple[str, ...]:
    text = unicodedata.normalize("NFC", name).replace("\\", "/")
    return tuple(part for part in text.split("/") if part not in ("", "."))


def _clean_part(part: str) -> str:
    visible = "".join(c for c in part if c in _JOINERS or unicodedata.category(c) not in _HIDDEN)
    return unicodedata.normalize("NFC", visible).rstrip(". ").lstrip(" ")


def _decoded(name: str) -> str:
    """Read bytes that are no UTF-8 as Western Windows writes them."""
    try:
        raw = name.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:
        return name.encode("utf-8", "replace").decode()
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return raw.decode("cp1252", "replace")


def differ(name: str, parts: tuple[str, ...]) -> bool:
    """Whether a name came with characters that its clean parts do not have; how folders are separated is no matter."""
    return parts != _parts(name)


def collision_key(parts: tuple[str, ...]) -> str:
    """Return what two paths have in common that Windows or macOS cannot keep apart."""
    return unicodedata.normalize("NFC", "/".join(parts).casefold())


def slashed(name: str) -> str:
    """Return a member's name as other archives would write it: with slashes, and without `./` before it."""
    return re.sub(r"^(\./+)+", "", name.replace("\\", "/"))


def tool_folder(parts: tuple[str, ...]) -> str | None:
    """Return the outermost folder of a file's path that a tool has made, if there is one."""
    made = (depth for depth, part in enumerate(parts[:-1], 1) if part in TOOL_FOLDERS)
    return next(("/".join(parts[:depth]) for depth in made), None)


def is_litter(name: str) -> bool:
    """Whether a file's name is one that file managers or version control give."""
    return name.lower() in _LITTER or name.startswith("._")


def is_compiled(name: str) -> bool:
    """Whether a file's name says that it holds compiled code."""
    return _COMPILED.search(name) is not None


def is_packed(name: str) -> bool:
    """Whether a file's name says that it is an archive, or a file that is packed in some way."""
    return _PACKED.search(name) is not None


def without_archive_suffix(name: str) -> str:
    """Return a file's name without the suffixes that archives have."""
    return _PACKED.sub("", name) or name


def displayed(name: str) -> str:
    """Return any name as one line of text that can be written to any file, escapes standing for what is not shown."""
    cut = name if len(name) <= _MOST_SHOWN else name[: _MOST_SHOWN - 1] + "…"
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in cut
    )
