"""Descriptions, instructions and discussions in READMEs and sources of any language."""

from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.text.markup import Block, read_markdown
from grader.evidence.text.prose import (
    Discussion,
    Passage,
    command_lines,
    concepts,
    document_passages,
    instruction_line,
    mention,
    source_passages,
    visible,
)
from grader.evidence.text.sources import read_sources
from grader.evidence.text.words import Terms
from tests.thorough import part

NAMES = Terms.of(["talker.py", "talker", "listener.py", "listener", "switch_service"], 3)
PLACEHOLDERS = (r"^\W*todo\b", "lorem ipsum")
RUN = (r"python3?\s+\S+\.py", r"ros2\s+(?:run|launch)\s+\S+")
LEXICON = {
    "reliability": [
        "reliab",
        "best effort",
        "lost",
        "lose",
        "drop",
        "*verlust",
        "verlor",
        "zuverlässig",
        "perd",
        "fiab",
        "потер",
        "надёжн",
        "丢失",
        "可靠",
        "欠落",
        "信頼性",
        "손실",
        "فقد",
        "विश्वसनीय",
        "kayb",
    ],
    "latency": [
        "latenc",
        "delay",
        "newest",
        "*verzöger",
        "retras",
        "retard",
        "задерж",
        "延迟",
        "遅延",
        "지연",
        "تأخير",
        "التأخير",
        "विलंब",
        "gecik",
    ],
    "use": [
        "sensor",
        "command",
        "befehl",
        "comando",
        "capteur",
        "commande",
        "датчик",
        "команд",
        "传感器",
        "命令",
        "センサ",
        "コマンド",
        "센서",
        "명령",
        "مستشعر",
        "أوامر",
        "सेंसर",
        "sensör",
        "komut",
    ],
}
REASONS = (
    "because",
    "so that",
    "whereas",
    "but$",
    "weil",
    "dagegen",
    "porque",
    "car$",
    "потому",
    "因为",
    "ため",
    "때문",
    "لأن",
    "क्योंकि",
    "çünkü",
)


def shown(text: str) -> list[Block]:
    """Pieces of a README that say something."""
    return visible(read_markdown(text), NAMES, PLACEHOLDERS)[0]


def discussion(*texts: str, anchors: tuple[str, ...] = ()) -> Discussion:
    """Return the concepts and reasons in some passages."""
    passages = [Passage(text, "README.md", number) for number, text in enumerate(texts, 1)]
    return concepts(passages, LEXICON, REASONS, anchors)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "# talker.py\n\n# listener.py\n\n# switch_service.py\n",
        "# talker.py\nTODO\n# listener.py\n- TODO: describe it\n# switch_service.py\n<description of the node>\n",
        "# talker.py\nLorem ipsum dolor sit amet, consectetur adipiscing elit, sed do eiusmod.\n",
        "| talker.py | TODO |\n",
        "# talker.py\n```python\nimport rclpy\nx = 1\n```\n",
        "# talker.py\n\n    def f():\n        return 1\n",
        "<!-- talker.py sends the wanted joint angles to the arm at a rate -->\n",
    ],
    ids=["nothing", "empty headings", "todo", "lorem", "row", "code", "indented code", "comment"],
)
def test_what_says_nothing_is_not_seen(text: str) -> None:
    """Headings, templates, blind text and source are nothing to read."""
    assert shown(text) == []


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("# Lab\n\n- talker.py\n- listener.py\n", 3),
        ("# Lab\n```\nsrc/\n  talker.py  sends\n```\n", 4),
        ("# Lab\n\nWords.\n\n## The talker\n\nSends things.\n", 5),
        ("# Lab\n\nOnly a sender is here.\n", 3),
        ("# Lab of a sender\n\n## Other\n\nWords without it.\n", None),
    ],
)
def test_a_part_is_found_where_it_is_named(text: str, line: int | None) -> None:
    """In lists, trees, headings with something below, and by a synonym, but for the title of it all."""
    assert mention(shown(text), Terms.of(["talker"], 3), Terms.of(["sender"], 3)) == line


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("```bash\n$ ros2 run pkg talker\n```\n", 2),
        ("Use `python3 talker.py` to start.\n", 1),
        ("Start it:\n\n    python3 talker.py\n", 3),
        ("$ ros2 launch pkg all.launch.py\n", 1),
        ("1. run ros2 run pkg talker in a shell\n", 1),
        (".. code-block:: sh\n\n   ros2 run pkg talker\n", 3),
    ],
)
def test_commands_are_found_wherever_they_stand(text: str, line: int) -> None:
    """Blocks, spans, prompts and plain lines with a command say how to run the work."""
    found = next(command_lines(shown(text), RUN), None)
    assert found is not None
    assert found[0] == line


def test_talk_about_running_is_no_instruction() -> None:
    """A README without a command does not say how to run anything."""
    text = "# Running\nRun all the nodes with ros2 and python.\n"
    assert list(command_lines(shown(text), RUN)) == []


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("# Lab\n\nWords.\n\n## How to start it\n\nPress the button in the editor.\n", 5),
        ("To start the nodes, press the button.\n", 1),
        ("Everything here starts together and runs at 100 Hz.\n", None),
        ("## Start\n\n## Other\n\nWords.\n", None),
        ("The two nodes run with `python3`.\n", 1),
        ("The two nodes run with Python.\n", None),
    ],
)
def test_instructions_in_words_are_seen(text: str, line: int | None) -> None:
    """A heading with text below, or a sentence that begins so, may say how the work is run; mere talk does not."""
    assert instruction_line(shown(text), ["start", "run"]) == line


@pytest.mark.parametrize(
    "text",
    [
        "For sensor data best effort is enough, because a lost sample is soon followed by the newest "
        "one and the delay stays small.",
        "Für Sensordaten reicht best_effort, weil ein Paketverlust gleich durch den nächsten Wert "
        "ersetzt wird und die Verzögerung klein bleibt.",
        "Para los sensores uso best_effort porque perder una muestra no importa y el retraso es menor "
        "que con reintentos.",
        "Pour les capteurs, best_effort suffit car un message perdu est sans conséquence et le retard reste faible.",
        "Для датчиков подходит best_effort, потому что потеря одного сообщения не важна, а задержка остаётся меньше.",
        "传感器数据用 best_effort，因为丢失一帧没有关系，延迟更低；控制命令必须可靠送达。",
        "センサーデータは欠落しても次の値がすぐ届くため、遅延の小さいベストエフォートを使う。",
        "센서 데이터는 한 번 손실되어도 곧 새 값이 오기 때문에 지연이 적은 best_effort가 좋다고 생각한다.",
        "نستخدم best_effort لبيانات المستشعر لأن فقد رسالة واحدة لا يهم والتأخير أقل مع هذا الإعداد",
        "सेंसर डेटा के लिए best_effort अच्छा है क्योंकि एक संदेश खोने से फर्क नहीं पड़ता और विलंब कम रहता है।",
        "Sensör verisinde best_effort kullanılır çünkü bir mesajın kaybı önemli değildir ve gecikme azalır.",
    ],
    ids=["en", "de", "es", "fr", "ru", "zh", "ja", "ko", "ar", "hi", "tr"],
)
def test_trade_offs_are_understood_in_any_language(text: str) -> None:
    """A reasoned comparison of several concepts is seen in every language of the lexicon."""
    found = discussion(text)
    assert set(found.discussed) == {"reliability", "latency", "use"}
    assert len(found.related) == 1


def test_a_language_without_reason_words_is_accepted_at_length() -> None:
    """In a language that the lexicon does not know, terms of the trade and enough words relate concepts."""
    text = (
        "Dla czujników wybieram best_effort, bo utrata jednej wiadomości nie szkodzi, a latency jest "
        "mniejsza niż przy ponownym "
        "wysyłaniu; rozkazy muszą dojść zawsze, dlatego tam reliable."
    )
    found = discussion(text)
    assert set(found.discussed) == {"reliability", "latency"}
    assert len(found.related) == 1


@pytest.mark.parametrize(
    "texts",
    [
        ["reliable, best_effort, latency, delay, sensor, command"],
        [
            "`QoSProfile(reliability=RELIABLE, depth=10)  # because latency of the sensor matters to us all`"
        ],
        [
            "reliable latency lost sensor command because best effort delay drop newest reliable "
            "latency one two three four"
        ],
        ["TODO explain reliability and latency"],
        ["The nodes work well together and everything was fun to write this week."],
        [""],
        [],
    ],
    ids=["list", "code", "stuffing", "todo", "other matters", "empty", "nothing"],
)
def test_lists_and_stuffing_discuss_nothing(texts: list[str]) -> None:
    """Names of policies without words around them are no discussion."""
    found = discussion(*texts)
    assert (found.discussed, found.related) == ({}, ())


def test_repeated_passages_count_once() -> None:
    """The same paragraph twice is one."""
    text = (
        "For sensor data best effort is enough because the newest sample replaces a lost one soon."
    )
    assert len(discussion(text, text).related) == 1


def test_anchors_keep_to_the_matter() -> None:
    """With anchors, only passages about the matter count, be it by their heading."""
    text = "The sensor values are lost on purpose whenever a delay of the arm is seen by us, because they are wrong."
    assert discussion(text).related
    assert not discussion(text, anchors=("QoS",)).related
    document = read_markdown(f"## QoS\n{text}\n")
    found = concepts(document_passages(document, "README.md"), LEXICON, REASONS, ("QoS",))
    assert found.related[0].line == 2


def test_passages_of_source_are_docstrings_and_comment_blocks() -> None:
    """Comments on consecutive lines are one passage; code put aside is none."""
    text = (
        '"""Compare several profiles of quality."""\nx = 1\n# Best effort is fine for sensors,\n# '
        "as a lost sample is replaced soon.\n# self.y = 2\n"
    )
    passages = source_passages(read_sources({"a.py": text})[0])
    assert [(p.line, p.text) for p in passages] == [
        (1, "Compare several profiles of quality."),
        (3, "Best effort is fine for sensors,\nas a lost sample is replaced soon."),
    ]


def test_passages_of_a_document_join_lists_and_tables() -> None:
    """A list or a table is one passage, a paragraph is one; code is none."""
    text = "Words one.\n\n- a\n- b\n\n| c | d |\n| e | f |\n\n```\ncode\n```\n"
    assert [p.line for p in document_passages(read_markdown(text), "README.md")] == [1, 3, 6]


@pytest.mark.parametrize(
    "piece",
    part(
        [
            "a",
            "`",
            "[",
            "](",
            "![",
            "<a ",
            "- ",
            "# a\n",
            "|",
            "--- x ",
            "-=",
            "*a",
            "**a** ",
            "talker ",
            "talker. ",
            "。",
            "```\n",
            "::\n    a\n",
            "x\n---\n",
            "best effort ",
            "\n",
            "> ",
        ],
        3,
    ),
)
def test_hostile_documents_take_bounded_time(piece: str) -> None:
    """A megabyte of anything is read in a bounded time."""
    text = (piece * (1_000_000 // len(piece) + 1))[:1_000_000]
    started = time.process_time()
    document = read_markdown(text)
    blocks, _ = visible(document, NAMES, PLACEHOLDERS)
    mention(blocks, NAMES, NAMES)
    list(command_lines(blocks, RUN))
    instruction_line(blocks, ["run"])
    concepts(document_passages(document, "README.md"), LEXICON, REASONS)
    assert time.process_time() - started < 5, "ten times what an idle machine takes"


@given(st.text(max_size=400))
def test_any_text_is_read(text: str) -> None:
    """No text raises."""
    document = read_markdown(text)
    blocks, _ = visible(document, NAMES, PLACEHOLDERS)
    mention(blocks, NAMES, NAMES)
    list(command_lines(blocks, RUN))
    instruction_line(blocks, ["run"])
    concepts(document_passages(document, "README.md"), LEXICON, REASONS)
