"""Mails, one a person, with the report attached: as a mailbox, or as files that mail programs open to send.

Each says of itself that it is not sent yet (`X-Unsent`), so that Outlook opens it to be sent. Nothing in it depends on
the time or on chance: a mail program adds the date when it sends.

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
    messages = [message for _, message in _messages(given, returned)]
    texts = (message.as_bytes(unixfrom=True, policy=_IN_MAILBOX) for message in messages)
    returned.content = b"".join(text.rstrip(b"\n") + b"\n\n" for text in texts)
    return returned


def files(given: ReturnedClass) -> Returned:
    """Return an archive with a file for each mail, called after the submission and its place among the people."""
    returned = Returned()
    messages = _messages(given, returned)
    returned.content = packed(
        {f"{name}.eml": message.as_bytes(policy=SMTP) for name, message in messages}
    )
    return returned


def _messages(given: ReturnedClass, returned: Returned) -> Iterator[tuple[str, EmailMessage]]:
    for share in given.shares:
        report = given.report(share.entry)
        if report is None:
            returned.left_out["there is no report"].append(share.entry.name)
            continue
        try:
            message = _message(share, report, given.sender)
        except (ValueError, IndexError, HeaderParseError):
            returned.left_out["no address is known that mail can be sent to"].append(
                share.entry.name
            )
            continue
        returned.count += 1
        place = share.entry.people.index(share.person) + 1
        yield (
            (share.entry.name if len(share.entry.people) == 1 else f"{share.entry.name}-{place}"),
            message,
        )


def _message(share: Share, report: bytes, sender: str) -> EmailMessage:
    """Return a mail; raises ValueError or HeaderParseError if nobody can get it."""
    message, person = EmailMessage(SMTP), share.person
    name = line(person.name)
    to = Address(name, addr_spec=person.email)
    if not to.username or not to.domain:
        raise ValueError("no address")
    if sender:
        message["From"] = sender
    message["To"] = to
    message["Subject"] = f"Your report: {line(share.result.lab)}"
    message["X-Unsent"] = "1"
    greeting = f"{name},\n\n" if name else ""
    attached = f"The whole report is attached; open {REPORT_FILE} in a browser."
    text = f"{greeting}{plain_report(share.result)}\n{attached}\n"
    message.set_content(text)
    message.add_attachment(report, maintype="text", subtype="html", filename=REPORT_FILE)
    # The mark between the parts stands nowhere in them: the text cannot know the hash, and Base64 has no underscore.
    message.set_boundary(f"=_{hashlib.sha256(report + text.encode()).hexdigest()[:40]}")
    message.set_unixfrom(_ENVELOPE)
    return message
