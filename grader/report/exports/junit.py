"""JUnit XML, as Jenkins (JUnit and xUnit plugins) and GitLab read it: a criterion is a suite, a check a case.

Lost points are a `failure`. Undecided checks are `skipped`, which neither system counts against the student. The
report has no properties on cases and no file names, because the xUnit plugin's schema does not allow them; no output,
because both systems look for references to files in it; and no `type`, because GitLab's parser converts by it.

References
----------
Schema `junit-10.xsd` of Jenkins' xUnit plugin. GitLab: unit test reports.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

from grader.report.escape import line, shown
from grader.report.exports.graded import Graded, GradedCheck, GradedCriterion, full_text
from grader.report.views import badge_of, points


def render(graded: Graded, environment: Mapping[str, str]) -> str:
    """Return the XML document."""
    root = ElementTree.Element("testsuites", {"name": line(graded.lab, 600)})
    root.attrib.update(_counts(graded.checks))
    del root.attrib["skipped"]  # The schema has it on suites only.
    titles = _unique(graded.criteria)
    # Jenkins shows the part before the last point as a level above: submission, criterion, check.
    submission = line(graded.submission)
    classes = _numbered([line(f"{submission}.{each.id}", 500) for each in graded.criteria])
    for criterion, title, class_name in zip(graded.criteria, titles, classes, strict=True):
        suite = ElementTree.SubElement(root, "testsuite", {"name": line(title, 600)})
        suite.attrib.update(_counts(criterion.checks))
        _set_time(suite, criterion, graded)
        for check, name in zip(criterion.checks, _unique(criterion.checks), strict=True):
            _add_case(suite, line(name, 600), line(class_name, 600), check)
    ElementTree.indent(root)
    document = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{document}\n'


def _set_time(suite: ElementTree.Element, criterion: GradedCriterion, graded: Graded) -> None:
    """Set the duration of the sessions with the proof of a criterion; not without sessions, or beyond belief."""
    names: set[str] = set()
    for check in criterion.checks:
        names.update(check.sessions)
    durations_s = []
    for name, session in graded.sessions.items():
        if name in names:
            durations_s.append(session["duration_s"])
    if durations_s and 0 <= sum(durations_s) < 1e6:
        suite.set("time", f"{sum(durations_s):.3f}")


def _add_case(suite: ElementTree.Element, name: str, class_name: str, check: GradedCheck) -> None:
    case = ElementTree.SubElement(suite, "testcase", name=name, classname=class_name)
    if check.lost:
        word = badge_of(check.outcome).word
        lost = f"−{points(check.lost)} of {points(check.possible)} points"
        _describe(case, "failure", f"{lost}, {word}", check)
    elif check.open:
        _describe(case, "skipped", "undecided, not earned", check)


def _describe(case: ElementTree.Element, name: str, cost: str, check: GradedCheck) -> None:
    # GitLab shows the contents alone, Jenkins the message and below it the contents.
    message = cost
    if check.reason:
        message = f"{cost}: {check.reason}"
    element = ElementTree.SubElement(case, name, message=line(message, 600))
    element.text = shown(f"{cost}\n{full_text(check)}")


def _counts(checks: Sequence[GradedCheck]) -> dict[str, str]:
    skipped = 0
    failures = 0
    for check in checks:
        if check.lost:
            failures += 1
        elif check.open:
            skipped += 1
    return {
        "tests": str(len(checks)),
        "failures": str(failures),
        "errors": "0",
        "skipped": str(skipped),
    }


def _unique(named: Sequence[GradedCriterion | GradedCheck]) -> list[str]:
    """Return the titles, equal ones with their ids, because GitLab takes equal names for one case."""
    titles = [line(each.title, 200) for each in named]
    cases = []
    for each, title in zip(named, titles, strict=True):
        is_unique = bool(title) and titles.count(title) == 1
        if not is_unique:
            title = f"{title} ({line(each.id, 100)})"
        cases.append(title)
    return _numbered(cases)


def _numbered(texts: Sequence[str]) -> list[str]:
    """Return the texts, equal ones with their positions after them: `a 1`, `a 2`."""
    numbered = []
    for number, text in enumerate(texts, 1):
        if texts.count(text) > 1:
            text = f"{text} {number}"
        numbered.append(text)
    return numbered
