"""The desk's server: access, decisions, a killed server, and a second desk."""

from __future__ import annotations

import itertools
import json
import os
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
import yaml

from grader.result import load_result
from grader.result_folder import AUDIT_FILE, RECORDINGS, RESULT_FILE
from tests.desk.made_class import Served, add_alike, serve

pytestmark = pytest.mark.slow

COMMENTS = "# Agreed with Dr. Miller.\noverrides:\n  # the first one\n"
CHECK = "service.enables"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Lay out a class of four: two without a recorded service, and two with the same mistake."""
    folder = tmp_path_factory.mktemp("class") / "results"
    add_alike(folder, ["alice", "bob"], "solution", without="service")
    add_alike(folder, ["carol", "dave"], "signed_mean_statistics")
    (folder / "overrides.yaml").write_text(
        f"{COMMENTS}  - {{submission: bob, bonus: 1, reason: well done, who: A, when: 2026-11-21}}\n",
        encoding="utf-8",
    )
    return folder


@pytest.fixture(scope="module")
def desk(made: Path) -> Iterator[Served]:
    """Serve it."""
    served = serve(made)
    yield served
    served.kill()


def decision(desk: Served, name: str = "alice", check: str = CHECK, **more: Any) -> dict[str, Any]:
    """Give the page's request for an item."""
    item = next(i for i in desk.queue()["items"] if i["name"] == name and i["part"]["id"] == check)
    plain = {
        "names": [name],
        "level": "check",
        "id": check,
        "change": "set",
        "points": "1.5",
        "reason": "it was right",
    }
    return {**plain, "seen": {name: item["state"]}, **more}


def text(made: Path) -> str:
    """Give the file of overrides."""
    return (made / "overrides.yaml").read_text(encoding="utf-8")


# -- permission ------------------------------------------------------------------------------------


@pytest.mark.parametrize("token", ["", "x", "0" * 32, "..", "%2e%2e"])
def test_nothing_is_seen_without_the_token(desk: Served, token: str) -> None:
    """Neither a page, nor the queue, nor a report."""
    for path in ("", "queue", "report?name=alice", "desk.js"):
        assert desk.ask("GET", path, token=token)[0] == 404


@pytest.mark.parametrize(
    ("headers", "token"),
    [
        ({}, "guessed"),
        ({"Origin": "http://evil.example"}, None),
        ({"Origin": "http://127.0.0.1:1"}, None),
        ({"Origin": "null"}, None),
        ({"Origin": ""}, None),
        ({"Content-Type": "text/plain"}, None),
        ({"Content-Type": "application/x-www-form-urlencoded"}, None),
        ({"Sec-Fetch-Site": "cross-site"}, None),
        ({"Host": "evil.example"}, None),
        ({"Host": "localhost:80"}, None),
        ({"Host": "rebound.example:PORT", "Origin": "http://rebound.example:PORT"}, None),
        ({"Host": "localhost:PORT", "Origin": "http://localhost:PORT"}, None),
        ({"Sec-Fetch-Site": "same-site"}, None),
    ],
)
def test_nothing_is_decided_from_elsewhere(
    desk: Served, made: Path, headers: dict[str, str], token: str | None
) -> None:
    """Not without the token, from another origin, by a form, nor under a name that leads here by a foreign server."""
    before, plain = text(made), decision(desk)
    headers = {
        key: value.replace("PORT", desk.host.partition(":")[2]) for key, value in headers.items()
    }
    assert desk.ask("POST", "decide", plain, headers, token)[0] in (403, 404)
    assert desk.ask("POST", "undo", {}, headers, token)[0] in (403, 404)
    assert text(made) == before


def test_a_decision_cannot_be_an_address(desk: Served, made: Path) -> None:
    """A GET request, as made for an image or a link, changes nothing."""
    before = text(made)
    for path in ("decide", "undo", "decide?names=alice&change=excused", "rubric/save"):
        assert desk.ask("GET", path)[0] == 405
        assert desk.ask("HEAD", path, {})[0] in (403, 405)
    assert text(made) == before


@pytest.mark.parametrize(
    "name", ["../alice", "/etc/passwd", "alice/../bob", "..", "", "alice\x00", "nobody"]
)
def test_a_path_leads_nowhere(desk: Served, made: Path, name: str) -> None:
    """Names are looked up among the graded submissions, in questions and in decisions."""
    from urllib.parse import quote

    before = text(made)
    for path in ("report?name=", "evidence?what=score&name="):
        assert desk.ask("GET", path + quote(name, safe=""))[0] == 404
    assert desk.ask("POST", "decide", {**decision(desk), "names": [name]})[0] == 400
    for file in ("..%2foverrides.yaml", "../overrides.yaml", "server.py"):
        assert desk.ask("GET", file)[0] == 404
    assert text(made) == before


def test_a_link_leads_nowhere(desk: Served, made: Path) -> None:
    """Neither of a report, nor of recordings, nor of a whole submission."""
    outside = made.parent / "outside"
    shutil.copytree(made / "bob", outside, ignore=shutil.ignore_patterns(RECORDINGS))
    (outside / "report.html").write_text("a secret", encoding="utf-8")
    (made / "eve").symlink_to(outside)
    shutil.copytree(
        made / "bob", made / "mallory", ignore=shutil.ignore_patterns(RECORDINGS, "report.html")
    )
    (made / "mallory/report.html").symlink_to(outside / "report.html")
    (made / "mallory" / RECORDINGS).symlink_to(made / "bob" / RECORDINGS)
    try:
        assert {"eve", "mallory"} <= {item["name"] for item in desk.queue()["items"]}
        for name in ("eve", "mallory"):
            assert desk.ask("GET", f"report?name={name}")[0] == 404
            assert desk.ask("GET", f"evidence?what=score&name={name}")[0] == 404
        assert desk.ask("GET", "report?name=bob")[0] == 200
    finally:
        (made / "eve").unlink()
        shutil.rmtree(made / "mallory")


@pytest.mark.parametrize(
    "change",
    [
        {"points": "99"},
        {"points": "NaN"},
        {"points": "-1"},
        {"points": "seven"},
        {"points": "1e1"},
        {"points": "1.125"},
        {"change": "bonus"},
        {"id": "no.such"},
        {"reason": ""},
        {"names": []},
        {"level": "criterion"},
        {"more": 1},
    ],
)
def test_what_cannot_be_decided_is_refused(
    desk: Served, made: Path, change: dict[str, Any]
) -> None:
    """An invalid decision is refused in words, without a change of the file."""
    before = text(made)
    status, body, _ = desk.ask("POST", "decide", decision(desk, **change))
    assert status == 400
    told = json.loads(body)
    assert told["problem"]
    if "points" in change:
        assert change["points"] in " ".join(told["mistakes"]) or "two decimals" in str(told)
    assert text(made) == before


def test_students_pages_run_no_script_and_ask_for_nothing(desk: Served) -> None:
    """Reports and evidence have a policy that forbids both, whatever stands in them; no answer is kept or passed on."""
    for path in (
        "report?name=alice",
        f"evidence?name=alice&what={CHECK}",
        "evidence?name=carol&what=score",
    ):
        status, _, headers = desk.ask("GET", path)
        policy = headers["content-security-policy"]
        assert status == 200
        assert "default-src 'none'" in policy
        assert "script-src" not in policy
        assert "sandbox allow-same-origin" in policy
        assert headers["cache-control"] == "no-store"
        assert headers["referrer-policy"] == "no-referrer"


@pytest.mark.parametrize("port", ["taken", "99999", "-1"])
def test_a_port_that_cannot_be_used_is_told(desk: Served, made: Path, port: str) -> None:
    """In a sentence with a remedy."""
    number = desk.host.partition(":")[2] if port == "taken" else port
    with pytest.raises(
        AssertionError, match=rf"grade: port {number} cannot be used(.|\n)*Leave out --port"
    ):
        serve(made, "--port", number)


# -- effects of a decision -------------------------------------------------------------------------


def test_a_decision_stands_in_the_file_and_then_in_the_result(desk: Served, made: Path) -> None:
    """A decision stands in the file with its author and reason, and other comments stay.

    Result, report and trail follow. Once taken back, the file is as before.
    """
    before = text(made)
    assert desk.ask("POST", "decide", decision(desk, comment='Fine; "really" <b>'))[0] == 200
    assert text(made).startswith(before)
    plain = desk.until(lambda plain: not plain["waiting"])
    assert plain["failed"] == []
    assert plain["written"] == 1
    adjustment = load_result(made / "alice" / RESULT_FILE).adjustments[0]
    assert (adjustment.what, adjustment.points, adjustment.who) == (
        CHECK,
        Decimal("1.5"),
        "J. Smith",
    )
    report = (made / "alice/report.html").read_text(encoding="utf-8")
    assert "Fine; &#34;really&#34; &lt;b&gt;" in report
    line = json.loads((made / AUDIT_FILE).read_text(encoding="utf-8").splitlines()[-1])
    assert (line["command"], line["submission"]) == ("review", "alice")
    assert desk.ask("POST", "undo", {})[0] == 200
    assert text(made) == before
    desk.until(lambda plain: not plain["waiting"])
    assert load_result(made / "alice" / RESULT_FILE).adjustments == ()


def test_the_same_decision_for_all_with_the_same_mistake_is_shown_first(
    desk: Served, made: Path
) -> None:
    """The points of all submissions with a mistake are shown first; one entry names them all."""
    before = text(made)
    item = next(i for i in desk.queue()["items"] if i["name"] == "bob" and i["part"]["id"] == CHECK)
    assert item["same"] == ["bob", "alice"]
    both = {**decision(desk, "bob"), "names": item["same"], "seen": {}}
    status, body, _ = desk.ask("POST", "preview", both)
    effects = json.loads(body)["effects"]
    assert status == 200
    assert [(e["name"], e["part"]) for e in effects] == [
        ("bob", ["0", "1.5"]),
        ("alice", ["0", "1.5"]),
    ]
    assert text(made) == before
    assert desk.ask("POST", "decide", both)[0] == 200
    assert "submission: [bob, alice]" in text(made)
    assert desk.ask("POST", "undo", {})[0] == 200


def test_two_desks_lose_no_decision(desk: Served, made: Path) -> None:
    """Each desk sees the other's decisions, and cannot overwrite them unseen."""
    second = serve(made)
    try:
        seen = decision(desk)
        other = decision(second, "bob", "service.offers", points="1")
        assert second.ask("POST", "decide", decision(second, points="1"))[0] == 200
        status, body, _ = desk.ask("POST", "decide", seen)
        assert (status, "meanwhile" in json.loads(body)["problem"]) == (409, True)
        assert (
            desk.ask("POST", "decide", decision(desk, "bob", "service.disables", points="1"))[0]
            == 200
        )
        assert second.ask("POST", "decide", other)[0] == 200
        listed = text(made)
        assert listed.count("who: J. Smith") == 3
        assert COMMENTS in listed
    finally:
        second.kill()


def decide_all(desk: Served, decisions: list[dict[str, Any]]) -> list[int]:
    """Send decisions to a desk one by one; returns the status of each answer."""
    return [desk.ask("POST", "decide", decision)[0] for decision in decisions]


def test_all_that_two_desks_decide_at_once_stands(desk: Served, made: Path) -> None:
    """Many decisions by two desks side by side: each that was accepted is an entry, and the file stays whole."""
    second, before = serve(made), text(made)
    checks = []
    for i in desk.queue()["items"]:
        if i["name"] == "alice" and not i["is_decided"]:
            checks.append(i["part"]["id"])
    wanted = list(itertools.product(("carol", "dave"), checks))
    try:
        decisions = []
        for at, (name, check) in enumerate(wanted):
            decisions.append(
                {
                    "names": [name],
                    "level": "check",
                    "id": check,
                    "change": "set",
                    "points": "1",
                    "reason": f"of {at}",
                }
            )
        parts = (decisions[::2], decisions[1::2])
        with ThreadPoolExecutor(2) as both:
            answers = both.map(decide_all, (desk, second), parts)
        assert list(itertools.chain(*answers)) == [200] * len(decisions)
        assert text(made).startswith(before)
        entries = yaml.safe_load(text(made))["overrides"][-len(decisions) :]
        assert sorted((e["submission"], e["check"]) for e in entries) == sorted(wanted)
    finally:
        second.kill()


def test_a_killed_desk_has_lost_nothing(made: Path, desk: Served) -> None:
    """A decision stands in the file before a kill, and the next desk brings the results after."""
    first = serve(made)
    plain = {"names": ["carol"], "id": "subscriber.mean", "points": "1", "seen": {}}
    assert (
        first.ask("POST", "decide", {**decision(first, "bob", "service.refuses"), **plain})[0]
        == 200
    )
    first.kill()
    second = serve(made)
    try:
        second.until(lambda plain: not plain["waiting"])
        assert [a.what for a in load_result(made / "carol" / RESULT_FILE).adjustments] == [
            "subscriber.mean"
        ]
        assert "to decide" not in second.stop()
    finally:
        second.kill()


def test_a_folder_whose_name_is_no_text_can_be_decided(tmp_path: Path) -> None:
    """Its name, as an old archive leaves it, is neither in a browser's texts nor in its addresses."""
    from urllib.parse import quote

    results = tmp_path / "results"
    add_alike(results, ["alice"], "solution", without="service")
    folder = (results / "alice").rename(results / os.fsdecode(b"caf\xe9"))
    served = serve(results)
    try:
        name = served.queue()["items"][0]["name"]
        for path in ("report?name=", f"evidence?what={CHECK}&name="):
            assert served.ask("GET", path + quote(name, safe=""))[0] == 200
        assert served.ask("POST", "decide", decision(served, name))[0] == 200
        assert (
            served.ask("POST", "decide", decision(served, name, seen={name: "of before"}))[0] == 409
        )
        served.until(lambda plain: not plain["waiting"])
        assert [a.what for a in load_result(folder / RESULT_FILE).adjustments] == [CHECK]
    finally:
        served.kill()
