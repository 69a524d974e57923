"""JUnit XML, as Jenkins (JUnit and xUnit plugins) and GitLab read it: a criterion is a suite, a check a case.

Lost points are a `failure`. What is undecided is `skipped`, not an `error`: both systems show it as such,
and neither counts it against the student, since it is the grader's doing. There are no properties on cases
and no file names (the xUnit plugin's schema knows neither), nor any output, in which both systems look for
references to files. No `type` is written, since GitLab's parser would convert by it.

References
----------
Schema `junit-10.xsd` of Jenkins' xUnit plugin. GitLab: unit test reports.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from grader.report.escape import line, xml_text
from grader.report.exports.graded import Graded, GradedCheck, GradedCriterion
from grader.report.exports.words import full_text
from grader.report.views import badge_of, points


def render(graded: Graded, environment: Mapping[str, str]) -> str:
    """Return the XML document."""
    titles = _unique([(criterion.id, criterion.title) for criterion in graded.criteria])
    # Jenkins puts what is before the last point above the rest: submission, criterion, check.
    classes = _numbered([xml_text(line(f"{line(graded.submission)}.{c.id}", 500)) for c in graded.criteria])
    suites = [_suite(*each, graded) for each in zip(graded.criteria, titles, classes, strict=True)]
    checks = graded.checks
    totals = _counts(checks)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<testsuites name={_quoted(graded.lab)} tests="{len(checks)}" failures="{totals["failures"]}" errors="0">\n'
        + "".join(suites)
        + "</testsuites>\n"
    )


def _suite(criterion: GradedCriterion, title: str, class_name: str, graded: Graded) -> str:
    counts = _counts(criterion.checks)
    sessions = dict.fromkeys(s for check in criterion.checks for s in check.sessions if s in graded.sessions)
    time_s = sum(graded.sessions[s]["duration_s"] for s in sessions)
    time = f' time="{time_s:.3f}"' if sessions and 0 <= time_s < 1e6 else ""
    titles = _unique([(check.id, check.title) for check in criterion.checks])
    cases = "".join(_case(*each, class_name) for each in zip(criterion.checks, titles, strict=True))
    return (
        f'  <testsuite name={_quoted(title)} tests="{len(criterion.checks)}" failures="{counts["failures"]}"'
        f' errors="0" skipped="{counts["skipped"]}"{time}>\n{cases}  </testsuite>\n'
    )


def _case(check: GradedCheck, title: str, class_name: str) -> str:
    opened = f"    <testcase name={_quoted(title)} classname={_quoted(class_name)}"
    if check.lost:
        message = f"−{points(check.lost)} of {points(check.possible)} points, {badge_of(check.outcome).word}"
        return f"{opened}>\n      {_element('failure', message, check)}    </testcase>\n"
    if check.open:
        return f"{opened}>\n      {_element('skipped', 'undecided, not earned', check)}    </testcase>\n"
    return f"{opened}/>\n"


def _element(name: str, cost: str, check: GradedCheck) -> str:
    # GitLab shows the contents alone, Jenkins the message and below it the contents.
    message = f"{cost}: {check.reason}" if check.reason else cost
    contents = xml_text("\n".join([cost, full_text(check)]))
    return f"<{name} message={_quoted(message)}>{contents}</{name}>\n"


def _counts(checks: tuple[GradedCheck, ...]) -> dict[str, int]:
    failures = sum(1 for check in checks if check.lost)
    return {"failures": failures, "skipped": sum(1 for check in checks if check.open and not check.lost)}


def _unique(named: Sequence[tuple[str, str]]) -> list[str]:
    """Return the titles; where two are alike, with their ids. GitLab takes equal names for one case."""
    titles = [line(title, 200) for _, title in named]
    told = [
        t if t and titles.count(t) == 1 else f"{t} ({line(key, 100)})"
        for (key, _), t in zip(named, titles, strict=True)
    ]
    return _numbered(told)


def _numbered(texts: Sequence[str]) -> list[str]:
    return [t if texts.count(t) == 1 else f"{t} {number}" for number, t in enumerate(texts, 1)]


def _quoted(text: str) -> str:
    return f'"{xml_text(line(text, 600))}"'
