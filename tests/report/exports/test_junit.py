"""JUnit XML: requirements of Jenkins' xUnit schema and GitLab's parser, and the right verdicts."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

from hypothesis import HealthCheck, example, given, settings

from grader.report.escape import line
from tests.report.exports.sample_results import (
    adjusted_and_tampered,
    check,
    criterion,
    every_outcome,
    exported,
    hostile_results,
    of_recording,
    result,
)
from tests.report.untrusted_texts import hostile

#: From junit-10.xsd: element -> (required attributes, optional ones, elements within).
_SCHEMA: dict[str, tuple[set[str], set[str], set[str]]] = {
    "testsuites": (set(), {"name", "time", "tests", "failures", "errors"}, {"testsuite"}),
    "testsuite": (
        {"name", "tests", "failures", "errors"},
        {
            "time",
            "skipped",
            "timestamp",
            "hostname",
            "id",
            "package",
            "file",
            "log",
            "url",
            "group",
        },
        {"testsuite", "properties", "testcase", "system-out", "system-err"},
    ),
    "testcase": (
        {"name"},
        {"time", "classname", "group"},
        {"skipped", "error", "failure", "system-out", "system-err"},
    ),
    "failure": (set(), {"type", "message"}, set()),
    "skipped": (set(), {"type", "message"}, set()),
}
#: Older versions of that schema allow no more than three decimals.
_TIME = re.compile(r"[0-9]{1,3}(,?[0-9]{3})*(\.[0-9]{0,3})?")


def assert_valid(text: str) -> ElementTree.Element:
    """Assert the consumers' requirements, and return the document's root."""
    root = ElementTree.fromstring(text.encode("utf-8"))
    assert root.tag == "testsuites"
    for element in root.iter():
        assert_in_schema(element)
    names = []
    for suite in root:
        assert_counts(suite)
        for case in suite:
            assert_case(case)
            names.append((suite.get("name"), case.get("classname"), case.get("name")))
    # GitLab knows a case by these three, Jenkins by the last two.
    assert len(set(names)) == len(names)
    assert len({name[1:] for name in names}) == len(names)
    return root


def assert_in_schema(element: ElementTree.Element) -> None:
    """Assert that an element has the attributes and children of the schema."""
    needed, allowed, within = _SCHEMA[element.tag]
    assert needed <= set(element.attrib) <= needed | allowed
    assert {child.tag for child in element} <= within
    assert _TIME.fullmatch(element.get("time", "0"))
    # GitLab's parser converts the contents of an element by its `type`, and refuses some.
    assert "type" not in element.attrib


def assert_counts(suite: ElementTree.Element) -> None:
    """Assert that a suite counts its cases and their verdicts rightly."""
    assert suite.get("tests") == str(len(suite.findall("testcase")))
    assert suite.get("failures") == str(len(suite.findall("testcase/failure")))
    assert suite.get("skipped") == str(len(suite.findall("testcase/skipped")))
    assert suite.get("errors") == "0"


def assert_case(case: ElementTree.Element) -> None:
    """Assert that a case has its names, and a text in each verdict."""
    assert case.get("name")
    assert case.get("classname")
    for told in case:
        # An element without contents becomes a mapping in GitLab, not a text.
        assert (told.text or "").strip()


def test_checks_are_cases_and_criteria_suites() -> None:
    """Lost points are failures with their proof, undecided ones are skipped, all others pass."""
    root = assert_valid(exported("junit", every_outcome()))
    assert [suite.get("name") for suite in root] == ["Criterion a", "Criterion b"]
    verdicts = {}
    for case in root.iter("testcase"):
        verdicts[case.get("name")] = [told.tag for told in case]
    assert verdicts == {
        "Title of a.passed": [],
        "Title of a.partial": ["failure"],
        "Title of b.failed": ["failure"],
        "Title of b.missed": ["failure"],
        "Title of b.open": ["skipped"],
        "Title of b.broken": ["skipped"],
    }
    failure = root.find("testsuite/testcase/failure")
    assert failure is not None
    assert failure.get("message") == "−2.5 of 5 points, partial: Reason of a.partial."
    assert (failure.text or "").splitlines() == [
        "−2.5 of 5 points, partial",
        "Reason of a.partial.",
        "Expected: 100 Hz",
        "Measured: 90 Hz",
        "Where: a.partial.py:3; recording 'one', /a, 1.0–2.0 s",
    ]
    assert root[0].find("testcase").get("classname") == "ann.a"  # type: ignore[union-attr]


def test_the_graders_faults_are_never_failures() -> None:
    """A result without any decided check has no failure and no error."""
    checks = [check(f"a.{n}", outcome, 0, 3) for n, outcome in enumerate(("inconclusive", "error"))]
    root = assert_valid(exported("junit", result(criterion("a", *checks))))
    assert (root.get("failures"), root.get("errors")) == ("0", "0")
    skipped = root.find("testsuite/testcase/skipped")
    assert skipped is not None
    assert "Undecided, 3 points are not earned before somebody has decided." in (skipped.text or "")


def test_what_a_person_excused_does_not_fail() -> None:
    """A decision by hand counts."""
    root = assert_valid(exported("junit", adjusted_and_tampered()))
    failed = []
    for case in root.iter("testcase"):
        if case.find("failure") is not None:
            failed.append(case.get("name"))
    assert failed == ["Title of b.failed", "Title of b.missed", "Title of b.open"]


def test_a_suite_takes_the_time_of_its_sessions() -> None:
    """With three decimals; without sessions there is no time."""
    plain = every_outcome()
    root = assert_valid(exported("junit", plain))
    assert [suite.get("time") for suite in root] == ["7.294", "16.794"]
    plain["provenance"]["sessions"] = {}
    assert [suite.get("time") for suite in assert_valid(exported("junit", plain))] == [None, None]


def test_equal_titles_are_distinguished() -> None:
    """Checks and criteria of one title keep names of their own."""
    twins = [check(name, "passed", 1, 1, title="Same") for name in ("a.x", "a.y")]
    root = assert_valid(
        exported(
            "junit",
            result(criterion("a", *twins), criterion("b", *twins) | {"title": "Criterion a"}),
        )
    )
    assert [suite.get("name") for suite in root] == ["Criterion a (a)", "Criterion a (b)"]
    assert [case.get("name") for case in root[0]] == ["Same (a.x)", "Same (a.y)"]


def test_a_real_result_is_valid() -> None:
    """The results of kept recordings satisfy the consumers."""
    for name in ("solution", "wrong_topic", "service_never_answers"):
        assert_valid(exported("junit", of_recording(name)))


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(hostile_results())
def test_hostile_texts_are_only_text(plain: dict[str, object]) -> None:
    """The document is valid, has the same elements, and holds no reference to a file."""
    root = assert_valid(exported("junit", plain))
    harmless = assert_valid(exported("junit", adjusted_and_tampered()))
    assert [element.tag for element in root.iter()] == [element.tag for element in harmless.iter()]
    assert not list(root.iter("system-out"))


@given(hostile)
@example("]]><x/>")
@example("<!DOCTYPE x [<!ENTITY e SYSTEM 'file:///etc/passwd'>]>&e;")
@example("a\nb\tc  d\r\ne\rf")
def test_a_parser_gives_a_text_back(text: str) -> None:
    """A student's text comes back as shown, from an element's contents and from an attribute."""
    root = assert_valid(
        exported("junit", result(criterion("a", check("a.f", "failed", 0, 3, reason=f"x {text}"))))
    )
    (failure,) = root.iter("failure")
    assert (failure.text or "").splitlines()[1] == line(f"x {text}", 600)
    assert (failure.get("message") or "").startswith("−3 of 3 points, failed: x")
