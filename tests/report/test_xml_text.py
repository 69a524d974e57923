"""Text of students in XML comes back from a parser as it is shown, and is never markup."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

from hypothesis import example, given

from grader.report.escape import shown, xml_text
from tests.report.untrusted_texts import MEGABYTE, hostile

#: XML 1.0, 2.2: what a document may hold.
_ALLOWED = re.compile("[\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]*")


@given(hostile)
@example("]]><x/>")
@example("<!DOCTYPE x [<!ENTITY e SYSTEM 'file:///etc/passwd'>]>&e;")
@example("a\nb\tc  d\r\ne\rf")
def test_a_parser_gives_the_text_back(text: str) -> None:
    """In the contents of an element and in an attribute, one node comes back, with the text that is shown."""
    document = f'<?xml version="1.0" encoding="UTF-8"?>\n<a b="{xml_text(text)}">{xml_text(text)}</a>'
    root = ElementTree.fromstring(document.encode("utf-8"))
    assert list(root) == []
    assert root.attrib == {"b": shown(text)}
    assert (root.text or "") == shown(text)


@given(hostile)
def test_only_characters_of_xml_are_left(text: str) -> None:
    """No character that XML 1.0 cannot hold, no markup, and no `]]>` goes out."""
    written = xml_text(text)
    assert _ALLOWED.fullmatch(written)
    assert not set("<>\"'\n\t\r") & set(written)


def test_a_megabyte_is_cut() -> None:
    """The text is bounded, whatever a student wrote."""
    assert len(xml_text(MEGABYTE)) < 40_000
