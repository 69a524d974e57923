"""Which mistakes a class made: lost points grouped by check and by what went wrong, whatever the names and numbers.

Two students made the same mistake if the same check gives the same first sentence of its reason and of its hint
once numbers, names and quoted parts are left out of both. What could not be reached because of a mistake is
added to what that mistake cost.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal

from grader.lab.rubric import Rubric
from grader.result import CheckResult, Result

MOST_VALUES = 3
MOST_CHARACTERS = 2000


@dataclass(frozen=True)
class Made:
    """One student's share in a mistake."""

    #: Place of the student in the class, from 0.
    row: int
    #: Points that the check itself cost, and those of checks that could not be reached because of it.
    lost: Decimal
    following: Decimal


@dataclass(frozen=True)
class Mistake:
    """The same mistake of some students."""

    #: The check that it failed at.
    check_id: str
    #: What went wrong; where the students' reasons differ in numbers, their span, else some of the names.
    pattern: str
    #: How to fix it: what students were told.
    hint: str
    #: Points over all of these students, as in `Made`.
    lost: Decimal
    following: Decimal
    #: Whom it cost most first.
    made_by: tuple[Made, ...]

    @property
    def cost(self) -> Decimal:
        """All points that it cost."""
        return self.lost + self.following


def mistakes_of(results: Mapping[int, Result], rubric: Rubric) -> tuple[Mistake, ...]:
    """Group what was lost by those that were graded, by their place in the class, the dearest mistake first."""
    groups: dict[tuple[str, str, str], list[tuple[Made, CheckResult]]] = {}
    for row, result in results.items():
        following = _following(result)
        for check in result.checks:
            if check.lost > 0 and check.id in following:
                made = Made(row, check.lost, following[check.id])
                key = (check.id, gist(check.reason), gist(check.hint))
                groups.setdefault(key, []).append((made, check))
    order = {check.id: n for n, check in enumerate(rubric.checks())}
    found = [_mistake(members) for members in groups.values()]
    return tuple(
        sorted(
            found,
            key=lambda m: (-m.cost, -len(m.made_by), order.get(m.check_id, len(order)), m.pattern),
        )
    )


def _mistake(members: Sequence[tuple[Made, CheckResult]]) -> Mistake:
    made = sorted((m for m, _ in members), key=lambda m: (-m.lost - m.following, m.row))
    return Mistake(
        members[0][1].id,
        pattern_of([check.reason for _, check in members]),
        _commonest([check.hint for _, check in members]),
        sum((m.lost for m in made), Decimal(0)),
        sum((m.following for m in made), Decimal(0)),
        tuple(made),
    )


def _following(result: Result) -> dict[str, Decimal]:
    """Return, for each check that cost points by itself, the points that were out of reach because of it."""
    lost = {check.id: check for check in result.checks if check.lost > 0}
    sums: dict[str, Decimal] = {}
    for check in lost.values():
        cause = check.blocked_by if check.blocked_by in lost else check.id
        sums[cause] = sums.get(cause, Decimal(0)) + (check.lost if cause != check.id else 0)
    return sums


# -- what is the same in different words -------------------------------------------------------

_HOLE = "\ufffc"
_NUMBER = r"[-−+]?\d+(?:[.,]\d+)*(?:[eE][-+]?\d+)?(?:\s?%)?"
_VALUE = re.compile(
    r"(?<!\w)'[^'\n]{0,400}'(?!\w)|\"[^\"\n]{0,400}\"|`[^`\n]{0,400}`|‘[^’\n]{0,400}’|“[^”\n]{0,400}”"  # quoted
    r"|\[[^\[\]\n]{0,400}\]"  # an array, or an index
    r"|(?<![\w/])[~/]\w[\w./{}-]*(?<![.])"  # a ROS name or a path
    r"|(?<!\w)[A-Za-z_]\w*(?:[./]\w+)+(?:\(\))?|(?<!\w)\w+\(\)"  # a file, a type, something of a module, a call
    r"|(?<!\w)(?=\w*[A-Za-z])\w*_\w*"  # an identifier in snake case
    r"|(?<!\w)[A-Z][a-z0-9]+(?:[A-Z][a-z0-9]*)+"  # a class
    r"|(?<=\bnamed )\w+"
    rf"|(?<![\w.]){_NUMBER}"
)
#: Words that look like names of the student's and are not: constants, and kinds of exception.
_WORD = re.compile(r"(?=[A-Z0-9_]*[A-Z])[A-Z0-9_]+|\w*(?:Error|Exception|Warning|Interrupt)")
_END = re.compile(r"[.;?!](?=\s|$)")
_LIST = re.compile(rf"{_HOLE}(?:(?:, and |, or |, | and | or ){_HOLE})+")
#: Words that change with the number of things that are spoken of.
_SINGULAR = {"are": "is", "were": "was", "have": "has", "do": "does"}


def _parts(text: str) -> list[str]:
    """Take a text apart: what stays, a value, what stays, a value, ..., what stays."""
    text = " ".join(text[:MOST_CHARACTERS].split())
    parts, at = [], 0
    for match in _VALUE.finditer(text):
        if not _WORD.fullmatch(match[0]):
            parts += [text[at : match.start()], match[0]]
            at = match.end()
    return [*parts, text[at:]]


def _first_sentence(parts: Sequence[str]) -> list[str]:
    """Cut a text in parts behind its first sentence."""
    for n in range(0, len(parts), 2):
        end = _END.search(parts[n])
        if end is not None:
            return [*parts[:n], parts[n][: end.end()]]
    return list(parts)


def gist(text: str) -> str:
    """Return what is the same in two texts that say the same of different names and numbers.

    It is the first sentence with holes for values, without what is listed behind a colon, lists as one hole,
    and in the singular.
    """
    parts = _first_sentence(_parts(text))
    lead = "".join(_HOLE if n % 2 else part for n, part in enumerate(parts))
    head, colon, tail = lead.partition(": ")
    if colon and _HOLE in tail:
        lead = head
    words = re.findall(rf"\w+|{_HOLE}", _LIST.sub(_HOLE, lead))
    return " ".join(_SINGULAR.get(word.lower(), word.lower()).rstrip("s") for word in words)


def pattern_of(texts: Sequence[str]) -> str:
    """Return one text for several of the same gist, with the span of their numbers and some of their names."""
    whole = [_parts(text) for text in texts]
    for parts in (whole, [_first_sentence(p) for p in whole]):
        if len({tuple(p[::2]) for p in parts}) == 1:
            columns = zip(*parts, strict=True)
            return "".join(
                _together(column) if n % 2 else column[0] for n, column in enumerate(columns)
            )
    heads = {text.partition(": ")[0] for text in texts}
    return f"{heads.pop()}: …" if len(heads) == 1 else f"For example: {_commonest(texts)}"


def _together(values: Sequence[str]) -> str:
    """Return values that stand at the same place: one, the span of numbers, or the commonest ones."""
    distinct = [value for value, _ in Counter(sorted(values)).most_common()]
    if len(distinct) == 1:
        return distinct[0]
    if all(re.fullmatch(_NUMBER, value) for value in distinct):
        by_size = sorted(distinct, key=_number)
        percent = "%" if all(value.endswith("%") for value in distinct) else ""
        return f"{by_size[0].removesuffix(percent)} to {by_size[-1]}"
    more = len(distinct) - MOST_VALUES
    shown = distinct[:MOST_VALUES] if more > 1 else distinct
    return " or ".join(shown) + (f" or {more} others" if more > 1 else "")


def _number(text: str) -> float:
    return float(text.rstrip("% ").replace("−", "-").replace(",", ""))


def _commonest(texts: Sequence[str]) -> str:
    return min(Counter(texts).items(), key=lambda pair: (-pair[1], pair[0]))[0]
