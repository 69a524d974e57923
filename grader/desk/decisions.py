"""The decisions of a class, read from and written to `overrides.yaml`; the desk and the file always agree.

A decision is written to the file before anything else happens. The results are updated afterwards, in a process of their
own (`Desk.settle`). Nothing is lost if the desk is stopped in between, because outdated results are found again.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import re
import signal
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

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

_POINTS = re.compile(r"[-+]?[0-9]{1,9}(\.[0-9]{0,9})?")
#: Previous reasons, and previous comments, that are offered.
_MOST_OFFERED = 9
#: Names that a message lists.
_MOST_NAMED = 3


def _typed(value: Any) -> Any:
    """Read points as a person types them, also with a decimal comma."""
    text = str(value).strip().replace(",", ".")
    if not _POINTS.fullmatch(text):
        raise ValueError(f"{value!r} is not a number of points; enter a number such as 2.5")
    return text


#: Points in a decision.
TypedPoints = Annotated[Decimal, BeforeValidator(_typed)]


class Decision(BaseModel):
    """A decision at the desk about one part of one submission or several, by the names of their folders."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    names: tuple[str, ...] = Field(min_length=1, max_length=10_000)
    level: Literal["check", "criterion", ""]
    id: str = Field(max_length=500)
    change: Literal["set", "add", "excused", "reviewed", "appeal"]
    points: TypedPoints | None = None
    comment: str = Field("", max_length=20_000)
    reason: str = Field("", max_length=5_000)
    #: State of the part that the person saw, by name; submissions without a name here were not seen.
    seen: Mapping[str, str] = Field(default_factory=dict)


class ChangedSince(UsageError):
    """Raised if another person decided about the same part meanwhile."""


@dataclass(frozen=True)
class Effect:
    """The effect of a decision on one submission: points of the part and of the whole, before and after."""

    name: str
    part: tuple[Decimal, Decimal]
    whole: tuple[Decimal, Decimal]
    text: str
    state: str
    is_decided: bool


@dataclass
class Desk:
    """A class on the desk: its results with all decisions until now."""

    results: Path
    rubric: Rubric
    overrides_file: Path
    who: str
    #: The command line, for the log of replaced results.
    command: str = "review"
    #: Decisions of this desk, in their order.
    written: list[tuple[Decision, dict[str, Any]]] = field(default_factory=list)
    #: Time of change and entry of each folder, by its name as Unicode, because browsers send and show nothing else.
    _entries: dict[str, tuple[int, ClassEntry]] = field(default_factory=dict)
    _settling: Any = None
    #: The overrides as they were read last.
    _read: Overrides = field(default_factory=Overrides)
    #: Hash of the overrides that were last applied to each submission.
    _tried: dict[str, str] = field(default_factory=dict)

    # -- results and decisions ------------------------------------------------------------------

    def overrides(self) -> Overrides:
        """Read the file; raises RubricError with all its mistakes."""
        if not self.overrides_file.exists():
            return Overrides(name=self.overrides_file.name)
        if hashlib.sha256(self.overrides_file.read_bytes()).hexdigest() != self._read.sha256:
            self._read = load_overrides(self.overrides_file, self.rubric)
        return self._read

    def judged(self, overrides: Overrides | None = None) -> dict[str, Result]:
        """Return the results with all decisions, by the names of their folders."""
        decided = self.overrides() if overrides is None else overrides
        found: dict[str, Result] = {}
        for name, entry, result in self._graded():
            found[name] = self._adjusted(entry, result, decided)
        return found

    def queue(self) -> list[Item]:
        """Return open and answered questions."""
        return queue_of(self.judged(), self.rubric)

    def offered(self) -> dict[str, list[str]]:
        """Return previous reasons and comments, the most frequent first."""
        reasons: Counter[str] = Counter()
        comments: Counter[str] = Counter()
        for entry in reversed(self.overrides().entries):
            reasons[entry.reason or ""] += 1
            comments[entry.comment or ""] += 1
        return {"reasons": _most_common(reasons), "comments": _most_common(comments)}

    def folder_of(self, name: str) -> Path:
        """Return the folder of a judged submission."""
        _, entry = self._entries[name]
        return self.results / entry.name

    def _graded(self) -> Iterator[tuple[str, ClassEntry, Result]]:
        """Yield the submissions with a result, after reading new and changed results."""
        times_ns: dict[str, int] = {}
        for path in self.results.glob(f"*/{RESULT_FILE}"):
            times_ns[readable(path.parent.name)] = path.stat().st_mtime_ns
        read_ns = {name: self._time_ns(name) for name in times_ns}
        if read_ns != times_ns:
            self._entries = {}
            for entry in entries_in(self.results):
                name = readable(entry.name)
                self._entries[name] = (times_ns.get(name, 0), entry)
        for name, (_, entry) in self._entries.items():
            if entry.result is not None:
                yield name, entry, entry.result

    def _time_ns(self, name: str) -> int:
        """Return the time at which a result that was read had changed; 0 for a new one."""
        if name not in self._entries:
            return 0
        return self._entries[name][0]

    def _adjusted(self, entry: ClassEntry, result: Result, decided: Overrides) -> Result:
        """Return a result with the decisions about it."""
        policy = self.rubric.policy
        time = policy.zoned(entry.submission_time)
        return adjust(result, decided.of(result.submission), policy.late, time)

    # -- decisions ------------------------------------------------------------------------------

    def preview(self, decision: Decision) -> list[Effect]:
        """Return the effects of a decision without writing it; raises RubricError if it is impossible."""
        text = ""
        if self.overrides_file.exists():
            text = self.overrides_file.read_text(encoding="utf-8")
        before = self.judged()
        new_text = with_entry(text, self._entry(decision, before))
        after = self.judged(parse_overrides(self.overrides_file, new_text, self.rubric))
        return [self._effect(name, decision, before[name], after[name]) for name in decision.names]

    def decide(self, decision: Decision) -> None:
        """Write a decision; raises ChangedSince if another person decided about its part after it was shown."""
        with locked(self.overrides_file.parent):
            before = self.judged()
            entry = self._entry(decision, before)
            _require_unchanged(decision, before)
            rewrite(self.overrides_file, lambda text: self._fitting(with_entry(text, entry)))
        self.written.append((decision, entry))

    def undo(self) -> Decision:
        """Take back the last decision of this desk, unless another person has done so; returns the decision."""
        if not self.written:
            raise UsageError(
                "there is nothing to take back", remedy="Only what this desk has decided can be."
            )
        decision, entry = self.written[-1]
        with locked(self.overrides_file.parent):
            alone = parse_overrides(self.overrides_file, with_entry("", entry), self.rubric)
            wanted = alone.entries[0]
            listed = list(self.overrides().entries)
            if wanted in listed:
                rewrite(self.overrides_file, lambda text: without_entry(text, listed.index(wanted)))
        self.written.pop()
        return decision

    def _entry(self, decision: Decision, results: Mapping[str, Result]) -> dict[str, Any]:
        """Return a decision as an entry of the file."""
        unknown = [name for name in decision.names if name not in results]
        if unknown:
            raise UsageError(
                f"there is no submission {unknown[0]!r}",
                remedy="Choose from those that were graded.",
            )
        names = [results[name].submission for name in decision.names]
        comment = _line(decision.comment)
        given: dict[str, Any] = {"submission": names}
        if len(names) == 1:
            given["submission"] = names[0]
        if decision.level:
            given[decision.level] = decision.id
        if decision.change == "appeal":
            given["appeal"] = comment
        elif decision.change in ("excused", "reviewed"):
            given[decision.change] = True
        elif decision.points is not None:
            given[decision.change] = number(decision.points)
        if decision.change != "appeal":
            given["comment"] = comment
        given["reason"] = _line(decision.reason)
        given["who"] = self.who
        given["when"] = f"{datetime.now():%Y-%m-%d %H:%M}"
        return {key: value for key, value in given.items() if value != ""}

    def _fitting(self, text: str) -> str:
        """Return a text if it can be applied; raises RubricError with its mistakes."""
        parse_overrides(self.overrides_file, text, self.rubric)
        return text

    def _effect(self, name: str, decision: Decision, before: Result, after: Result) -> Effect:
        part = decision.id or WHOLE
        reasons: dict[str, None] = {}
        for criterion in before.criteria:
            for check in criterion.checks:
                if check.reason and decision.id in (check.id, criterion.id):
                    reasons[check.reason] = None
        is_decided = False
        for adjustment in before.adjustments:
            if adjustment.what == part and adjustment.kind in ANSWERS:
                is_decided = True
        earned = (_earned(before, decision), _earned(after, decision))
        final = (before.final, after.final)
        state = state_of(before, part)
        return Effect(name, earned, final, " ".join(reasons), state, is_decided)

    # -- updating the results -------------------------------------------------------------------

    def stale(self) -> dict[str, str]:
        """Return the submissions with outdated results, with the hash of the decisions."""
        decided = self.overrides()
        found: dict[str, str] = {}
        for name, entry, result in self._graded():
            adjusted = self._adjusted(entry, result, decided)
            if adjusted.adjustments != result.adjustments:
                found[name] = decided.sha256
        return found

    def settle(self) -> dict[str, list[str]]:
        """Update outdated results in a process of its own; to be called until no submission is waiting.

        Returns the waiting submissions, and those with results that could not be written.
        """
        running = self._settling is not None and self._settling.is_alive()
        stale = self.stale()
        waiting: dict[str, str] = {}
        for name, sha256 in stale.items():
            if self._tried.get(name) != sha256:
                waiting[name] = sha256
        if not running and waiting:
            folders = [self.folder_of(name) for name in waiting]
            # The fork has no threads, and ends by itself, even if this process is killed.
            context = multiprocessing.get_context("fork")
            arguments = (folders, self.overrides_file, self.command)
            self._settling = context.Process(target=_write, args=arguments)
            self._settling.start()
            self._tried |= waiting
            running = True
        if running:
            return {"waiting": sorted(stale), "failed": []}
        return {"waiting": [], "failed": sorted(stale)}

    def close(self) -> list[str]:
        """Wait until all results are updated; returns submissions with results that could not be written."""
        while self.settle()["waiting"]:
            self._settling.join()
        return self.settle()["failed"]


def _most_common(texts: Counter[str]) -> list[str]:
    """Return the most frequent texts, without the empty one."""
    del texts[""]
    return [text for text, _ in texts.most_common(_MOST_OFFERED)]


def _require_unchanged(decision: Decision, results: Mapping[str, Result]) -> None:
    """Raise ChangedSince if the state of a part is not the one that the person saw."""
    part = decision.id or WHOLE
    changed = []
    for name, state in decision.seen.items():
        if name in results and state_of(results[name], part) != state:
            changed.append(name)
    if changed:
        named = ", ".join(changed[:_MOST_NAMED])
        raise ChangedSince(
            f"somebody has decided of this meanwhile: {named}",
            remedy="Look at what was decided, and decide again if you still want to.",
        )


def _earned(result: Result, decision: Decision) -> Decimal:
    part = part_of(result, decision.level, decision.id)
    return part.earned if part is not None else Decimal(0)


def _write(folders: list[Path], overrides: Path, command: str) -> None:
    """Judge submissions again with the overrides, in a process of its own."""
    from grader.classroom.regrade import regrade

    # At Ctrl-C, the desk waits for this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        file = overrides if overrides.exists() else None
        regrade(folders, overrides=file, pages=True, again=False, jobs=1).apply(command)
    except GraderError:
        # The desk reports the outdated results.
        raise SystemExit(1) from None


def _line(text: str) -> str:
    """Return a text in one line, without characters that cannot be written."""
    return " ".join(text.encode("utf-8", "replace").decode("utf-8").split())
