"""Mistakes of a class: lost points grouped by check and by fault, regardless of names and numbers.

Two students made the same mistake if a check gives both the same reason and the same hint, in their first sentences,
once numbers, names and quotes are left out. Points of checks that a mistake blocked are added to its cost.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal

from grader.lab.rubric import Rubric
from grader.result import CheckResult, Result

#: Values that are listed for one position in a text.
MOST_VALUES = 3
#: Characters of a text that are read.
MOST_CHARACTERS = 2000


@dataclass(frozen=True)
class Made:
    """One student's share in a mistake."""

    #: Index of the student in the class, from 0.
    row: int
    #: Points that the check itself cost, and points of the checks that it blocked.
    lost: Decimal
    following: Decimal

    @property
    def cost(self) -> Decimal:
        """All points that the mistake cost this student."""
        return self.lost + self.following


@dataclass(frozen=True)
class Mistake:
    """The same mistake of some students."""

    #: Id of the failed check.
    check_id: str
    #: Reason that students were given, with the range of numbers, or some of the names, where their texts differ.
    pattern: str
    #: Fix that students were told.
    hint: str
    #: Points over all of these students, as in `Made`.
    lost: Decimal
    following: Decimal
    #: Shares of the students, the highest cost first.
    made_by: tuple[Made, ...]

    @property
    def cost(self) -> Decimal:
        """All points that the mistake cost the class."""
        return self.lost + self.following


@dataclass(frozen=True)
class _Failed:
    """A check that cost a student points."""

    check: CheckResult
    share: Made

    @property
    def kind(self) -> tuple[str, str, str]:
        """Key that two students share if they made the same mistake."""
        return self.check.id, gist(self.check.reason), gist(self.check.hint)


def mistakes_of(results: Mapping[int, Result], rubric: Rubric) -> tuple[Mistake, ...]:
    """Group the lost points of a class by mistakes, the highest cost first.

    Parameters
    ----------
    results
        Results of the graded submissions by their indexes in the class.
    """
    groups: dict[tuple[str, str, str], list[_Failed]] = {}
    for row, result in results.items():
        for failed in _failed(row, result):
            groups.setdefault(failed.kind, []).append(failed)
    places = {check.id: place for place, check in enumerate(rubric.checks())}

    def rank(mistake: Mistake) -> tuple[Decimal, int, int, str]:
        place = places.get(mistake.check_id, len(places))
        return -mistake.cost, -len(mistake.made_by), place, mistake.pattern

    mistakes = map(_mistake, groups.values())
    return tuple(sorted(mistakes, key=rank))


def _failed(row: int, result: Result) -> Iterator[_Failed]:
    """Yield the checks that cost a student points, unless another such check blocked them."""
    following = _following(result)
    for check in result.checks:
        if check.lost > 0 and check.id in following:
            yield _Failed(check, Made(row, check.lost, following[check.id]))


def _mistake(group: Sequence[_Failed]) -> Mistake:
    """Sum up the same mistake of some students."""
    shares = []
    reasons = []
    hints = []
    lost = Decimal(0)
    following = Decimal(0)
    for failed in group:
        shares.append(failed.share)
        reasons.append(failed.check.reason)
        hints.append(failed.check.hint)
        lost += failed.share.lost
        following += failed.share.following
    shares.sort(key=lambda share: (-share.cost, share.row))
    check_id = group[0].check.id
    return Mistake(check_id, pattern_of(reasons), _commonest(hints), lost, following, tuple(shares))


def _following(result: Result) -> dict[str, Decimal]:
    """Return, for each check that cost points by itself, the points of the checks that it blocked."""
    lost = {check.id: check for check in result.checks if check.lost > 0}
    sums: dict[str, Decimal] = {}
    for check in lost.values():
        if check.blocked_by in lost and check.blocked_by != check.id:
            blocked = sums.get(check.blocked_by, Decimal(0))
            sums[check.blocked_by] = blocked + check.lost
        else:
            sums.setdefault(check.id, Decimal(0))
    return sums


# -- the same text for different names and numbers ---------------------------------------------

_HOLE = "\ufffc"
_NUMBER = r"[-−+]?\d+(?:[.,]\d+)*(?:[eE][-+]?\d+)?(?:\s?%)?"
_VALUE = re.compile(
    r"(?<!\w)'[^'\n]{0,400}'(?!\w)|\"[^\"\n]{0,400}\"|`[^`\n]{0,400}`|‘[^’\n]{0,400}’|“[^”\n]{0,400}”"  # quoted
    r"|\[[^\[\]\n]{0,400}\]"  # an array, or an index
    r"|(?<![\w/])[~/]\w[\w./{}-]*(?<![.])"  # a ROS name or a path
    r"|(?<!\w)[A-Za-z_]\w*(?:[./]\w+)+(?:\(\))?|(?<!\w)\w+\(\)"  # a file, a type, an attribute of a module, a call
    r"|(?<!\w)(?=\w*[A-Za-z])\w*_\w*"  # an identifier in snake case
    r"|(?<!\w)[A-Z][a-z0-9]+(?:[A-Z][a-z0-9]*)+"  # a class
    r"|(?<=\bnamed )\w+"
    rf"|(?<![\w.]){_NUMBER}"
)
#: Words that only look like a student's names: constants, and kinds of exceptions.
_WORD = re.compile(r"(?=[A-Z0-9_]*[A-Z])[A-Z0-9_]+|\w*(?:Error|Exception|Warning|Interrupt)")
_END = re.compile(r"[.;?!](?=\s|$)")
_LIST = re.compile(rf"{_HOLE}(?:(?:, and |, or |, | and | or ){_HOLE})+")
#: Plural forms of verbs.
_SINGULAR = {"are": "is", "were": "was", "have": "has", "do": "does"}


@dataclass(frozen=True)
class _Text:
    """A text taken apart: fixed pieces, and between each two of them a value."""

    #: One more than values.
    fixed: Sequence[str]
    values: Sequence[str]

    @classmethod
    def of(cls, text: str) -> _Text:
        """Take a text apart: names, numbers and quotes are values."""
        text = " ".join(text[:MOST_CHARACTERS].split())
        fixed = []
        values = []
        end = 0
        for match in _VALUE.finditer(text):
            if not _WORD.fullmatch(match[0]):
                fixed.append(text[end : match.start()])
                values.append(match[0])
                end = match.end()
        return cls([*fixed, text[end:]], values)

    @property
    def first_sentence(self) -> _Text:
        """The text up to the end of its first sentence."""
        for n, piece in enumerate(self.fixed):
            end = _END.search(piece)
            if end is not None:
                last = piece[: end.end()]
                return _Text([*self.fixed[:n], last], self.values[:n])
        return self

    def with_values(self, values: Sequence[str]) -> str:
        """Return the whole text with other values."""
        pieces = [self.fixed[0]]
        for value, piece in zip(values, self.fixed[1:], strict=True):
            pieces += [value, piece]
        return "".join(pieces)


def gist(text: str) -> str:
    """Return the common part of all texts that say the same with different names and numbers.

    It is the first sentence in the singular, with a hole for each value or list of values, and without a list of values
    after a colon.
    """
    sentence = _Text.of(text).first_sentence
    lead = sentence.with_values([_HOLE] * len(sentence.values))
    head, colon, tail = lead.partition(": ")
    if colon and _HOLE in tail:
        lead = head
    words = re.findall(rf"\w+|{_HOLE}", _LIST.sub(_HOLE, lead))
    return " ".join(_singular(word.lower()) for word in words)


def _singular(word: str) -> str:
    """Return the same word for singular and plural: `topic` for `topics`, and `wa` for `was` and `were`."""
    return _SINGULAR.get(word, word).rstrip("s")


def pattern_of(texts: Sequence[str]) -> str:
    """Return one text for several with the same gist, with the range of their numbers and some of their names."""
    whole = list(map(_Text.of, texts))
    pattern = _merged(whole)
    if pattern is None:
        pattern = _merged([text.first_sentence for text in whole])
    if pattern is not None:
        return pattern
    heads = {text.partition(": ")[0] for text in texts}
    if len(heads) == 1:
        return f"{heads.pop()}: …"
    return f"For example: {_commonest(texts)}"


def _merged(texts: Sequence[_Text]) -> str | None:
    """Return one text for several with the same fixed pieces; None if these differ."""
    first = texts[0]
    if any(text.fixed != first.fixed for text in texts):
        return None
    columns = zip(*(text.values for text in texts), strict=True)
    return first.with_values(list(map(_together, columns)))


def _together(values: Sequence[str]) -> str:
    """Return one text for the values at the same position: a value, a range of numbers, or the most frequent values."""
    distinct = [value for value, _ in Counter(sorted(values)).most_common()]
    if len(distinct) == 1:
        return distinct[0]
    if all(re.fullmatch(_NUMBER, value) for value in distinct):
        return _number_range(distinct)
    more = len(distinct) - MOST_VALUES
    if more < 2:
        return " or ".join(distinct)
    return f"{' or '.join(distinct[:MOST_VALUES])} or {more} others"


def _number_range(numbers: Sequence[str]) -> str:
    """Return the range of numbers: `3 to 5`, `10 to 20%`."""
    lowest, *_, highest = sorted(numbers, key=_number)
    if all(number.endswith("%") for number in numbers):
        lowest = lowest.removesuffix("%")
    return f"{lowest} to {highest}"


def _number(text: str) -> float:
    return float(text.rstrip("% ").replace("−", "-").replace(",", ""))


def _commonest(texts: Sequence[str]) -> str:
    """Return the most frequent text; of several the first in alphabetical order."""
    counts = Counter(texts)
    return min(counts, key=lambda text: (-counts[text], text))
