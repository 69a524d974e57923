"""JUnit XML, as Jenkins (JUnit and xUnit plugins) and GitLab read it: a criterion is a suite, a check a case.

Lost points are a `failure`. What is undecided is `skipped`, which neither system counts against the student. Properties
on cases and file names are not in the xUnit plugin's schema; in output both look for references to files; GitLab's
parser converts by a `type`: none of these is written.

References
----------
Schema `junit-10.xsd` of Jenkins' xUnit plugin. GitLab: unit test reports.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

from grader.report.escape import line, shown
from grader.report.exports.graded import Graded, GradedCheck, full_text
from grader.report.views import badge_of, points


def render(graded: Graded, environment: Mapping[str, str]) -> str:
    """Return the XML document."""
    root = ElementTree.Element(
        "testsuites", {"name": line(graded.lab, 600), **_counts(graded.checks)}
    )
    del root.attrib["skipped"]  # The schema has it on suites only.
    titles = _unique([(criterion.id, criterion.title) for criterion in graded.criteria])
    # Jenkins puts what is before the last point above the rest: submission, criterion, check.
    classes = _numbered([line(f"{line(graded.submission)}.{c.id}", 500) for c in graded.criteria])
    for criterion, title, class_name in zip(graded.criteria, titles, classes, strict=True):
        suite = ElementTree.SubElement(
            root, "testsuite", {"name": line(title, 600), **_counts(criterion.checks)}
        )
        sessions = dict.fromkeys(
            s for check in criterion.checks for s in check.sessions if s in graded.sessions
        )
        time_s = sum(graded.sessions[s]["duration_s"] for s in sessions)
        if sessions and 0 <= time_s < 1e6:
            suite.set("time", f"{time_s:.3f}")
        names = _unique([(check.id, check.title) for check in criterion.checks])
        for check, name in zip(criterion.checks, names, strict=True):
            case = ElementTree.SubElement(
                suite, "testcase", name=line(name, 600), classname=line(class_name, 600)
            )
            if check.lost:
                word = badge_of(check.outcome).word
                _describe(
                    case,
                    "failure",
                    f"−{points(check.lost)} of {points(check.possible)} points, {word}",
                    check,
                )
            elif check.open:
                _describe(case, "skipped", "undecided, not earned", check)
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _describe(case: ElementTree.Element, name: str, cost: str, check: GradedCheck) -> None:
    # GitLab shows the contents alone, Jenkins the message and below it the contents.
    message = f"{cost}: {check.reason}" if check.reason else cost
    ElementTree.SubElement(case, name, message=line(message, 600)).text = shown(
        "\n".join([cost, full_text(check)])
    )


def _counts(checks: Sequence[GradedCheck]) -> dict[str, str]:
    skipped = sum(1 for check in checks if check.open and not check.lost)
    failures = sum(1 for check in checks if check.lost)
    return {
        "tests": str(len(checks)),
        "failures": str(failures),
        "errors": "0",
        "skipped": str(skipped),
    }


def _unique(named: Sequence[tuple[str, str]]) -> list[str]:
    """Return the titles; where two are alike, with their ids. GitLab takes equal names for one case."""
    titles = [line(title, 200) for _, title in named]
    cases = [
        t if t and titles.count(t) == 1 else f"{t} ({line(key, 100)})"
        for (key, _), t in zip(named, titles, strict=True)
    ]
    return _numbered(cases)


def _numbered(texts: Sequence[str]) -> list[str]:
    return [t if texts.count(t) == 1 else f"{t} {number}" for number, t in enumerate(texts, 1)]
