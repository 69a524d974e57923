"""Mails to students: read back as mail programs do, whatever a name, an address or a report is."""

from __future__ import annotations

import dataclasses
import email
import io
import mailbox
import zipfile
from email.message import EmailMessage
from email.policy import default
from pathlib import Path

import pytest

from grader.cohort.entries import ClassEntry
from grader.recording.submission import Identity, Person
from grader.report.exports import CLASS_EXPORTS
from grader.report.exports.returned import ReturnedClass
from tests.cohort.made_up import entry_of, result_of
from tests.report.exports.returned_class import LAB

REPORT = "<p>Grüße\nFrom here on: \u2713\n.\n--=_\n"


def entry(tmp_path: Path, name: str, *people: Person, reason: str = "") -> ClassEntry:
    """Give a submission of some people, with a report."""
    (tmp_path / name).mkdir()
    (tmp_path / name / "report.html").write_text(REPORT, encoding="utf-8", newline="")
    plain = result_of(LAB, [1, 0.5], {"doc.readme": reason})
    return entry_of(name, plain, "", f"{name}/report.html", identity=Identity(people))


def read_mailbox(content: bytes, tmp_path: Path) -> list[EmailMessage]:
    """Read a mailbox as Thunderbird or mutt would."""
    (tmp_path / "mail.mbox").write_bytes(content)
    box = mailbox.mbox(tmp_path / "mail.mbox", create=False)
    return [email.message_from_bytes(box.get_bytes(key), policy=default) for key in box.iterkeys()]


def read_files(content: bytes) -> dict[str, EmailMessage]:
    """Read the archive of mails."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = archive.namelist()
        return {n: email.message_from_bytes(archive.read(n), policy=default) for n in names}


def report_in(message: EmailMessage) -> str:
    """Give the attached page."""
    (attached,) = message.iter_attachments()
    assert (attached.get_filename(), attached.get_content_type()) == ("report.html", "text/html")
    content = attached.get_payload(decode=True)
    assert isinstance(content, bytes)
    return content.decode()


def text_of(message: EmailMessage) -> str:
    """Give the text of a mail."""
    body = message.get_body(("plain",))
    assert body is not None
    return str(body.get_content()).replace("\r\n", "\n")


def test_each_gets_a_mail_with_the_report(tmp_path: Path) -> None:
    """Each student gets a mail with points, first remedy and whole page, for any name.

    Umlauts and commas in names arrive.
    """
    entries = [
        entry(
            tmp_path,
            "ann",
            Person("Müller, Änne", email="aenne@uni.example"),
            reason="From the README nothing ran.",
        ),
        entry(
            tmp_path,
            "bob",
            Person("Bob", email="bob@uni.example"),
            Person("Cem", email="cem@uni.example"),
        ),
    ]
    given = ReturnedClass(entries, tmp_path, sender="Lab <lab@uni.example>")
    returned = CLASS_EXPORTS["mail"].render(given)
    messages = read_mailbox(returned.content, tmp_path)
    assert [message["To"].addresses[0].addr_spec for message in messages] == [
        "aenne@uni.example",
        "bob@uni.example",
        "cem@uni.example",
    ]
    require_mail_to_ann(messages[0])
    assert {report_in(message) for message in messages} == {REPORT}
    assert (returned.count, returned.left_out) == (3, {})
    files = read_files(CLASS_EXPORTS["eml"].render(given).content)
    assert [*files] == ["ann.eml", "bob-1.eml", "bob-2.eml"]
    assert [*map(parts_of, files.values())] == [*map(parts_of, messages)]


def require_mail_to_ann(message: EmailMessage) -> None:
    """Fail unless the mail has its addresses, its subject, the points, and the first remedy."""
    assert message["To"].addresses[0].display_name == "Müller, Änne"
    assert (message["From"], message["Subject"], message["X-Unsent"]) == (
        "Lab <lab@uni.example>",
        "Your report: Lab 1: Nodes",
        "1",
    )
    assert "80 of 100 points." in text_of(message)
    assert "From the README nothing ran." in text_of(message)


def parts_of(message: EmailMessage) -> tuple[str, str, str]:
    """Return recipient, text and report of a mail."""
    return message["To"], text_of(message), report_in(message)


@pytest.mark.parametrize("form", ["mail", "eml"])
def test_equal_results_give_equal_mails(form: str, tmp_path: Path) -> None:
    """Nothing in them depends on the time or on chance."""
    given = ReturnedClass([entry(tmp_path, "ann", Person("Ann", email="a@uni.example"))], tmp_path)
    assert CLASS_EXPORTS[form].render(given) == CLASS_EXPORTS[form].render(given)


@pytest.mark.parametrize(
    "name",
    ["Ann\nBcc: eve@evil.example", "Ann\r\n\r\nHello", '"Ann" <eve@evil.example>,', "\u202eA", ""],
)
def test_a_name_adds_nobody_and_no_line(name: str, tmp_path: Path) -> None:
    """The mail goes to the one address, with the headers that it has."""
    given = ReturnedClass([entry(tmp_path, "ann", Person(name, email="ann@uni.example"))], tmp_path)
    (message,) = read_mailbox(CLASS_EXPORTS["mail"].render(given).content, tmp_path)
    assert [address.addr_spec for address in message["To"].addresses] == ["ann@uni.example"]
    assert {*message.keys()} == {"To", "Subject", "X-Unsent", "MIME-Version", "Content-Type"}


@pytest.mark.parametrize(
    "address",
    [
        "",
        "ann",
        "@uni.example",
        "ann@",
        "a@b, eve@evil.example",
        "a@b\nBcc: e@f",
        "a b@c",
        "<a@b>",
        "ä@uni.example",
    ],
)
def test_who_has_no_address_is_named(address: str, tmp_path: Path) -> None:
    """Nothing but one plain address is written to."""
    given = ReturnedClass([entry(tmp_path, "ann", Person("Ann", email=address))], tmp_path)
    for form in ("mail", "eml"):
        returned = CLASS_EXPORTS[form].render(given)
        assert returned.left_out == {"no address is known that mail can be sent to": ["ann"]}
        assert returned.count == 0


def test_without_a_report_there_is_no_mail(tmp_path: Path) -> None:
    """A submission without a page is named, and one without a grading is left out."""
    bare = dataclasses.replace(
        entry(tmp_path, "ann", Person("Ann", email="a@b.example")), report=""
    )
    given = ReturnedClass([bare, ClassEntry("bob", None, "x", identity=bare.identity)], tmp_path)
    returned = CLASS_EXPORTS["mail"].render(given)
    assert (returned.content, returned.left_out) == (b"", {"there is no report": ["ann"]})
