"""Checks of written text: README, docstrings, comments and discussion."""

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
    "titles": ["read[_ -]?me", "liesmich", "lisez-moi", "leeme", "leiame", "说明"],
    "commands": [r"python3?\s+\S+\.py"],
    "run_words": ["run", "start"],
}
CODE = {"artifacts": ["it"], "full_from": 0.5}
CONCEPTS: dict[str, Any] = {
    "concepts": {
        "reliability": ["reliab"],
        "latency": ["latenc", "delay"],
        "queue": ["depth", "queue"],
    },
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
    """Return a submission with this text as its only source."""
    return submission({"it.py": text})


# -- README ----------------------------------------------------------------------------------------


def test_a_readme_that_says_all_passes() -> None:
    """Commands and a description of each part earn all, in whatever folder it lies."""
    assert static("readme", README, submission({"README.md": FILLED})).outcome is Outcome.PASSED
    assert (
        static("readme", README, submission({"docs/Readme.TXT": FILLED})).outcome is Outcome.PASSED
    )


@pytest.mark.parametrize(
    "name",
    [
        "LIESMICH.txt",
        "Lisez-moi.md",
        "LEEME.txt",
        "LEIAME",
        "README_ROS.md",
        "readme (1).txt",
        "说明.md",
        "notes.txt",
    ],
)
def test_a_readme_may_have_another_name(name: str) -> None:
    """Other languages have other names for it, and the only text that there is will do."""
    assert (
        static("readme", README, submission({name: FILLED, "it.py": ""})).outcome is Outcome.PASSED
    )


def test_texts_for_programs_are_no_readme() -> None:
    """A list of requirements, a licence or a CMakeLists.txt describes nothing."""
    files = {
        "requirements.txt": "numpy\n",
        "CMakeLists.txt": "project(x)\n",
        "LICENSE.txt": FILLED,
        "it.py": "",
    }
    assert static("readme", README, submission(files)).outcome is Outcome.FAILED


@pytest.mark.parametrize("name", ["README.pdf", "docs/report.docx", "README.ipynb"])
def test_what_only_people_can_read_is_left_to_them(name: str) -> None:
    """A document that cannot be read costs nothing; a note asks a person to read it."""
    record = submission({"it.py": "x = 1\n"})
    record.files.append(FileFact(name, 1000, ""))
    finding = static("readme", README, record)
    assert finding.outcome is Outcome.PASSED
    assert name in finding.notes[0]
    assert static("concepts_explained", CONCEPTS, record).outcome is Outcome.INCONCLUSIVE


def test_a_file_that_holds_several_parts_counts_once() -> None:
    """Nodes in one file share their docstrings, which are no repeats of each other."""
    text = '"""Both nodes of the lab in one file."""\n\n\nclass Node:\n    """Sends what the other one hears."""\n'
    record = submission({"nodes.py": text}, it="nodes.py", other="nodes.py")
    finding = static("code_explained", {**CODE, "artifacts": ["it", "other"]}, record)
    assert finding.outcome is Outcome.PASSED
    assert finding.measured.startswith("files: 1 of 1; ")


def test_each_part_of_a_readme_counts() -> None:
    """A README without a run command loses half, and without a part half of the rest.

    The found passages are listed.
    """
    without_commands = FILLED.replace("Run with:\n\n```\npython3 talk.py\n```\n\n", "")
    assert static("readme", README, submission({"README.md": without_commands})).credit == Decimal(
        "0.5"
    )
    without_part = FILLED.partition("- hear.py")[0]
    finding = static("readme", README, submission({"README.md": without_part}))
    assert finding.credit == Decimal("0.75")
    assert "no mention of hear.py" in finding.reason
    assert finding.counted == (
        "How to run it: README.md, line 6, python3 talk.py",
        "talk.py: README.md, line 6",
        "hear.py: not found",
    )


def test_instructions_without_a_command_are_for_a_person_to_read() -> None:
    """A text like instructions keeps its points, and a note asks a person to read it."""
    text = FILLED.replace("```\npython3 talk.py\n```\n\n", "the button of the editor.\n\n")
    finding = static("readme", README, submission({"README.md": text}))
    assert finding.outcome is Outcome.PASSED
    assert finding.notes == (
        "For a person to read: README.md, line 3, may say how the work is run, though without a command. "
        "The points are given.",
    )


def test_a_long_text_in_unknown_words_is_for_a_person_to_read() -> None:
    """A text that names no part in any way that the grader knows may still tell them apart."""
    text = "python3 main.py\n\n" + " ".join(
        f"słowo{chr(97 + n)}{chr(97 + m)}" for n in range(9) for m in range(9)
    )
    finding = static("readme", README, submission({"README.md": text}))
    assert finding.outcome is Outcome.PASSED
    assert "names no part" in finding.notes[0]


def test_the_students_own_names_count() -> None:
    """A part is found by the name of the file that was handed in."""
    text = FILLED.replace("talk.py", "sprecher.py")
    record = submission(
        {"README.md": text, "src/sprecher.py": "x = 1\n"}, talk="src/sprecher.py", hear="hear.py"
    )
    assert static("readme", README, record).outcome is Outcome.PASSED


ELSEWHERE = (
    "# Turtles\n\n    sudo apt install {0}\n    ros2 run {0} {0}_node\n\nIt draws a square.\n"
)


@pytest.mark.parametrize(
    ("text", "credit"),
    [
        (ELSEWHERE.format("turtlesim"), "0"),
        (ELSEWHERE.format("robots"), "0.5"),
        (f"{ELSEWHERE.format('turtlesim')}\n    python3 <file>.py\n", "0.5"),
        (ELSEWHERE.format("turtlesim") + FILLED, "1"),
        (f"{ELSEWHERE.format('my_pkg')}\nParts: talk.py, hear.py.\n", "0.5"),
    ],
    ids=["other work", "own package", "a placeholder", "this work too", "parts alone"],
)
def test_commands_of_other_work_do_not_run_this_one(text: str, credit: str) -> None:
    """A README of another lab says nothing about this one, unless a command can be for it."""
    files = {"README.md": text, "talk.py": "", "hear.py": "", "setup.py": "name='robots'"}
    commands = [*README["commands"], r"ros2\s+run\s+\S+", r"python3?\s+<\w+>"]
    record = submission(files, talk="talk.py", hear="hear.py")
    finding = static("readme", {**README, "commands": commands}, record)
    assert finding.credit == Decimal(credit)
    assert ("run other work: ros2 run turtlesim" in finding.reason) == (credit == "0")


PROMISES = f"{FILLED}\n{{}}\n"


@pytest.mark.parametrize(
    ("text", "credit", "absent"),
    [
        ("The motion is computed in arm_model.py.", "1", ""),
        ("Start each with `python3 archivo.py`.", "1", ""),
        ("arm_model.py moves it; the plot is docs/plot.png.", "0.5", "docs/plot.png (README.md, "),
        ("one_a.py, one_b.py, one_c.py and one_d.py do the rest.", "0", "one_a.py (README.md, "),
        ("talk.py writes states.csv and log.csv.", "1", ""),
        ("Source /opt/ros/jazzy/setup.sh and install/local_setup.sh.", "1", ""),
        ("Colours by `python3 <file>.py`, see https://example.org/x.py and y/*.py.", "1", ""),
    ],
)
def test_files_that_a_readme_promises_are_there(text: str, credit: str, absent: str) -> None:
    """Two absent files cost; the programs' own files come later, and one name may stand for all parts."""
    files = {
        "README.md": PROMISES.format(text),
        "talk.py": "open('states.csv')\nopen('log.csv')\n",
        "hear.py": "",
    }
    commands = [*README["commands"], r"python3?\s+\S+"]
    wanted = {**README, "commands": commands, "absent_costs": 0.25}
    record = submission(files, talk="talk.py", hear="hear.py")
    finding = static("readme", wanted, record)
    assert finding.credit == Decimal(credit)
    assert absent in finding.reason
    assert static("readme", {**README, "commands": commands}, record).credit == 1


def test_a_readme_that_starts_an_absent_file_loses_points() -> None:
    """A README without all parts means one file by the name, not each of them."""
    text = (
        "# Work\n\nTo run it: `python3 talk.py`, then `python3 demo.py`. talk.py publishes words.\n"
    )
    files = {"README.md": text, "talk.py": "", "hear.py": ""}
    commands = [*README["commands"], r"python3?\s+\S+"]
    record = submission(files, talk="talk.py", hear="hear.py")
    free = static("readme", {**README, "commands": commands}, record)
    wanted = {**README, "commands": commands, "absent_costs": 0.5}
    finding = static("readme", wanted, record)
    assert finding.credit == free.credit / 2
    assert "The submission has no demo.py (README.md, line 3)" in finding.reason


@pytest.mark.parametrize(("extra", "credit"), [({}, "0.25"), ({"main.py": "x = 1\n"}, "0.75")])
def test_the_main_of_each_program_is_no_file_of_this_name(
    extra: dict[str, str], credit: str
) -> None:
    """A README that starts `main.py`, and nothing else, needs this file, though each program has a main()."""
    text = "# Work\n\n`talk.py` publishes words.\n\n```\npython3 main.py\n```\n"
    program = "def main():\n    pass\n\nif __name__ == '__main__':\n    main()\n"
    files = {"README.md": text, "talk.py": program, "hear.py": program, **extra}
    commands = [*README["commands"], r"python3?\s+\S+"]
    wanted = {**README, "commands": commands, "absent_costs": 0.5}
    finding = static("readme", wanted, submission(files, talk="talk.py", hear="hear.py"))
    assert finding.credit == Decimal(credit)
    assert ("run other work: python3 main.py" in finding.reason) == (not extra)


def test_no_readme_fails() -> None:
    """Without any text file there is no README."""
    finding = static("readme", README, submission({"it.py": "x = 1\n"}))
    assert finding.outcome is Outcome.FAILED
    assert finding.reason == "There is no README."


# -- code ------------------------------------------------------------------------------------------

LONG = "        a = 1\n        b = 2\n        c = 3\n        d = 4\n        return a\n"


@pytest.mark.parametrize(("explained", "credit"), [(0, 0.0), (1, 0.333), (2, 0.667), (4, 1.0)])
def test_code_is_credited_by_its_share(explained: int, credit: float) -> None:
    """A file (half) and three functions (half): half explained earns everything.

    Unexplained units are named and shown.
    """
    words = iter(["the rate", "the phase", "the limits", "the order"][:explained])
    text = "class Node:\n" + "".join(
        f"    def f{n}(self):\n        # because of {said}\n{LONG}"
        if said
        else f"    def f{n}(self):\n{LONG}"
        for n, said in enumerate(next(words, "") for _ in range(3))
    )
    text = f"# About {said}\n{text}" if (said := next(words, "")) else text
    finding = static("code_explained", CODE, of(text))
    assert float(finding.credit) == credit
    if credit < 1:
        assert f"explains it.py, f{explained}" in finding.reason
        assert [w.file for w in finding.where] == ["it.py"] * (4 - explained)


@pytest.mark.parametrize(
    ("notes", "credit"),
    [
        ("# Talks to all robots every second\n", 1.0),
        ('"""Talks to robots."""\n', 1.0),
        ("# Talks to robots\n", 0.0),
        ("", 0.0),
    ],
)
def test_a_few_words_in_comments_explain_no_file(notes: str, credit: float) -> None:
    """Comments of five words explain a file, and a docstring does with two."""
    parameters = {**CODE, "full_from": 1.0, "file_words": 5}
    text = f"{notes}import rclpy\n"
    assert float(static("code_explained", parameters, of(text)).credit) == credit


def test_files_may_weigh_more_than_what_is_in_them() -> None:
    """One explained file and an unexplained function earn the weight of the files."""
    parameters = {**CODE, "full_from": 1.0, "file_weight": 0.75}
    text = f'"""Talks to robots."""\nclass Node:\n    def f(self):\n{LONG}'
    assert float(static("code_explained", parameters, of(text)).credit) == 0.75


def test_what_counted_and_what_did_not_is_listed() -> None:
    """Each unit has its explanation; comments without an explanation are listed by kind."""
    text = f'"""Sends commands."""\nclass Node:\n    def f(self):\n        # self.x = 1\n{LONG}\n    def g(self):\n'
    text += f"        # all limits are in rad\n{LONG}"
    assert static("code_explained", CODE, of(text)).counted == (
        "it.py: the file (docstring, line 1); f (nothing); g (comment, line 12). "
        "Not counted: commented-out code (at line 4)",
    )


def test_without_sources_there_is_nothing_to_document() -> None:
    """Files that were not handed in do not count, and none at all fails."""
    assert (
        static("code_explained", CODE, submission({"x.py": ""}, it=None)).measured
        == "no source files"
    )


def test_a_file_with_a_syntax_error_is_no_crash() -> None:
    """A file that cannot be parsed is judged by its readable part, with a note."""
    assert static("code_explained", CODE, of("def broken(:\n    pass\n")).outcome is Outcome.FAILED
    finding = static(
        "code_explained",
        CODE,
        of("# Sends what was asked for\n" + "This is not what was asked for.\n" * 30),
    )
    assert finding.outcome is Outcome.PASSED
    assert "For a person to read" in finding.notes[0]


# -- discussion ------------------------------------------------------------------------------------

DISCUSSED = (
    "# QoS\n\n"
    "With QoS reliable every lost command is sent again, but the latency of all later ones grows while it waits.\n"
    "A QoS queue with a greater depth keeps more messages because the subscriber may fall behind for a moment.\n"
)


def test_concepts_that_are_weighed_pass() -> None:
    """All concepts discussed with reasons earn all, in the README or in the source."""
    assert (
        static("concepts_explained", CONCEPTS, submission({"README.md": DISCUSSED})).outcome
        is Outcome.PASSED
    )
    source = f'"""{DISCUSSED}"""\nx = 1\n'
    finding = static("concepts_explained", {**CONCEPTS, "artifacts": ["it"]}, of(source))
    assert finding.outcome is Outcome.PASSED
    assert finding.where[0].file == "it.py"
    # The deciding text is quoted as a reader sees it.
    assert finding.counted[-1].startswith("it.py, line 1: “")
    assert finding.counted[-1].endswith("”")


MEASURED = DISCUSSED + "\n    fast: 1001 msgs, avg latency: 0.00ms\n"


@pytest.mark.parametrize(
    ("text", "figures", "credit"),
    [
        (MEASURED, "0.25", "0.6"),
        (MEASURED, "0.75", "1"),
        (DISCUSSED, "0.25", "1"),
        (DISCUSSED + "\nA period is 10 ms.\n", "0.25", "1"),
    ],
)
def test_a_text_cannot_argue_from_refuted_figures(text: str, figures: str, credit: str) -> None:
    """A README with measured figures keeps a share if the check of the figures earns half or less."""
    wanted = {**CONCEPTS, "figures_by": "honest", "unfounded_credit": 0.6}
    refuted = {"honest": Finding(Outcome.PARTIAL, Decimal(figures), "", "")}
    record = submission({"README.md": text})
    finding = judged("concepts_explained", wanted, None, record, findings=refuted)
    assert finding.credit == Decimal(credit)
    assert ("argues from measured figures" in finding.reason) == (credit != "1")
    if credit != "1":
        assert str(finding.where[0]) == "README.md:6"


def test_one_concept_is_too_little() -> None:
    """Below the least number of concepts there is no credit."""
    text = "# QoS\n\nThe QoS profile of this lab is reliable for all the commands that we send.\n"
    assert (
        static("concepts_explained", CONCEPTS, submission({"README.md": text})).outcome
        is Outcome.FAILED
    )


def test_a_missing_concept_is_named() -> None:
    """A concept that nobody wrote about is named."""
    text = "\n".join(DISCUSSED.splitlines()[:3])
    finding = static("concepts_explained", CONCEPTS, submission({"README.md": text}))
    assert finding.outcome is Outcome.PARTIAL
    assert (
        "recognised 2 of 3 subjects; 3 give full credit. Not recognised: queue." in finding.reason
    )
    assert finding.counted[0] == "reliability: README.md, line 3"
    assert finding.counted[2] == "queue: not recognised"


def test_a_list_of_settings_earns_a_third() -> None:
    """Concepts that are named without a reason are no discussion."""
    text = "# QoS\n\nThe QoS profiles are reliable and best effort with a depth of 1 to 10.\n"
    text += "\nThe latency of each QoS profile is printed at the end of the run in ms.\n"
    finding = static("concepts_explained", CONCEPTS, submission({"README.md": text}))
    assert float(finding.credit) == pytest.approx(1 / 3, abs=0.001)
    assert "no passage that weighs them" in finding.reason


def test_passages_about_something_else_do_not_count() -> None:
    """Without an anchor a passage is not about the subject."""
    text = DISCUSSED.replace("QoS", "It")
    assert (
        static("concepts_explained", CONCEPTS, submission({"README.md": text})).outcome
        is Outcome.FAILED
    )


def test_of_a_hundred_documents_the_first_are_read() -> None:
    """Text beyond a reader's patience is left unread: the last document alone does not count."""
    padding = "Nothing to see here. " * 5000
    said = f"{FILLED}\n"
    first = {"README.md": said, **{f"d{n}/README.md": padding for n in range(100)}}
    last = {**{f"d{n}/README.md": padding for n in range(100)}, "e/e/e/README.md": said}
    assert (
        static("readme", README, submission(first, talk="talk.py", hear="hear.py")).outcome
        is Outcome.PASSED
    )
    assert (
        static("readme", README, submission(last, talk="talk.py", hear="hear.py")).outcome
        is Outcome.FAILED
    )


def test_a_part_that_was_not_handed_in_needs_no_description() -> None:
    """A missing file is charged where it is missed, and not in the README again."""
    text = FILLED[: FILLED.index("- hear.py")]
    assert (
        static("readme", README, submission({"README.md": text}, talk="talk.py", hear=None)).credit
        == 1
    )
    assert (
        static(
            "readme", README, submission({"README.md": text}, talk="talk.py", hear="hear.py")
        ).credit
        < 1
    )


ROOT = Path(__file__).resolve().parents[2]


def by_the_lab(check: str, texts: dict[str, str]) -> Finding:
    """Judge texts by a check of the lab's own rubric; `it.py` is the program that compares profiles."""
    spec = next(spec for spec in read_rubric(None).checks() if spec.id == check)
    record = submission({"it.py": "", **texts}, qos="it.py")
    return judged(spec.check, spec.parameters.model_dump(), None, record)


def notes_on(text: str) -> tuple[str, ...]:
    """Return the notes about the QoS text of a README, by the lab's own rubric."""
    return by_the_lab("qos.explains", {"README.md": text}).notes


def test_words_without_sentences_are_for_a_person_to_read() -> None:
    """A mere list of technical words keeps its points, and a note points at the list."""
    salad = (ROOT / "fixtures/qos_word_salad/submission/README.md").read_text(encoding="utf-8")
    assert notes_on(salad) == (
        "For a person to read: README.md, line 8, seems to be words, not sentences.",
    )


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


UNCLEAR = {
    "short sentences": "Reliable resends lost messages, which costs latency. Best effort drops them.",
    "short items": "QoS:\n\n- reliable: no loss, more delay\n- best effort: loss, less delay\n",
    "Finnish": "Luotettava (reliable) tila takaa viestit mutta viive kasvaa, best effort hukkaa viestejä "
    "mutta on nopeampi antureille kuin toinen tila.",
}
RESULTS = """QoS:

best_effort  :  1000 msgs, avg latency: 0.41ms, max: 1.93ms
reliable     :  1000 msgs, avg latency: 0.47ms, max: 2.04ms
control      :     0 msgs, no latency data
"""


def test_a_table_of_results_is_not_a_short_text() -> None:
    """Printed numbers discuss nothing, and nobody has to read them."""
    found = by_the_lab("qos.explains", {"README.md": RESULTS})
    assert found.outcome is Outcome.FAILED


CLEAR = {
    "Polish": "Profil reliable zwiększa opóźnienie, ale nie gubi wiadomości. Best effort może je gubić, za to "
    "nadaje się do czujników.",
    "fourteen words": "Reliable guarantees delivery but adds latency; best effort is faster but may lose messages.",
}


@pytest.mark.parametrize("text", UNCLEAR.values(), ids=UNCLEAR)
def test_a_short_or_foreign_text_is_left_to_a_person(text: str) -> None:
    """A text that the grader does not understand is undecided, and named with its line."""
    found = by_the_lab("qos.explains", {"README.md": text})
    assert found.outcome is Outcome.INCONCLUSIVE
    assert "a person has to read it: README.md, line" in found.reason


@pytest.mark.parametrize("text", CLEAR.values(), ids=CLEAR)
def test_a_clear_text_earns_its_part(text: str) -> None:
    """Two weighed subjects of four earn at least half."""
    found = by_the_lab("qos.explains", {"README.md": text})
    assert found.outcome is Outcome.PARTIAL
    assert found.credit >= Decimal("0.6")


def test_given_text_is_no_readme() -> None:
    """A copy of the handout earns nothing; a README of the student's own does."""
    record = submission({"README.md": FILLED})
    assert static("readme", README, record).outcome is Outcome.PASSED
    record.given_texts = {"handout/README.md": FILLED}
    assert static("readme", README, record).credit == 0


def test_a_readme_is_asked_for_missing_texts_alone() -> None:
    """Its own commands and names are not asked for."""
    text = "Run it:\n\n```\npython3 talk.py\n```\n\ntalk.py publishes sinusoidal commands for the arm.\n"
    finding = static("readme", README, submission({"README.md": text}))
    assert finding.hint == "Add a few words about hear.py."


def test_a_discussion_is_asked_for_the_missing_concepts_alone() -> None:
    """The rubric's hint asks for all of them."""
    text = "# QoS\n\nReliable delivery costs a delay on bad links, because lost messages are sent again there.\n"
    wanted = {**CONCEPTS, "least_concepts": 1}
    finding = static("concepts_explained", wanted, submission({"README.md": text}))
    assert finding.measured == "reliability, latency discussed"
    assert finding.hint == "Add one sentence in the README about one of these each: queue."


def test_concepts_are_found_at_their_lines() -> None:
    """A docstring of many lines is no place by its first one; the passage with the most concepts comes first."""
    source = (
        '"""QoS: it is reliable.\n\nSome other words stand here, about this and that.\n\n'
        'The delay of a message grows with the depth, because reliable links send again.\n"""\n'
    )
    finding = static("concepts_explained", {**CONCEPTS, "artifacts": ["it"]}, of(source))
    lines = {place.line for place in finding.where}
    assert lines == {1, 5}


def test_units_are_counted_by_their_kind() -> None:
    """Files are half, classes and functions the other half, so their numbers stand apart."""
    finding = static(
        "code_explained", CODE, of('"""Publish commands to the arm."""\nrate_hz = 100\n')
    )
    assert (
        finding.measured == "files: 1 of 1; classes and functions: 0 of 0; with these weights 100%"
    )


def test_the_places_without_a_text_are_named() -> None:
    """A text elsewhere is not looked for, so that nobody is told that it does not exist."""
    record = submission({"README.md": "Run it."}, it=None)
    finding = static("concepts_explained", {**CONCEPTS, "artifacts": ["it"]}, record)
    assert "It read README.md. There is no it.py." in finding.reason
    finding = static("concepts_explained", {**CONCEPTS, "artifacts": ["it"]}, submission())
    assert "It read it.py. There is no README." in finding.reason


def test_given_text_discusses_nothing() -> None:
    """Only sentences of the student's own discuss a concept."""
    given = "QoS matters: reliable delivery has a delay because lost messages of the queue come again.\n"
    record = submission({"README.md": given})
    assert static("concepts_explained", CONCEPTS, record).outcome is Outcome.PASSED
    record.given_texts = {"handout/README.md": given}
    assert static("concepts_explained", CONCEPTS, record).credit == 0


def test_a_summary_of_the_grader_explains_nothing() -> None:
    """A job leaves the summary of its last run beside the work."""
    summary = f"{CLEAR['fourteen words']}\n\nThe evidence for each point is in `report.html`, among the files.\n"
    found = by_the_lab("qos.explains", {"summary.md": summary, "release-body.md": summary})
    assert found.outcome is Outcome.FAILED


@pytest.mark.parametrize(
    "note",
    [
        "# Lab 09-01: ROS 2\n",
        "# Author: Jane Doe\n# Date: 2026-11-28\n",
        "# if enabled:\n#     return response\n",
        "# last_command = None\n",
        "// response->success = true;\n".replace("//", "#"),
    ],
)
def test_a_head_or_switched_off_code_explains_nothing(note: str) -> None:
    """The lab's number, the author, and commented-out code say nothing about a file."""
    source = f"{note}\nimport os\n\nprint(os.name)\n"
    found = by_the_lab("documentation.code", {"it.py": source})
    assert found.outcome is Outcome.FAILED
