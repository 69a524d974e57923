"""The decisions of a class: read from and written to `overrides.yaml`, so that the desk and the file are one thing.

The file is the truth: what is decided stands in it before anything else happens. The results follow it, in a process of
their own (`Desk.settle`); whoever is stopped in between loses nothing, since what lags behind is found again.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import signal
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from decimal import Decimal
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from grader.cohort.entries import ClassEntry, entries_in
from grader.desk.queue import Item, part_of, queue_of, state_of
from grader.errors import GraderError, UsageError
from grader.json_text import readable
from grader.judging.adjust import adjust
from grader.lab.overrides import Overrides, load_overrides, parse_overrides
from grader.lab.overrides_text import locked, rewrite, with_entry, without_entry
from grader.lab.rubric import Rubric
from grader.result import ANSWERS, WHOLE, Result, number
from grader.result_folder import RESULT_FILE

#: Of reasons and comments that were used before.
_MOST_OFFERED = 9


class Decision(BaseModel):
    """What a person decides at the desk: one thing, for one submission or several, by the names of their folders."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    names: tuple[str, ...] = Field(min_length=1, max_length=10_000)
    level: Literal["check", "criterion", ""]
    id: str = Field(max_length=500)
    change: Literal["set", "add", "excused", "reviewed", "appeal"]
    points: Decimal | None = None
    comment: str = Field("", max_length=20_000)
    reason: str = Field("", max_length=5_000)
    #: By name, the state of the part that whoever decides has seen; a name that is not there was not looked at.
    seen: Mapping[str, str] = Field(default_factory=dict)


class ChangedSince(UsageError):
    """Somebody has decided of the same meanwhile."""


@dataclass(frozen=True)
class Effect:
    """What a decision does to the points of one submission: of the part, and of the whole."""

    name: str
    part: tuple[Decimal, Decimal]
    whole: tuple[Decimal, Decimal]
    text: str
    state: str
    is_decided: bool


@dataclass
class Desk:
    """A class on the desk: its results with what people decided until now."""

    results: Path
    rubric: Rubric
    overrides_file: Path
    who: str
    #: The command that was given, for the trail of replaced results.
    command: str = "review"
    #: What this desk has written, the last one last.
    written: list[tuple[Decision, dict[str, Any]]] = field(default_factory=list)
    #: By the folder's name, as text: a browser neither sends nor shows what is no Unicode.
    _entries: dict[str, tuple[int, ClassEntry]] = field(default_factory=dict)
    _settling: Any = None
    #: What was read of the file last.
    _read: Overrides = field(default_factory=Overrides)
    _tried: dict[str, str] = field(default_factory=dict)

    # -- what there is --------------------------------------------------------------------------

    def overrides(self) -> Overrides:
        """Read the file; raises RubricError with all its mistakes."""
        if not self.overrides_file.exists():
            return Overrides(name=self.overrides_file.name)
        if hashlib.sha256(self.overrides_file.read_bytes()).hexdigest() != self._read.sha256:
            self._read = load_overrides(self.overrides_file, self.rubric)
        return self._read

    def judged(self, overrides: Overrides | None = None) -> dict[str, Result]:
        """Return the results as they are with what people decided, by the names of their folders."""
        decided = self.overrides() if overrides is None else overrides
        return {name: self._adjusted(entry, decided) for name, entry in self._graded()}

    def queue(self) -> list[Item]:
        """Return what is to be decided, and what has been."""
        return queue_of(self.judged(), self.rubric)

    def offered(self) -> dict[str, list[str]]:
        """Return reasons and comments that were used before, the most frequent first."""
        entries = self.overrides().entries
        used = {
            "reasons": Counter(entry.reason for entry in reversed(entries) if entry.reason),
            "comments": Counter(entry.comment for entry in reversed(entries) if entry.comment),
        }
        return {
            kind: [text for text, _ in texts.most_common(_MOST_OFFERED)]
            for kind, texts in used.items()
        }

    def folder_of(self, name: str) -> Path:
        """Return the folder of a submission that was judged."""
        return self.results / self._entries[name][1].name

    def _graded(self) -> Iterable[tuple[str, ClassEntry]]:
        """Read results that are new or have changed."""
        changed = {
            readable(p.parent.name): p.stat().st_mtime_ns
            for p in self.results.glob(f"*/{RESULT_FILE}")
        }
        if any(self._entries.get(name, (0,))[0] != time for name, time in changed.items()):
            named = ((readable(entry.name), entry) for entry in entries_in(self.results))
            self._entries = {name: (changed.get(name, 0), entry) for name, entry in named}
        return [
            (name, entry) for name, (_, entry) in self._entries.items() if entry.result is not None
        ]

    def _adjusted(self, entry: ClassEntry, decided: Overrides) -> Result:
        assert entry.result is not None
        of = decided.of(entry.result.submission)
        policy = self.rubric.policy
        return adjust(entry.result, of, policy.late, policy.zoned(entry.submission_time))

    # -- decisions ------------------------------------------------------------------------------

    def preview(self, decision: Decision) -> list[Effect]:
        """Return what a decision would do, and writes nothing; raises RubricError if it is not possible."""
        text = (
            self.overrides_file.read_text(encoding="utf-8") if self.overrides_file.exists() else ""
        )
        before = self.judged()
        new = parse_overrides(
            self.overrides_file, with_entry(text, self._entry(decision, before)), self.rubric
        )
        after = self.judged(new)
        return [self._effect(name, decision, before[name], after[name]) for name in decision.names]

    def decide(self, decision: Decision) -> None:
        """Write a decision; raises ChangedSince if somebody has decided of it since it was looked at."""
        with locked(self.overrides_file.parent):
            before = self.judged()
            entry = self._entry(decision, before)
            part = decision.id or WHOLE
            changed = [
                n
                for n, state in decision.seen.items()
                if n in before and state_of(before[n], part) != state
            ]
            if changed:
                problem = f"somebody has decided of this meanwhile: {', '.join(changed[:3])}"
                raise ChangedSince(
                    problem,
                    remedy="Look at what was decided, and decide again if you still want to.",
                )
            rewrite(self.overrides_file, lambda text: self._fitting(with_entry(text, entry)))
        self.written.append((decision, entry))

    def undo(self) -> Decision:
        """Take back what this desk decided last, unless somebody else has done so; returns the decision."""
        if not self.written:
            raise UsageError(
                "there is nothing to take back", remedy="Only what this desk has decided can be."
            )
        decision, entry = self.written[-1]
        with locked(self.overrides_file.parent):
            wanted = parse_overrides(
                self.overrides_file, with_entry("", entry), self.rubric
            ).entries[0]
            listed = list(self.overrides().entries)
            if wanted in listed:
                rewrite(self.overrides_file, lambda text: without_entry(text, listed.index(wanted)))
        self.written.pop()
        return decision

    def _entry(self, decision: Decision, results: Mapping[str, Result]) -> dict[str, Any]:
        """Return a decision as it stands in the file."""
        unknown = [name for name in decision.names if name not in results]
        if unknown:
            raise UsageError(
                f"there is no submission {unknown[0]!r}",
                remedy="Choose from those that were graded.",
            )
        names = [results[name].submission for name in decision.names]
        value: Any = number(decision.points) if decision.points is not None else None
        changes = {"excused": True, "reviewed": True, "appeal": _line(decision.comment)}
        given = {
            "submission": names if len(names) > 1 else names[0],
            decision.level: decision.id if decision.level else None,
            decision.change: changes.get(decision.change, value),
            "comment": _line(decision.comment) if decision.change != "appeal" else None,
            "reason": _line(decision.reason),
            "who": self.who,
            "when": f"{datetime.now():%Y-%m-%d %H:%M}",
        }
        return {key: value for key, value in given.items() if value not in (None, "")}

    def _fitting(self, text: str) -> str:
        """Return a text that can be applied; raises RubricError with its mistakes."""
        parse_overrides(self.overrides_file, text, self.rubric)
        return text

    def _effect(self, name: str, decision: Decision, before: Result, after: Result) -> Effect:
        parts = [part_of(result, decision.level, decision.id) for result in (before, after)]
        earned = [part.earned if part is not None else Decimal(0) for part in parts]
        concerned = [
            c for part in before.criteria for c in part.checks if decision.id in (c.id, part.id)
        ]
        text = " ".join(dict.fromkeys(check.reason for check in concerned if check.reason))
        decided = any(
            a.what == (decision.id or WHOLE) and a.kind in ANSWERS for a in before.adjustments
        )
        state = state_of(before, decision.id or WHOLE)
        return Effect(
            name, (earned[0], earned[1]), (before.final, after.final), text, state, decided
        )

    # -- the results follow ---------------------------------------------------------------------

    def stale(self) -> dict[str, str]:
        """Return whose result does not have what was decided, with the hash of what was."""
        decided = self.overrides()
        return {
            name: decided.sha256
            for name, entry in self._graded()
            if entry.result is not None
            and self._adjusted(entry, decided).adjustments != entry.result.adjustments
        }

    def settle(self) -> dict[str, list[str]]:
        """Have results follow the file, in a process of its own; returns who waits, and whose was not written.

        To be called until nobody is waiting.
        """
        running = self._settling is not None and self._settling.is_alive()
        stale = self.stale()
        waiting = {
            name: sha256 for name, sha256 in stale.items() if self._tried.get(name) != sha256
        }
        if not running and waiting:
            folders = [self.folder_of(name) for name in waiting]
            # A copy of this process, which has no threads: it ends by itself, also where this one is killed.
            context = multiprocessing.get_context("fork")
            self._settling = context.Process(
                target=_write, args=(folders, self.overrides_file, self.command)
            )
            self._settling.start()
            self._tried |= waiting
            running = True
        return {
            "waiting": sorted(stale) if running else [],
            "failed": [] if running else sorted(stale),
        }

    def close(self) -> list[str]:
        """Wait until the results have followed; returns whose could not be written."""
        while self.settle()["waiting"]:
            self._settling.join()
        return self.settle()["failed"]


def _write(folders: list[Path], overrides: Path, command: str) -> None:
    from grader.classroom.regrade import regrade

    # Ctrl-C ends the desk, which then waits for this.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        file = overrides if overrides.exists() else None
        regrade(folders, overrides=file, pages=True, again=False, jobs=1).apply(command)
    except GraderError:
        raise SystemExit(1) from None  # The desk says whose result does not follow.


def _line(text: str) -> str:
    """Return a text in one line, without what cannot be written."""
    return " ".join(text.encode("utf-8", "replace").decode("utf-8").split())
