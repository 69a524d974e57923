"""The translations within a page: its units, their dictionary, and the English texts left on a whole report."""

from __future__ import annotations

import base64
import html
import json
import re
import zlib
from pathlib import Path

import pytest

from grader.judging.judgement import judge_recordings
from grader.judging.languages import in_lab
from grader.judging.rubrics import read_rubric
from grader.lab.overrides import Overrides
from grader.lab.rubric import Rubric
from grader.languages.catalogue import Message
from grader.languages.language import Language, Languages
from grader.report.page_languages import Unit, hash_of, units_of, with_languages

KEPT = Path(__file__).resolve().parents[1] / "recordings"
NAMES = ("service_never_answers", "launch_wrong_executable", "wrong_topic")
#: Names of versions and values of QoS, which are the same in each language.
DATA = frozenset(
    "python mcap rosbags numpy launch double bool volatile reliable best effort keep last transient local".split()  # noqa: SIM905
)
#: Texts of students, of rclpy and of launch, and labels of a lab's steps in brackets.
OF_OTHERS = re.compile(
    r"Robot (?:cannot|enabled|disabled)|^How to run it: |^[A-Z]\w+Error: |\((?:[\w ]+)\)$|^Range in rad: |\bRCLError\b"
    r"|as a whole\.$|^use_sim|^safety_enabled = |The package has: |^Write the name of an entry point"
)


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the rubric of Lab 09-01."""
    return read_rubric(None)


@pytest.fixture(scope="module")
def pages(rubric: Rubric) -> dict[str, str]:
    """Give the reports of some kept recordings."""
    return {name: judge_recordings(KEPT / name, rubric, Overrides()).page for name in NAMES}


def texts(page: str) -> list[str]:
    """Return the units of a page, with `N` for their marks."""
    return [re.sub("[\ue000-\uf8ff]", "N", unit.text) for unit in units_of(page)]


@pytest.mark.parametrize(
    ("page", "found"),
    [
        ("<p>One text.</p><p>Another</p>", ["One text.", "Another"]),
        (
            "<p>Run <code>a b</code>, then\n <a href='#'>look here</a>.</p>",
            ["Run N, then Nlook hereN."],
        ),
        ("<p><b>Label</b> some value</p>", ["Label", "some value"]),
        ("<a href='#'><span>Some name</span> and more</a>", ["Some name", "and more"]),
        ("<pre>no units</pre><script>var x = 'no';</script><style>p {}</style>", []),
        ('<h1 translate="no">Some name</h1><p>by <em translate="no">Some Name</em></p>', ["by N"]),
        (
            '<button aria-label="Zoom in" title="Zoom &amp; more">+</button>',
            ["Zoom in", "Zoom & more"],
        ),
        ("<p>a &lt;b&gt; c&amp;d text</p>", ["a <b> c&d text"]),
        ("<p>3.5</p><p>–</p><p>x</p>", []),
        ("<noscript><p>In a part</p></noscript>", ["In a part"]),
        ("<svg><text>An axis</text></svg>", ["An axis"]),
    ],
)
def test_units_of_a_page(page: str, found: list[str]) -> None:
    """A unit is a row of text and elements within a sentence; code, output and names are none."""
    assert texts(page) == found


def test_a_translation_keeps_the_elements() -> None:
    """A translation has each mark once, and ends of elements after their beginnings."""
    unit = Unit("\ue000a\ue001 b \ue002", (("\ue000", "\ue001"),))
    assert unit.allows("\ue002 b \ue000a\ue001")
    assert not unit.allows("\ue001a\ue000 b \ue002")
    assert not unit.allows("\ue000a\ue001 b")
    assert not unit.allows("\ue000a\ue001 b \ue002\ue002")
    nested = Unit("\ue000a\ue001b\ue002c\ue003", (("\ue001", "\ue002"), ("\ue000", "\ue003")))
    assert not nested.allows("\ue000a\ue001b\ue003c\ue002")


def dictionary(page: str, tag: str) -> dict[str, str]:
    """Return the translations within a page, by their hashes."""
    packed = re.findall(f'data-{tag}="([^"]*)"', page)[-1]
    hashes, found, *_ = json.loads(zlib.decompress(base64.b64decode(packed), -15))
    return {hashes[4 * n : 4 * n + 4]: text for n, text in enumerate(found)}


def test_the_dictionary_has_the_units_of_the_page_alone() -> None:
    """A translation is in the page if its text is; hostile text stays text."""
    messages = [
        Message("no answer", "keine Antwort", ()),
        Message("not here", "nicht hier", ()),
        Message("{0} failed", "{0} scheiterte", ()),
    ]
    languages = Languages((Language("de", messages),), "de")
    hostile = html.escape("</div><script>alert(1)</script> failed")
    page = with_languages(
        f"<p>no answer</p><p>{hostile}</p><script>var a;</script></body>", languages
    )
    assert dictionary(page, "de") == {
        hash_of("no answer"): "keine Antwort",
        hash_of(
            "</div><script>alert(1)</script> failed"
        ): "</div><script>alert(1)</script> scheiterte",
    }
    assert page.count("<script>") == 1
    assert 'data-chosen="de"' in page


def test_a_cut_text_is_cut_in_the_other_language() -> None:
    """A line that ends with an ellipsis is the beginning of the whole text's translation."""
    language = Language(
        "de", [Message("nothing arrives on {0} at all", "auf {0} kommt gar nichts an", ())]
    )
    page = "<p>nothing arrives on /a…</p><p>nothing arrives on /a at all</p><script></script>"
    found = dictionary(with_languages(page, Languages((language,))), "de")
    assert found[hash_of("nothing arrives on /a…")] == "auf /a kommt gar nich…"


def names_of(rubric: Rubric) -> frozenset[str]:
    """Return the names in a lab: sessions, programs, labels of steps."""
    names = {*rubric.sessions, *rubric.artifacts, *rubric.reference, *NAMES}
    for session in rubric.sessions.values():
        names.update(filter(None, (step.label for step in session.steps)))
    return frozenset(names)


@pytest.mark.parametrize("tag", ["de", "es"])
@pytest.mark.parametrize("name", NAMES)
def test_no_sentence_of_a_report_stays_english(
    name: str, tag: str, pages: dict[str, str], rubric: Rubric
) -> None:
    """Each text of the grader on a report is translated; names and texts of others stay."""
    language = in_lab(rubric, tag)
    names = names_of(rubric) | DATA
    english = []
    for unit in dict.fromkeys(units_of(pages[name])):
        is_name = unit.text in names or set(unit.text.split()) <= DATA
        if is_name or OF_OTHERS.search(unit.text) or unit.text.endswith("…"):
            continue
        if language.translated(unit.text).left:
            english.append(unit.text)
    assert english == []


@pytest.mark.parametrize("name", NAMES)
def test_a_language_takes_little_of_a_page(name: str, pages: dict[str, str]) -> None:
    """The translations of a page are at most 12 kB a language."""
    packed = re.findall(r'data-(?:de|es)="([^"]*)"', pages[name])
    assert len(packed) == 2
    assert max(map(len, packed)) <= 12_000
