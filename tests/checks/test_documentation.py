"""Checks of what is written: README, docstrings, comments and discussion."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from grader.judging.rubrics import read_rubric
from grader.recording.submission import FileFact, SubmissionRecord
from grader.result import Finding, Outcome
from tests.synthetic import judged, submission

README: dict[str, Any] = {
    "parts": [
        {"artifact": "talk", "names": ["talk.py"]},
        {"artifact": "hear", "names": ["hear.py"]},
    ],
    "words_each": 4,
    "commands": [r"python3?\s+\S+"],
}
DOCSTRINGS = {"artifacts": ["it"], "full_from": 0.6, "zero_to": 0.1}
COMMENTS = {"artifacts": ["it"], "full_per_100_lines": 4, "zero_to_per_100_lines": 1}
CONCEPTS: dict[str, Any] = {
    "concepts": {"reliability": ["reliab"], "latency": ["latenc", "delay"], "queue": ["depth", "queue"]},
    "reasons": ["because", "but$", "while$"],
    "anchors": ["QoS"],
    "min_words": 6,
    "full_concepts": 3,
    "least_concepts": 2,
}
FILLED = (
    "# Lab\n\nRun with:\n\n```\npython3 talk.py\n```\n\n"
    "- talk.py publishes sinusoidal commands for all seven joints of the arm.\n"
    "- hear.py compares commands with measured states, and prints tracking errors.\n"
)


def static(check: str, parameters: dict[str, Any], record: SubmissionRecord) -> Finding:
    """Judge a submission's texts."""
    return judged(check, parameters, None, record)


def of(text: str) -> SubmissionRecord:
    """Give a submission whose only source is this."""
    return submission({"it.py": text})


# -- README ----------------------------------------------------------------------------------------


def test_a_readme_that_says_all_passes() -> None:
    """Commands and a description of each part earn all, in whatever folder it lies."""
    assert static("readme", README, submission({"README.md": FILLED})).outcome is Outcome.PASSED
    assert static("readme", README, submission({"docs/Readme.TXT": FILLED})).outcome is Outcome.PASSED


@pytest.mark.parametrize(
    "name",
    ["LIESMICH.txt", "Lisez-moi.md", "LEEME.txt", "LEIAME", "README_ROS.md", "readme (1).txt", "说明.md", "notes.txt"],
)
def test_a_readme_may_have_another_name(name: str) -> None:
    """Other languages have other names for it, and the only text that there is will do."""
    assert static("readme", README, submission({name: FILLED, "it.py": ""})).outcome is Outcome.PASSED


def test_texts_for_programs_are_no_readme() -> None:
    """A list of requirements, a licence or a CMakeLists.txt describes nothing."""
    files = {"requirements.txt": "numpy\n", "CMakeLists.txt": "project(x)\n", "LICENSE.txt": FILLED, "it.py": ""}
    assert static("readme", README, submission(files)).outcome is Outcome.FAILED


@pytest.mark.parametrize("name", ["README.pdf", "docs/report.docx", "README.ipynb"])
def test_what_only_people_can_read_is_left_to_them(name: str) -> None:
    """A document that cannot be read decides nothing, and costs nothing; beside a README it does not matter."""
    record = submission({"it.py": "x = 1\n"})
    record.files.append(FileFact(name, 1000, ""))
    finding = static("readme", README, record)
    assert (finding.outcome, finding.retry) == (Outcome.INCONCLUSIVE, False)
    assert name in finding.reason
    assert static("concepts_explained", CONCEPTS, record).outcome is Outcome.INCONCLUSIVE
    both = submission({"README.md": "# Lab\n"})
    both.files.append(FileFact(name, 1000, ""))
    assert static("readme", README, both).outcome is Outcome.FAILED


def test_a_file_that_holds_several_parts_counts_once() -> None:
    """Nodes in one file share their docstrings, which are no repeats of each other."""
    text = '"""Both nodes of the lab in one file."""\n\n\nclass Node:\n    """Sends what the other one hears."""\n'
    record = submission({"nodes.py": text}, it="nodes.py", other="nodes.py")
    finding = static("docstrings", {**DOCSTRINGS, "artifacts": ["it", "other"]}, record)
    assert finding.outcome is Outcome.PASSED
    assert finding.measured.startswith("1 of 1")


def test_each_part_of_a_readme_counts() -> None:
    """Without commands a quarter is lost, without a description half of the rest."""
    without_commands = FILLED.replace("python3 talk.py", "see below")
    assert static("readme", README, submission({"README.md": without_commands})).credit == Decimal("0.75")
    without_part = FILLED.partition("- hear.py")[0]
    finding = static("readme", README, submission({"README.md": without_part}))
    assert finding.credit == Decimal("0.625")
    assert "what hear.py does" in finding.reason


def test_a_list_of_names_describes_nothing() -> None:
    """Names without a sentence are no descriptions."""
    finding = static("readme", README, submission({"README.md": "# Lab\n\n- talk.py\n- hear.py\n"}))
    assert finding.outcome is Outcome.FAILED


def test_no_readme_fails() -> None:
    """Without any text file there is no README."""
    finding = static("readme", README, submission({"it.py": "x = 1\n"}))
    assert finding.outcome is Outcome.FAILED
    assert finding.reason == "There is no README."


# -- docstrings ------------------------------------------------------------------------------------


def test_docstrings_are_credited_by_their_share() -> None:
    """All documented passes, nothing documented fails and the places are shown."""
    good = '"""Publishes commands at a fixed rate."""\n\n\ndef run():\n    """Start the node and let it spin."""\n'
    assert static("docstrings", DOCSTRINGS, of(good)).outcome is Outcome.PASSED
    bare = "class Node:\n    def tick(self):\n        return 1\n\n    def stop(self):\n        return 2\n"
    finding = static("docstrings", DOCSTRINGS, of(bare))
    assert finding.outcome is Outcome.FAILED
    assert [w.file for w in finding.where] == ["it.py"] * len(finding.where) != []


def test_without_sources_there_is_nothing_to_document() -> None:
    """Files that were not handed in do not count, and none at all fails."""
    for check, parameters in (("docstrings", DOCSTRINGS), ("comments", COMMENTS)):
        finding = static(check, parameters, submission({"x.py": ""}, it=None))
        assert finding.measured == "no source files"


def test_a_file_with_a_syntax_error_is_no_crash() -> None:
    """What cannot be parsed is judged by what can be read of it."""
    for check, parameters in (("docstrings", DOCSTRINGS), ("comments", COMMENTS)):
        assert static(check, parameters, of("def broken(:\n    pass\n")).outcome.decided


# -- comments --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("comments", "credit"), [(0, 0.0), (1, 0.0), (2, 1 / 3), (4, 1.0), (9, 1.0)])
def test_comments_are_credited_by_their_density(comments: int, credit: float) -> None:
    """In 100 lines, one comment earns nothing, four earn all, and in between the line holds."""
    reasons = ["rate", "limit", "phase", "queue", "clock", "order", "units", "start", "signal"]
    lines = [f"# The {reason} is chosen so that the arm does not overshoot" for reason in reasons[:comments]]
    code = [f"value_{n} = {n}" for n in range(100)]
    finding = static("comments", COMMENTS, of("\n".join(lines + code) + "\n"))
    assert float(finding.credit) == pytest.approx(credit, abs=0.01)


def test_code_that_is_commented_out_explains_nothing() -> None:
    """Lines of code behind a # are no comments, and the reason says so."""
    lines = ["# value_1 = compute(3)", "# self.timer = self.create_timer(0.01, self.tick)"] * 4
    finding = static("comments", COMMENTS, of("\n".join(lines + ["x = 1"] * 100) + "\n"))
    assert finding.outcome is Outcome.FAILED
    assert "commented-out code" in finding.reason


# -- discussion ------------------------------------------------------------------------------------

DISCUSSED = (
    "# QoS\n\n"
    "With QoS reliable every lost command is sent again, but the latency of all later ones grows while it waits.\n"
    "A QoS queue with a greater depth keeps more messages because the subscriber may fall behind for a moment.\n"
)


def test_concepts_that_are_weighed_pass() -> None:
    """All concepts discussed with reasons earn all, in the README or in the source."""
    assert static("concepts_explained", CONCEPTS, submission({"README.md": DISCUSSED})).outcome is Outcome.PASSED
    source = f'"""{DISCUSSED}"""\nx = 1\n'
    finding = static("concepts_explained", {**CONCEPTS, "artifacts": ["it"]}, of(source))
    assert finding.outcome is Outcome.PASSED
    assert finding.where[0].file == "it.py"


def test_one_concept_is_too_little() -> None:
    """Below the least number of concepts there is no credit."""
    text = "# QoS\n\nThe QoS profile of this lab is reliable for all the commands that we send.\n"
    assert static("concepts_explained", CONCEPTS, submission({"README.md": text})).outcome is Outcome.FAILED


def test_a_missing_concept_is_named() -> None:
    """What nobody wrote about is told."""
    text = "\n".join(DISCUSSED.splitlines()[:3])
    finding = static("concepts_explained", CONCEPTS, submission({"README.md": text}))
    assert finding.outcome is Outcome.PARTIAL
    assert "Nothing is said about queue" in finding.reason


def test_a_list_of_settings_earns_a_third() -> None:
    """Concepts that are named without a reason are no discussion."""
    text = "# QoS\n\nThe QoS profiles are reliable and best effort with a depth of 1 to 10.\n"
    text += "\nThe latency of each QoS profile is printed at the end of the run in ms.\n"
    finding = static("concepts_explained", CONCEPTS, submission({"README.md": text}))
    assert float(finding.credit) == pytest.approx(1 / 3, abs=0.001)
    assert "not set in relation" in finding.reason


def test_passages_about_something_else_do_not_count() -> None:
    """Without an anchor a passage is not about the subject."""
    text = DISCUSSED.replace("QoS", "It")
    assert static("concepts_explained", CONCEPTS, submission({"README.md": text})).outcome is Outcome.FAILED


def test_of_a_hundred_documents_the_first_are_read() -> None:
    """More than anybody would read is left unread: what only the last one says does not count."""
    padding = "Nothing to see here. " * 5000
    said = f"{FILLED}\n"
    first = {"README.md": said, **{f"d{n}/README.md": padding for n in range(100)}}
    last = {**{f"d{n}/README.md": padding for n in range(100)}, "e/e/e/README.md": said}
    assert static("readme", README, submission(first, talk="talk.py", hear="hear.py")).outcome is Outcome.PASSED
    assert static("readme", README, submission(last, talk="talk.py", hear="hear.py")).outcome is Outcome.FAILED


def test_a_part_that_was_not_handed_in_needs_no_description() -> None:
    """A missing file is charged where it is missed, and not in the README again."""
    text = FILLED[: FILLED.index("- hear.py")]
    assert static("readme", README, submission({"README.md": text}, talk="talk.py", hear=None)).credit == 1
    assert static("readme", README, submission({"README.md": text}, talk="talk.py", hear="hear.py")).credit < 1


ROOT = Path(__file__).resolve().parents[2]


def notes_on(text: str) -> tuple[str, ...]:
    """Give the notes on what a README says of QoS, by the lab's own rubric."""
    spec = next(spec for spec in read_rubric(None).checks() if spec.id == "qos.explains")
    record = submission({"README.md": text, "it.py": ""}, qos="it.py")
    return judged(spec.check, spec.parameters.model_dump(), None, record).notes


def test_words_without_sentences_are_for_a_person_to_read() -> None:
    """What only strings the words of the matter together keeps its points, and a note points at it."""
    salad = (ROOT / "fixtures/qos_word_salad/submission/README.md").read_text(encoding="utf-8")
    assert notes_on(salad) == ("For a person to read: README.md, line 8, seems to be words, not sentences.",)


@pytest.mark.parametrize(
    "text",
    [
        "## QoS\n- RELIABLE: resends lost messages, higher latency\n- BEST_EFFORT: newest sensor data, may drop",
        "Mit RELIABLE wird jede verlorene Nachricht erneut gesendet und das kostet Zeit die ein Sensor nicht hat denn "
        "alte Werte nutzen dort nichts während ein Befehl ankommen muss",
        "Надёжная доставка повторяет потерянные сообщения и это даёт задержку поэтому для датчиков лучше best effort "
        "а для команд надёжность важнее",
        "可靠的QoS会重传丢失的消息因此延迟更高传感器数据用尽力而为因为最新的数据比完整的历史更重要命令需要可靠",
        "विश्वसनीय QoS खोए संदेश फिर भेजता है इसलिए विलंब बढ़ता है जबकि सेंसर के लिए नवीनतम मान बेहतर है",
    ],
)
def test_no_sentence_of_any_language_is_taken_for_words_alone(text: str) -> None:
    """Lists with marks, other languages and other scripts are not pointed out."""
    assert notes_on(text) == ()
