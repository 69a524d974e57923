"""Explanations in sources of C and C++."""

from __future__ import annotations

import time

import pytest

from grader.evidence.text.source import Note, SourceFacts
from grader.evidence.text.sources import read_sources

NODE = """\
// Copyright 2026 Ann

// Publishes the voltage of a battery.
#include <rclcpp/rclcpp.hpp>

/** @brief Measures and sends. */
class Battery : public rclcpp::Node
{
public:
  Battery() : Node("battery")
  {
    timer_ = create_wall_timer(500ms, [this]() { send(); });
  }

private:
  /// Sends the mean of the last values,
  /// rounded to millivolts.
  void send()
  {
    double sum = 0;
    for (double value : values_) {
      sum += value;
    }
    publisher_->publish(sum);  // at once
  }

  void unexplained()
  {
    // send();
    // int x = 3;
    one();
    two();
    three();
    four();
  }
};

struct Other { int x; };

int main(int argc, char ** argv)
{
  return 0;
}
"""


def read(text: str) -> SourceFacts:
    """Return the facts of one file."""
    (facts,) = read_sources({"src/battery.cpp": text})
    return facts


def explained(facts: SourceFacts) -> dict[str, bool]:
    """Return for each unit that needs an explanation whether it has one."""
    found = {}
    for unit in facts.units:
        if unit.needed:
            found[unit.name] = unit.explained_by is not None
    return found


def notes_of(facts: SourceFacts) -> dict[int, Note]:
    """Return the notes by their first lines."""
    found = {}
    for note in facts.notes:
        found[note.line] = note
    return found


def test_comments_explain_the_unit_below_or_around_them() -> None:
    """Doxygen and plain comments count; code that is commented out and licences do not."""
    facts = read(NODE)
    assert facts.readable
    assert explained(facts) == {
        "battery.cpp": True,
        "Battery": True,
        "send": True,
        "unexplained": False,
        "Other": False,
    }
    found = notes_of(facts)
    assert found[1].fault == "a licence"
    assert found[29].fault == "commented-out code"
    assert (found[3].kind, found[6].kind, found[16].kind) == ("comment", "docstring", "docstring")


def test_a_block_of_lines_is_one_comment() -> None:
    """Lines of one block belong together, and a comment behind code is a note of its own."""
    found = notes_of(read(NODE))
    assert found[16].text == "Sends the mean of the last values,\nrounded to millivolts."
    assert found[24].text == "at once"


#: A body of more lines than a short function has.
BODY = "{\n  a();\n  b();\n  c();\n  d();\n  e();\n}\n"


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (f"int add(int a)\n{BODY}", {"battery.cpp"}),
        (f"void Battery::send()\n{BODY}void f()\n{BODY}", {"battery.cpp", "send", "f"}),
        ("", set()),
    ],
)
def test_units_that_need_an_explanation(text: str, names: set[str]) -> None:
    """The only function shares the file's notes; an empty file needs none."""
    assert set(explained(read(text))) == names


def test_a_comment_that_repeats_the_code_explains_nothing() -> None:
    """Words of the line below add nothing."""
    (note,) = read("// send value\nvoid send_value() {}\n").notes
    assert note.fault == "repeats the code"


@pytest.mark.parametrize(
    "piece", ["a::b<c>::", "a<", "<!--", "((", "a(b)(c)", "/*", '"', "{", "#if a\n"]
)
def test_hostile_texts_are_bounded(piece: str) -> None:
    """A text that costs the parser more than code of its length has no units."""
    start = time.process_time()
    read(piece * (60_000 // len(piece)))
    assert time.process_time() - start < 20
