"""A class without names: pseudonyms, and texts of students with all names hidden."""

from __future__ import annotations

import hashlib
import hmac
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from grader.cohort.entries import ClassEntry
from grader.lab.rubric import Rubric
from grader.result import BY_HAND, Adjustment, CheckResult, CriterionResult, Result, Violation

HIDDEN = "‹name›"
#: Shortest parts of a name, in letters and in digits, that are hidden.
LEAST_LETTERS, LEAST_DIGITS = 3, 4
#: Length from which names are hidden within a word, too. Shorter names must stand alone.
LEAST_WITHIN_A_WORD = 4
#: Length from which names in scripts without blanks between words are hidden everywhere.
LEAST_UNPARTED = 2
#: ASCII spellings of letters in names of files and nodes.
_SPELT = str.maketrans(
    {"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "å": "aa", "ø": "oe", "æ": "ae"}
)


def anonymous(entries: Sequence[ClassEntry], rubric: Rubric) -> list[ClassEntry]:
    """Return the entries under pseudonyms, and in their order.

    The pseudonyms are numbers, ordered by a keyed hash of the names. The key comes from the hashes of the submissions,
    because a list of the class must not be enough to find the order again. A result keeps only outcomes, points and
    the grader's own texts. Names of students, and parts of them, are hidden in these texts unless the part is a word
    of the rubric.
    """
    key = _key_of(entries)
    digests = []
    for place, entry in enumerate(entries):
        name = entry.name.encode("utf-8", "surrogatepass")
        digests.append((hmac.digest(key, name, "sha256"), place))
    digits = max(2, len(str(len(entries))))
    hide = _Hider(entries, rubric)
    hidden = []
    for number, (_, place) in enumerate(sorted(digests), 1):
        pseudonym = f"Student {number:0{digits}d}"
        hidden.append(_hidden(entries[place], pseudonym, hide))
    return hidden


def _key_of(entries: Iterable[ClassEntry]) -> bytes:
    """Return a key that only the submissions themselves give."""
    hashes = []
    for entry in entries:
        submitted = ""
        if entry.result:
            submitted = entry.result.provenance.get("submission_sha256", "")
        hashes.append(submitted)
    return hashlib.sha256("\n".join(sorted(hashes)).encode()).digest()


# -- a result ----------------------------------------------------------------------------------


def _hidden(entry: ClassEntry, pseudonym: str, hide: _Hider) -> ClassEntry:
    """Return an entry without quotes from the submission and without further signs of its author."""
    result = entry.result
    if result is None:
        return ClassEntry(pseudonym, None, hide(entry.problem))
    hidden = Result(
        submission=pseudonym,
        lab=result.lab,
        score=result.score,
        criteria=_without_quotes(result.criteria, hide),
        bonus=_without_quotes(result.bonus, hide),
        problems=tuple(map(hide, result.problems)),
        violations=_hidden_violations(result.violations, hide),
        adjustments=tuple(map(_hidden_adjustment, result.adjustments)),
        provenance={"rubric_sha256": result.rubric_sha256, "lab_sha256": result.lab_sha256},
    )
    return ClassEntry(pseudonym, hidden)


def _hidden_violations(violations: Iterable[Violation], hide: _Hider) -> tuple[Violation, ...]:
    hidden = []
    for violation in violations:
        text = hide(violation.text)
        kind, session, certain = violation.kind, violation.session, violation.certain
        hidden.append(Violation(kind, session, text, certain=certain))
    return tuple(hidden)


def _hidden_adjustment(adjustment: Adjustment) -> Adjustment:
    """Return an adjustment; only one by hand keeps its subject, because the others name parts of the submission."""
    subject = adjustment.what if adjustment.kind in BY_HAND else ""
    return Adjustment(adjustment.kind, subject, adjustment.points)


def _without_quotes(
    criteria: Sequence[CriterionResult], hide: _Hider
) -> tuple[CriterionResult, ...]:
    hidden = []
    for criterion in criteria:
        checks = [_unquoted(check, hide) for check in criterion.checks]
        hidden.append(replace(criterion, checks=tuple(checks)))
    return tuple(hidden)


def _unquoted(check: CheckResult, hide: _Hider) -> CheckResult:
    unmeasured = None
    if check.unmeasured:
        unmeasured = hide(check.unmeasured)
    reason = hide(check.reason)
    hint = hide(check.hint)
    hidden = replace(check, reason=reason, hint=hint, unmeasured=unmeasured)
    return replace(hidden, expected="", measured="", where=(), notes=(), counted=())


# -- names -------------------------------------------------------------------------------------


class _Hider:
    """Hides the names of a class in texts: whole names, and their parts except words of the rubric."""

    def __init__(self, entries: Iterable[ClassEntry], rubric: Rubric) -> None:
        words = re.findall(r"[^\W_]+", _plain(rubric.text))
        known = {word.lower() for word in words}
        wanted: set[str] = set()
        for entry in entries:
            for name in _names(entry):
                wanted |= _spellings(name, known)
        ordered = sorted(wanted, key=lambda name: (-len(name), name))
        pattern = "|".join(map(_matching, ordered)) or "(?!)"
        self._pattern = re.compile(pattern, re.IGNORECASE)

    def __call__(self, text: str) -> str:
        """Return a text without names."""
        text = unicodedata.normalize("NFC", text)
        parts = []
        end = 0
        for match in self._pattern.finditer(_plain(text)):
            parts += [text[end : match.start()], HIDDEN]
            end = match.end()
        parts.append(text[end:])
        return "".join(parts)


def _names(entry: ClassEntry) -> Iterator[str]:
    """Yield the names, ids, logins and mail names of a submission's authors."""
    names = [entry.name, entry.student_id]
    for person in entry.people:
        mail_name, _, _ = person.email.partition("@")
        names += [person.name, person.student_id, person.login, mail_name]
    for name in names:
        if name:
            yield name


def _spellings(name: str, known: set[str]) -> set[str]:
    """Return a name with and without ASCII spellings, and its parts that are not known words."""
    lowered = unicodedata.normalize("NFC", name).lower()
    found = set()
    for spelling in (_plain(lowered), _plain(lowered.translate(_SPELT))):
        parts = set(_parts(spelling))
        found |= {spelling} | (parts - known)
    return found


def _parts(name: str) -> list[str]:
    """Return the words and numbers in a name that are long enough to be hidden."""
    parts = []
    for word in re.findall(r"[^\W\d_]+", name):
        least = LEAST_UNPARTED if _is_unparted(word) else LEAST_LETTERS
        if len(word) >= least:
            parts.append(word)
    for number in re.findall(r"\d+", name):
        if len(number) >= LEAST_DIGITS:
            parts.append(number)
    return parts


def _matching(name: str) -> str:
    """Return the pattern of a name; a short one must stand alone, or as a word in camel case (`startEva`)."""
    unparted = len(name) >= LEAST_UNPARTED and _is_unparted(name)
    if unparted or len(name) >= LEAST_WITHIN_A_WORD:
        return re.escape(name)
    before = r"(?:(?<![^\W_])|(?-i:(?<=[a-z0-9])(?=[A-Z])))"
    after = r"(?:(?![^\W_])|(?-i:(?=[A-Z])))"
    return f"{before}{re.escape(name)}{after}"


def _is_unparted(name: str) -> bool:
    """Return whether a name has only Chinese, Japanese or Korean letters, with no blank to the next word."""
    return all(unicodedata.east_asian_width(character) == "W" for character in name)


def _plain(text: str) -> str:
    """Return a text with letters without their marks: `Zoë` becomes `Zoe`.

    Each letter stays one character, to keep all positions. A Korean syllable stays whole, because hundreds of syllables
    have the same first part.
    """
    plain = []
    for character in text:
        base = unicodedata.normalize("NFKD", character)[0]
        korean = "\u1100" <= base <= "\u11ff"
        plain.append(character if korean else base)
    return "".join(plain)
