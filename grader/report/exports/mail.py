"""Mails, one a person, with the report attached: as a mailbox, or as files that mail programs open to send.

Each mail is marked as not sent yet (`X-Unsent`), and Outlook opens it to be sent. Equal results give equal mails; a
mail program adds the date when it sends.

References
----------
RFC 5322 (mails), RFC 4155 (mailboxes; lines that begin with `From ` get a `>`), RFC 2047 (names beyond ASCII).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from email.errors import HeaderParseError
from email.headerregistry import Address
from email.message import EmailMessage
from email.policy import SMTP

from grader.report.escape import line
from grader.report.exports.feedback import packed
from grader.report.exports.returned import Returned, ReturnedClass, Share, plain_report
from grader.result_folder import REPORT_FILE

_ENVELOPE = "From grade Thu Jan  1 00:00:00 1970"
#: Line ends of a mailbox are those of Unix.
_IN_MAILBOX = SMTP.clone(linesep="\n", mangle_from_=True)


def mailbox(given: ReturnedClass) -> Returned:
    """Return a mailbox of all mails."""
    returned = Returned()
    texts = []
    for _, message in _messages(given, returned):
        text = message.as_bytes(unixfrom=True, policy=_IN_MAILBOX)
        texts.append(text.rstrip(b"\n") + b"\n\n")
    returned.content = b"".join(texts)
    return returned


def files(given: ReturnedClass) -> Returned:
    """Return an archive with a file for each mail, named `alice.eml`, or `team-2.eml` for the second of several people."""
    returned = Returned()
    mails = {}
    for name, message in _messages(given, returned):
        mails[f"{name}.eml"] = message.as_bytes(policy=SMTP)
    returned.content = packed(mails)
    return returned


def _messages(given: ReturnedClass, returned: Returned) -> Iterator[tuple[str, EmailMessage]]:
    """Yield the mails with their names, count them, and note the people without one."""
    for share in given.shares:
        report = given.report(share.entry)
        if report is None:
            returned.left_out["there is no report"].append(share.entry.name)
            continue
        try:
            message = _message(share, report, given.sender)
        except (ValueError, IndexError, HeaderParseError):
            why = "no address is known that mail can be sent to"
            returned.left_out[why].append(share.entry.name)
            continue
        returned.count += 1
        name = share.entry.name
        if len(share.entry.people) > 1:
            name += f"-{share.entry.people.index(share.person) + 1}"
        yield name, message


def _message(share: Share, report: bytes, sender: str) -> EmailMessage:
    """Return a mail; raises ValueError, IndexError or HeaderParseError if its address is invalid."""
    message = EmailMessage(SMTP)
    name = line(share.person.name)
    to = Address(name, addr_spec=share.person.email)
    if not to.username or not to.domain:
        raise ValueError("no address")
    if sender:
        message["From"] = sender
    message["To"] = to
    in_language = share.language.text
    message["Subject"] = in_language(f"Your report: {line(share.result.lab)}")
    message["X-Unsent"] = "1"
    greeting = f"{name},\n\n" if name else ""
    attached = in_language(f"The whole report is attached; open {REPORT_FILE} in a browser.")
    text = f"{greeting}{plain_report(share.result, share.language)}\n{attached}\n"
    message.set_content(text)
    message.add_attachment(report, maintype="text", subtype="html", filename=REPORT_FILE)
    # The boundary cannot occur in the parts: the text cannot know the hash, and Base64 has no underscore.
    digest = hashlib.sha256(report + text.encode()).hexdigest()
    message.set_boundary(f"=_{digest[:40]}")
    message.set_unixfrom(_ENVELOPE)
    return message
