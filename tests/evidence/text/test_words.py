"""Words, substance, placeholders and terms in several scripts."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.text.words import (
    Terms,
    fold,
    is_placeholder,
    normal_form,
    sentences,
    substance,
)
from tests.counted import calls_of

PATTERNS = (r"^\W*todo\b",)


@pytest.mark.parametrize(
    ("text", "amount"),
    [
        ("publishes seven joint positions", 4),
        ("data data data data", 1),
        ("veröffentlicht sieben Gelenkwinkel", 3),
        ("发布七个关节的位置", 4),
        ("最新のコマンドを保存する", 6),
        ("최신 명령을 저장한다", 3),
        ("يحسب الخطأ بين الأمر والحالة", 5),
        ("नोड संदेश भेजता है", 4),
        ("ส่งตำแหน่งของข้อต่อ", 3),
        ("a b c 1 2 3", 0),
        ("", 0),
    ],
)
def test_substance_counts_alike_in_every_script(text: str, amount: int) -> None:
    """The same statement weighs about the same whether its script parts words or not."""
    assert substance(text) == amount


@pytest.mark.parametrize(
    "text",
    [
        "TODO",
        "TODO: write this",
        "...",
        "<describe the node>",
        "[Your text here]",
        "",
        "-----",
    ],
)
def test_placeholders_are_seen(text: str) -> None:
    """Placeholders do not count as text."""
    assert is_placeholder(text, PATTERNS)


@pytest.mark.parametrize(
    "text",
    [
        "Description: this node publishes joint commands at a fixed rate.",
        "Describes the seven joints of the arm.",
        "Adds samples to the history.",
        "计算均方根误差",
        "A short and true sentence",
    ],
)
def test_texts_are_no_placeholders(text: str) -> None:
    """Texts that merely begin like a template are texts."""
    assert not is_placeholder(text, PATTERNS)


def test_fold_drops_case_and_accents_but_keeps_letters() -> None:
    """Folding makes spellings comparable without merging different letters of Indic or Korean script."""
    assert fold("Verzögerung ÉTÉ İı") == "verzogerung ete ii"
    assert fold("한글") == "한글"
    assert fold("नोड") == "नोड"


def test_normal_form_ignores_punctuation() -> None:
    """Two sentences that differ in marks only have one form."""
    assert normal_form("The node, publishes!") == normal_form("the node publishes")


def test_sentences_end_in_every_script() -> None:
    """Full stops of several scripts and empty lines end a sentence."""
    assert sentences("One. Two! 三。四\n\nfive") == ["One.", "Two!", "三", "四", "five"]


@pytest.mark.parametrize(
    ("term", "text", "found"),
    [
        ("reliab", "Reliability matters", True),
        ("reliab", "unreliable", False),
        ("*verlust", "Der Paketverlust", True),
        ("best effort", "uses BEST_EFFORT here", True),
        ("best effort", "best-effort", True),
        ("joint publisher", "see joint_publisher.py", True),
        ("si$", "a sine", False),
        ("si$", "si no", True),
        ("latenc", "使用latency低的模式", True),
        ("可靠", "使用可靠传输", True),
        ("güvenilir", "GÜVENİLİR iletim", True),
        ("надежн", "Надёжная доставка", True),
        ("فقد", "لفقد الرسائل", True),
        ("qos", "QoS는 중요하다", True),
    ],
)
def test_terms_are_found_in_any_language(term: str, text: str, found: bool) -> None:
    """Stems are found with their endings, at the beginning of words, whatever the script around them."""
    assert Terms.of([term]).found(text) is found


def test_terms_count_and_blank_out() -> None:
    """Every occurrence is counted, and blanked out of the text."""
    terms = Terms.of(["loss", "delay"])
    assert terms.count("Losses and delays, loss") == 3
    assert "loss" not in terms.without("Losses and delays")
    assert not Terms.of([]).found("anything")
    assert Terms.of(["", " ", "*$"]).count("anything") == 0


@given(st.text(max_size=300), st.lists(st.text(max_size=12), max_size=5))
def test_nothing_raises_on_any_text(text: str, terms: list[str]) -> None:
    """Counting, comparing and searching take any text and any terms."""
    assert substance(text) >= 0
    assert Terms.of(terms).count(text) >= 0
    assert is_placeholder(text, PATTERNS) in (True, False)
    assert "".join(sentences(text)) is not None


def test_the_terms_of_a_lab_are_compiled_once() -> None:
    """All submissions of a class are read by the same terms."""
    Terms.of(["reliable", "best effort"], 2)
    assert calls_of(lambda: Terms.of(["reliable", "best effort"], 2)) < 10
