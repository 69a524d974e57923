"""A class without names: pseudonyms instead, and nothing left of the names in what students wrote."""

from __future__ import annotations

import hashlib
import hmac
import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import replace

from grader.cohort.entries import ClassEntry
from grader.lab.rubric import Rubric
from grader.result import BY_HAND, Adjustment, CheckResult, CriterionResult, Result, Violation

HIDDEN = "‹name›"
#: Shortest parts of a name, in letters and in digits, that are hidden.
LEAST_LETTERS, LEAST_DIGITS = 3, 4
#: Names below this length are hidden only where they stand alone, not within a word.
LEAST_WITHIN_A_WORD = 4
#: Names in scripts that are written without blanks are hidden from this length, wherever they stand.
LEAST_UNPARTED = 2
#: How letters that plain ASCII lacks are written in names of files and nodes.
_SPELT = str.maketrans(
    {"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "å": "aa", "ø": "oe", "æ": "ae"}
)


def anonymous(entries: Sequence[ClassEntry], rubric: Rubric) -> list[ClassEntry]:
    """Return the entries under pseudonyms, in the order of these; the rubric's words are no names, even in one.

    Pseudonyms are numbers in an order that a keyed hash of the names gives. The key comes from the hashes of what was
    handed in, so that a list of the class is not enough to find the order again. Of a result only outcomes, points and
    what the grader says of them stay, in which names, and parts of them, are hidden.
    """
    submitted = (
        entry.result.provenance.get("submission_sha256", "") if entry.result else ""
        for entry in entries
    )
    key = hashlib.sha256("\n".join(sorted(submitted)).encode()).digest()
    names = [entry.name.encode("utf-8", "surrogatepass") for entry in entries]
    order = sorted(range(len(entries)), key=lambda n: (hmac.digest(key, names[n], "sha256"), n))
    digits = max(2, len(str(len(entries))))
    hide = _Hider(entries, rubric)
    return [
        _hidden(entries[index], f"Student {rank:0{digits}d}", hide)
        for rank, index in enumerate(order, 1)
    ]


def _hidden(entry: ClassEntry, pseudonym: str, hide: _Hider) -> ClassEntry:
    """Return an entry without what its checks quote of the submission, and what else might tell whose it is."""
    result = entry.result
    if result is None:
        return ClassEntry(pseudonym, None, hide(entry.problem))
    hidden = Result(
        submission=pseudonym,
        lab=result.lab,
        score=result.score,
        criteria=_without_quotes(result.criteria, hide),
        bonus=_without_quotes(result.bonus, hide),
        problems=tuple(hide(problem) for problem in result.problems),
        violations=tuple(
            Violation(v.kind, v.session, hide(v.text), certain=v.certain) for v in result.violations
        ),
        adjustments=tuple(
            Adjustment(each.kind, each.what if each.kind in BY_HAND else "", each.points)
            for each in result.adjustments
        ),
        provenance={"rubric_sha256": result.rubric_sha256, "lab_sha256": result.lab_sha256},
    )
    return ClassEntry(pseudonym, hidden)


def _without_quotes(
    criteria: Sequence[CriterionResult], hide: _Hider
) -> tuple[CriterionResult, ...]:
    return tuple(
        replace(c, checks=tuple(_unquoted(check, hide) for check in c.checks)) for c in criteria
    )


def _unquoted(check: CheckResult, hide: _Hider) -> CheckResult:
    bare = replace(check, expected="", measured="", where=(), notes=(), counted=())
    unmeasured = hide(check.unmeasured) if check.unmeasured else None
    return replace(bare, reason=hide(check.reason), hint=hide(check.hint), unmeasured=unmeasured)


class _Hider:
    """Hides the names of a class in texts: whole ones, and parts that are no words of the rubric."""

    def __init__(self, entries: Iterable[ClassEntry], rubric: Rubric) -> None:
        known = {word.lower() for word in re.findall(r"[^\W_]+", _plain(rubric.text))}
        wanted: set[str] = set()
        for name in filter(None, (text for entry in entries for text in _names(entry))):
            lowered = unicodedata.normalize("NFC", name).lower()
            for spelling in (_plain(lowered), _plain(lowered.translate(_SPELT))):
                wanted |= {spelling, *(part for part in _parts(spelling) if part not in known)}
        ordered = sorted(wanted, key=lambda name: (-len(name), name))
        self._pattern = re.compile("|".join(map(_matching, ordered)) or "(?!)", re.IGNORECASE)

    def __call__(self, text: str) -> str:
        """Return a text without names."""
        text = unicodedata.normalize("NFC", text)
        parts, at = [], 0
        for match in self._pattern.finditer(_plain(text)):
            parts += [text[at : match.start()], HIDDEN]
            at = match.end()
        return "".join([*parts, text[at:]])


def _names(entry: ClassEntry) -> list[str | None]:
    """Return all by which those who handed something in are known, but for numbers that mean nothing elsewhere."""
    people = (
        (who.name, who.student_id, who.login, who.email.partition("@")[0]) for who in entry.people
    )
    return [entry.name, entry.student_id, *(name for names in people for name in names)]


def _parts(name: str) -> list[str]:
    letters = [
        part
        for part in re.findall(r"[^\W\d_]+", name)
        if len(part) >= (LEAST_UNPARTED if _is_unparted(part) else LEAST_LETTERS)
    ]
    return letters + [part for part in re.findall(r"\d+", name) if len(part) >= LEAST_DIGITS]


def _matching(name: str) -> str:
    """Return the pattern of a name; a short one has to stand alone, be it as a word of a name in camel case."""
    if len(name) >= LEAST_WITHIN_A_WORD or (len(name) >= LEAST_UNPARTED and _is_unparted(name)):
        return re.escape(name)
    before = r"(?:(?<![^\W_])|(?-i:(?<=[a-z0-9])(?=[A-Z])))"
    after = r"(?:(?![^\W_])|(?-i:(?=[A-Z])))"
    return f"{before}{re.escape(name)}{after}"


def _is_unparted(name: str) -> bool:
    """Whether a name is of Chinese, Japanese or Korean letters, to which other words are joined without a blank."""
    return all(unicodedata.east_asian_width(character) == "W" for character in name)


def _plain(text: str) -> str:
    """Return a text with letters without their marks; each stays one character, so that places stay the same.

    A Korean syllable stays whole: of its parts, the first alone is that of hundreds.
    """
    first = (unicodedata.normalize("NFKD", character)[0] for character in text)
    return "".join(
        old if "\u1100" <= new <= "\u11ff" else new for old, new in zip(text, first, strict=True)
    )
