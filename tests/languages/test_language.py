"""Finished English texts in another language: by whole messages, templates, sentences and lists."""

from __future__ import annotations

import pickle
import time
from pathlib import Path

import pytest

from grader.languages.catalogue import NAMES, Message, engine_catalogues, read_catalogues, tag_of
from grader.languages.language import ENGLISH, Language, Languages
from grader.languages.template import Template

MESSAGES = {
    "{0} messages of type {1} on {2}": "{0} Nachrichten des Typs {1} auf {2}",
    "{0} messages": "{0} Nachrichten",
    "{0} message": "{0} Nachricht",
    "no messages": "keine Nachrichten",
    ", from node {0}": ", vom Node {0}",
    "Nothing was published on {0}.": "Auf {0} wurde nichts veröffentlicht.",
    "Call publish() from a timer. Spin the node.": "publish() in einem Timer aufrufen. Den Node laufen lassen.",
    "The rate is {0} Hz; the lab asks for {1}.": "Verlangt ist {1}; die Rate beträgt {0} Hz.",
    "Not tested, because {0}.": "Nicht geprüft, denn {0}.",
    "'{0}' failed": "„{0}“ ist gescheitert",
    "Publishes joint commands": "Veröffentlicht Gelenkbefehle",
    "`ros2 launch` stops there.": "Dort hält `ros2 launch` an.",
    "Write {0} in `{1}`.": "In `{1}` gehört {0}.",
    "braces {{ }} around {0}": "{{ }} um {0}",
    "no answer": "keine Antwort",
}


@pytest.fixture(scope="module")
def german() -> Language:
    """Give a language with a few messages."""
    return Language("de", [Message(*pair, ()) for pair in MESSAGES.items()])


@pytest.mark.parametrize(
    ("english", "other"),
    [
        ("no messages", "keine Nachrichten"),
        ("No messages", "Keine Nachrichten"),
        ("1 message", "1 Nachricht"),
        (
            "950 messages of type Float64 on /a, from node /b",
            "950 Nachrichten des Typs Float64 auf /a, vom Node /b",
        ),
        ("no messages; no answer", "keine Nachrichten; keine Antwort"),
        ("  no answer (no messages) ", "  keine Antwort (keine Nachrichten) "),
        (
            "Nothing was published on /a. Call publish() from a timer. Spin the node. No answer",
            "Auf /a wurde nichts veröffentlicht. publish() in einem Timer aufrufen. Den Node laufen lassen. Keine Antwort",
        ),
        (
            "Not tested, because 'Publishes joint commands' failed.",
            "Nicht geprüft, denn „Veröffentlicht Gelenkbefehle“ ist gescheitert.",
        ),
        (
            "The rate is 98.4 Hz; the lab asks for 100.",
            "Verlangt ist 100; die Rate beträgt 98,4 Hz.",
        ),
        ("`ros2 launch` stops there.", "Dort hält `ros2 launch` an."),
        ("Write 0.5 in `node.py: 0.5`.", "In `node.py: 0.5` gehört 0,5."),
        ("braces { } around 3", "{ } um 3"),
    ],
)
def test_texts_are_translated(english: str, other: str, german: Language) -> None:
    """Messages are found whole, by templates, in sentences and in lists; values are translated in turn."""
    assert german.text(english) == other


@pytest.mark.parametrize(
    "text",
    [
        "/no/messages",
        "joint_publisher.py, line 3",
        "Python 3.12",
        "7.1.2",
        "create_timer(0.01)",
        "`no messages`",
        "alice",
        "",
        "   ",
    ],
)
def test_names_and_code_stay(text: str, german: Language) -> None:
    """Names, paths, versions and code are no messages, whatever they say."""
    assert german.text(text) == text


def test_a_name_in_quotes_stays(german: Language) -> None:
    """A single word between quotation marks is a name, also if a message reads the same."""
    language = Language(
        "de",
        [Message("'{0}' failed", "„{0}“ ist gescheitert", ()), Message("answer", "Antwort", ())],
    )
    assert language.text("'answer' failed") == "„answer“ ist gescheitert"
    assert language.text("answer") == "Antwort"
    assert german.text("'no answer' failed") == "„keine Antwort“ ist gescheitert"


def test_a_quoted_passage_stays(german: Language) -> None:
    """A passage of a student's text between quotation marks is not translated, whatever it says."""
    passage = "“no messages; no answer. Nothing was published on /a. Spin the node, and so on.”"
    assert german.text(f"no answer; {passage}") == f"keine Antwort; {passage}"


def test_words_that_stay_english_are_counted(german: Language) -> None:
    """Prose without a message is counted; names and numbers are not."""
    assert german.translated("no messages").left == 0
    assert german.translated("joint_publisher.py, 98.4 Hz, RELIABLE").left == 0
    assert german.translated("nobody has translated this sentence").left > 0
    assert german.translated("Nothing was published on /a. nobody has this").left > 0


def test_english_stays_as_it_is() -> None:
    """English texts in English have no other numbers, blanks or words."""
    assert ENGLISH.text("  98.4 messages. ") == "  98.4 messages. "


@pytest.mark.parametrize(
    "text",
    [
        "no messages; " * 300,
        "messages of type on " * 190,
        "a, b. c: (d) " * 300,
        "A. " * 1300,
        "`" * 3999,
    ],
)
def test_hostile_texts_take_little_time(text: str, german: Language) -> None:
    """No text keeps the grader busy: the number of looked-up pieces is bounded."""
    begun = time.process_time()
    german.text(text)
    assert time.process_time() - begun < 3.0


def test_each_value_stands_once_in_a_translation() -> None:
    """A translation without a value, with another one, or with one twice is refused."""
    for wrong in ("{0}", "{0} {1} {2}", "{0} {0} {1}", "{0} `a` {1}"):
        with pytest.raises(ValueError, match=r"missing|not in the English"):
            Template.of("{0} and {1}").translation(wrong)


@pytest.mark.parametrize(
    ("text", "tag"),
    [
        ("de", "de"),
        ("DE-at", "de"),
        ("Deutsch", "de"),
        ("German", "de"),
        ("es_MX", "es"),
        ("español", "es"),
        ("en", "en"),
        ("fr", ""),
        ("", ""),
    ],
)
def test_languages_have_tags_and_names(text: str, tag: str) -> None:
    """A class list can name a language by its tag or by its name."""
    assert tag_of(text) == tag


def test_the_first_language_is_used_without_a_tag(german: Language) -> None:
    """A person without a language gets the lab's; an unknown tag gets English."""
    assert Languages((german,), "de").of("") is german
    assert Languages((german,), "de").of("en") is ENGLISH
    assert Languages((german,)).of("") is ENGLISH
    assert Languages((german,)).of("de") is german


def test_numbers_have_the_decimal_sign_of_their_language() -> None:
    """Babel is the source of the signs."""
    from babel.numbers import get_decimal_symbol

    for tag in NAMES:
        assert Language(tag, ()).decimal == get_decimal_symbol(tag)


def test_a_catalogue_is_read_as_babel_reads_it() -> None:
    """The quick reader of catalogues gives the same as Babel."""
    from babel.messages.pofile import read_po

    path = engine_catalogues("de")[0]
    assert isinstance(path, Path)
    with path.open("rb") as file:
        known = {(m.id, m.string) for m in read_po(file) if m.id}
    assert {(m.english, m.translation) for m in read_catalogues([path])} == known


def test_a_template_that_begins_with_its_own_text_is_tried_first() -> None:
    """Both templates here have six letters: `Link to:` wins over `checks`."""
    messages = [
        Message("{0} checks", "{0} Prüfungen", ()),
        Message("Link to: {0}", "Link zu: {0}", ()),
        Message("All checks", "Alle Prüfungen", ()),
    ]
    assert Language("de", messages).text("Link to: All checks") == "Link zu: Alle Prüfungen"


def test_languages_with_the_same_messages_share_the_search() -> None:
    """The messages in a text are found once for all languages; each says them in its own words."""
    english = ["{0} messages", "no answer", "{0} on {1}"]
    languages = []
    for tag in ("de", "es"):
        messages = [Message(text, f"{tag} {text}", ()) for text in english]
        languages.append(Language(tag, messages))
    german, spanish = languages
    assert german.phrases is spanish.phrases
    assert german.text("3 messages on no answer") == "de de 3 messages on de no answer"
    assert spanish.text("3 messages on no answer") == "es es 3 messages on es no answer"
    fewer = Language("es", [Message("no answer", "sin respuesta", ())])
    assert fewer.phrases is not german.phrases


def test_a_known_item_holds_the_separator_of_a_list() -> None:
    """`a, b` is one item of `c, a, b`, also with a capital; without such a message the items are two."""
    messages = [Message("one, two", "eins zwei", ()), Message("three", "drei", ())]
    language = Language("de", messages)
    assert language.text("three, one, two") == "drei, eins zwei"
    assert language.text("One, two, three") == "Eins zwei, drei"
    assert language.text("one, four, three") == "one, four, drei"


def test_a_kept_language_remembers_no_text(german: Language) -> None:
    """Texts of students are not kept in a cache."""
    assert german.text("3 messages of type Jane on /a") == "3 Nachrichten des Typs Jane auf /a"
    kept = pickle.dumps(german)
    assert b"Nachrichten" in kept
    assert b"Jane" not in kept
    again = pickle.loads(kept)
    assert again.text("3 messages of type Jane on /a") == "3 Nachrichten des Typs Jane auf /a"
