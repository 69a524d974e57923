"""What was left out of a submission, in as many lines as somebody reads."""

from __future__ import annotations

from dataclasses import dataclass, field

from grader.intake.names import displayed

#: Files that are named in all, and for one reason.
MOST_NAMED = 50
MOST_NAMED_FOR_ONE = 10
_BY_TOOL = "made by a tool"


@dataclass
class _Group:
    """What was left out for one reason."""

    named: list[str] = field(default_factory=list)
    count: int = 0


class Notes:
    """Collects what was left out and why; takes no more room for a million files than for fifty."""

    def __init__(self) -> None:
        self._groups: dict[str, _Group] = {}
        self._named = 0
        self._tool_folders: dict[str, int] = {}

    def add(self, name: str, reason: str) -> None:
        """Note a file or folder by the name that it came under.

        Parameters
        ----------
        reason : str
            One of a limited number, since lines are grouped by it.
        """
        group = self._groups.setdefault(reason, _Group())
        group.count += 1
        if self._named < MOST_NAMED and len(group.named) < MOST_NAMED_FOR_ONE:
            self._named += 1
            group.named.append(displayed(name))

    def add_tool_folder(self, path: str, files: int) -> None:
        """Note a folder that a tool has made, with so many more of its files."""
        if path in self._tool_folders or len(self._tool_folders) < MOST_NAMED_FOR_ONE:
            self._tool_folders[path] = self._tool_folders.get(path, 0) + files
        elif files:
            self._groups.setdefault(_BY_TOOL, _Group()).count += files

    def lines(self) -> tuple[str, ...]:
        """Return a line for each that was left out; for those that would be too many, one for each reason."""
        lines = [_folder_line(path, files) for path, files in sorted(self._tool_folders.items())]
        for reason, group in self._groups.items():
            lines += [f"{name}: {reason}" for name in group.named]
            if more := group.count - len(group.named):
                lines.append(f"and {more:,} more: {reason}" if group.named else f"{more:,} files: {reason}")
        return tuple(lines)


def _folder_line(path: str, files: int) -> str:
    amount = f", with {files:,} file{'s' if files > 1 else ''}" if files else ""
    return f"{displayed(path)}/: {_BY_TOOL}{amount}"
