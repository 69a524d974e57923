"""Every attack of the corpus is graded live, as root, as an ordinary user and in a plain container.

Whatever an attack does, the grader ends by itself, report and result are well-formed, the attack earns no more
than its honest twin, a submission graded beside it gets its proper verdict, and nothing is left behind.
"""

from __future__ import annotations

import csv
import fcntl
import json
import os
import re
import shutil
import subprocess
import sys
import unicodedata
import urllib.parse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from enum import StrEnum
from itertools import chain, groupby
from pathlib import Path
from typing import Any

import jsonschema
import pytest

pytest.importorskip("rclpy")

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))

from confine.isolation import CONFINED_UIDS  # noqa: E402
from grader.judging import rubrics  # noqa: E402
from grader.result import result_schema  # noqa: E402
from grader.submission.extraction import SubmissionSource  # noqa: E402
from tests.live.accounts import account  # noqa: E402
from tests.live.attacks import (  # noqa: E402
    ESCAPED,
    SOLUTION,
    Attack,
    Expectation,
    lay_out,
    read_corpus,
)
from tests.live.surroundings import Remains, Surroundings  # noqa: E402
from tests.machine import MACHINE  # noqa: E402
from tests.plain_results import checks_of  # noqa: E402
from tests.report.taken_apart import Page  # noqa: E402
from tests.thorough import part  # noqa: E402

pytestmark = pytest.mark.live

GRADE = Path(sys.executable).parent / "grade"
SCHEMA = result_schema()
HONEST = "honest"
#: The whole corpus in all environments takes most of an hour: `make attacks`. Or some, by their names and commas.
CHOSEN = os.environ.get("ATTACKS", "")
#: Attacks that are graded by one command.
MOST_IN_BATCH = 6
#: Each runs as many sessions side by side as the machine takes.
BATCHES_AT_A_TIME = 2
#: Limit for one submission, retries included; a grader that takes longer hangs.
LONGEST_S = 300.0
#: A container has a network and process ids of its own, which the sandboxes within share.
OWN_SPACES = ["unshare", "--net", "--pid", "--mount", "--fork", "--kill-child", "--mount-proc"]
#: Folders that every user of a machine may write to.
SHARED_FOLDERS = (Path("/tmp"), Path("/dev/shm"), Path("/var/tmp"))
REFUSED = 3
#: Cells that spreadsheets compute; a number with a sign is a number.
FORMULA = re.compile(r"[\t\r]|[=@+-](?![\d.]+$)")


class Environment(StrEnum):
    """Where the grader runs."""

    ROOT = "root"
    USER = "user"
    CONTAINER = "container"


#: One batch in so many is tried in every run, others for each commit and in each environment.
ONE_IN = {Environment.ROOT: 34, Environment.USER: 41, Environment.CONTAINER: 53}


@dataclass(frozen=True)
class Batch:
    """Attacks that are graded side by side, with an honest submission among them."""

    environment: Environment
    number: int
    attacks: tuple[Attack, ...]

    @property
    def name(self) -> str:
        """Name of the batch."""
        return f"{self.environment.value}-{self.number}"

    @property
    def sessions(self) -> tuple[str, ...]:
        """The sessions that are run for all of them."""
        return self.attacks[0].sessions


def batches() -> list[Batch]:
    """Return the batches to try: chosen attacks, the whole corpus, or a part of it for each environment."""
    found: list[Batch] = []
    for environment in Environment:
        attacks = list(read_corpus())
        if CHOSEN not in ("", "all"):
            attacks = [attack for attack in attacks if attack.name in CHOSEN.split(",")]
        for together in part(divided(attacks), ONE_IN[environment], everything=CHOSEN != ""):
            found.append(Batch(environment, len(found), together))
    return found


def divided(attacks: Sequence[Attack]) -> list[tuple[Attack, ...]]:
    """Divide attacks so that all of a batch need the same sessions."""
    ordered = sorted(attacks, key=lambda attack: (attack.sessions, attack.name))
    parts = []
    for _, group in groupby(ordered, key=lambda attack: attack.sessions):
        alike = tuple(group)
        for start in range(0, len(alike), MOST_IN_BATCH):
            parts.append(alike[start : start + MOST_IN_BATCH])
    return parts


BATCHES = batches()


@dataclass(frozen=True)
class Graded:
    """Outcome of a batch.

    Attributes
    ----------
    results : dict
        Attack, or "honest" -> its folder of results.
    littered : list of str
        Files that were left in shared folders.
    """

    remains: Remains
    results: dict[str, Path]
    littered: list[str]
    temporary: list[str]

    def result_of(self, name: str) -> dict[str, Any]:
        """Read a submission's result."""
        found: dict[str, Any] = json.loads(
            (self.results[name] / "result.json").read_text(encoding="utf-8")
        )
        return found


# -- running ----------------------------------------------------------------------------------


def result_names(batch: Batch, source: dict[str, Path], results: Path) -> dict[str, str]:
    """Return the name of each submission's folder of results; a name unfit for a folder was made fit."""
    names = {
        HONEST: HONEST,
        **{name: SubmissionSource.of(path).name for name, path in source.items()},
    }
    others = sorted({p.name for p in results.iterdir() if p.is_dir()} - set(names.values()))
    unfit = [attack.name for attack in batch.attacks if attack.named is not None]
    return {**names, **dict(zip(unfit, others, strict=False))}


def short_rubric() -> str:
    """Return the lab's rubric with a shorter window: no attack here aims at the rate."""
    text = (ROOT / "rubric.yaml").read_text(encoding="utf-8")
    window = "observe: {duration_s: 9.5, extend_s: 4, first_message_on: /joint_commands}"
    assert text.count(window) == 1
    return text.replace(window, window.replace("9.5, extend_s: 4", "2"))


def run_batch(batch: Batch, folder: Path) -> Graded:
    """Grade a batch's attacks and an honest submission by one command, and look for leftovers."""
    source = {attack.name: lay_out(attack, folder / "handed") for attack in batch.attacks}
    honest = folder / "handed" / HONEST
    shutil.copytree(ROOT / SOLUTION, honest, ignore=shutil.ignore_patterns("__pycache__"))
    paths = list(source.values())
    paths.insert(len(paths) // 2, honest)
    for name in ("home", "tmp", "results"):
        (folder / name).mkdir()
    (folder / "rubric.yaml").write_text(short_rubric(), encoding="utf-8")
    arguments = [
        *map(str, paths),
        "-o",
        str(folder / "results"),
        "--rubric",
        str(folder / "rubric.yaml"),
    ]
    arguments += ["--sessions", ",".join(batch.sessions), "--seed", "7"]
    if batch.environment is Environment.CONTAINER:
        arguments += ["--require-isolation", "reduced"]
    before = entries_of_shared_folders()
    remains, user = run_in(
        batch.environment, folder, [str(GRADE), *arguments], LONGEST_S * len(paths)
    )
    # Some submissions are too deep for Python to remove.
    subprocess.run(["rm", "-rf", str(folder / "handed")], check=False)
    names = result_names(batch, source, folder / "results")
    return Graded(
        remains,
        {name: folder / "results" / told for name, told in names.items()},
        sorted(str(p) for p in entries_of_shared_folders() - before if is_litter(p, user)),
        sorted(path.name for path in (folder / "tmp").iterdir()),
    )


def run_in(
    environment: Environment, folder: Path, command: list[str], limit_s: float
) -> tuple[Remains, int]:
    """Run a command in an environment; returns its remains, and the user that it ran as."""
    settings = {
        "HOME": str(folder / "home"),
        "TMPDIR": str(folder / "tmp"),
        "LANG": "C.UTF-8",
        "COLUMNS": "200",
    }
    caller = {"PATH": os.environ["PATH"], **settings}
    with account() if environment is Environment.USER else caller_account() as (user, group):
        for name in ("home", "tmp", "results"):
            os.chown(folder / name, user, group)
        surroundings = Surroundings(
            told=str(folder / "told.json"),
            place=str(folder),
            user=user if user != os.geteuid() else None,
            group=group,
            readable=[
                str(p)
                for p in (folder, ROOT, Path(sys.prefix), Path(sys.executable).resolve().parents[1])
            ],
            container=environment is Environment.CONTAINER,
            limit_s=limit_s,
        )
        program = Path(__file__).with_name("surroundings.py")
        if environment is Environment.CONTAINER and os.geteuid() == 0:
            apart = OWN_SPACES
        else:
            apart = []
        subprocess.run(
            [
                *apart,
                sys.executable,
                "-I",
                str(program),
                json.dumps(asdict(surroundings)),
                *command,
            ],
            env=caller,
            cwd="/",
            check=True,
            timeout=limit_s + 120,
        )
    return Remains(**json.loads((folder / "told.json").read_text(encoding="utf-8"))), user


@contextmanager
def caller_account() -> Iterator[tuple[int, int]]:
    """Give the caller's own ids."""
    yield os.getuid(), os.getgid()


def entries_of_shared_folders() -> set[Path]:
    """Return the entries of folders where everyone may write."""
    folders = filter(Path.is_dir, SHARED_FOLDERS)
    return set(chain.from_iterable(folder.iterdir() for folder in folders))


def is_litter(path: Path, user: int) -> bool:
    """Say if a new file in a shared folder comes from a grading, and not from another test."""
    try:
        owner = path.lstat().st_uid
    except OSError:
        return False
    if "attack_" in path.name:
        return True
    if any(owner in uids for uids in CONFINED_UIDS):
        return True
    return owner == user != os.geteuid()


@pytest.fixture
def graded(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Graded:
    """Give the outcome of a batch; the first test in need of it, in any worker, has it graded."""
    batch: Batch = request.param
    if (batch.environment is Environment.ROOT) and os.geteuid() != 0:
        pytest.skip("grading as root needs root")
    base = tmp_path_factory.getbasetemp()
    shared = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "attacks"
    folder = shared / batch.name
    folder.mkdir(parents=True, exist_ok=True)
    told = folder / "graded.json"
    # Without root, sandboxes of a plain container share one network with all other such sandboxes of the machine.
    together = batch.environment is Environment.CONTAINER and os.geteuid() != 0
    with (shared / f"{'container' if together else batch.number % BATCHES_AT_A_TIME}.lock").open(
        "w"
    ) as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not told.exists():
            found = run_batch(batch, folder)
            plain = {
                **asdict(found),
                "results": {name: str(path) for name, path in found.results.items()},
            }
            told.write_text(json.dumps(plain), encoding="utf-8")
    plain = json.loads(told.read_text(encoding="utf-8"))
    return Graded(
        Remains(**plain["remains"]),
        {name: Path(path) for name, path in plain["results"].items()},
        plain["littered"],
        plain["temporary"],
    )


# -- looking ----------------------------------------------------------------------------------


def faults_of_page(path: Path) -> list[str]:
    """Return faults of a page: badly formed parts, and elements from a student."""
    text = path.read_text(encoding="utf-8")
    try:
        page = Page(text)
    except AssertionError as problem:
        return [f"the elements of {path.name} do not close in order: {problem}"]
    faults = [f"{c!r} in {path.name}" for c in sorted(set(text)) if is_control(c)]
    faults += [
        f"{path.name} has an element {tag} {a}"
        for tag, a in page.elements
        if a.get("id") == "injected"
    ]
    for _, attributes in page.elements:
        handlers = [name for name in attributes if name.startswith("on")]
        faults += [f"{path.name} has a handler {name}" for name in handlers]
    links = [urllib.parse.urlsplit(link) for link in [*page.values("href"), *page.values("src")]]
    return faults + [
        f"{path.name} leads to {link}"
        for link in links
        if link.netloc or link.scheme not in ("", "data")
    ]


def faults_of_table(path: Path) -> list[str]:
    """Return cells that would make a spreadsheet compute a student's text."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        cells = list(chain.from_iterable(csv.reader(file)))
    found = []
    for cell in cells:
        if FORMULA.match(cell) or any(map(is_control, cell)):
            found.append(f"{cell!r} in {path.name}")
    return found


def scripts_of(page: Page) -> list[dict[str, str]]:
    """Return the elements of a page that run or fetch something."""
    found = []
    for tag, attributes in page.elements:
        if tag in ("script", "iframe", "object", "embed", "base"):
            found.append({"element": tag, **attributes})
    return found


def is_control(character: str) -> bool:
    """Say if a character steers its display."""
    if character in "\n\t":
        return False
    return unicodedata.category(character) in ("Cc", "Cs") or character in "\u202e\u2066"


def faults_of_result(result: dict[str, Any], most: float) -> list[str]:
    """Return breaches of a result's contract, and points beyond the honest twin's."""
    faults = []
    for error in jsonschema.Draft202012Validator(SCHEMA).iter_errors(result):
        faults.append(error.message[:300])
    broken = [check for check in checks_of(result) if check["outcome"] == "error"]
    faults += [f"{check['id']} broke: {check['reason']}" for check in broken]
    if result["score"]["earned"] > most:
        faults.append(f"it earns {result['score']['earned']}, its honest twin {most} at most")
    return faults


def outcomes(result: dict[str, Any], sessions: tuple[str, ...]) -> dict[str, str]:
    """Return the outcome of each check of the sessions.

    Checks that a busy machine leaves undecided count as passed.
    """
    rubric = rubrics.read_rubric(None)
    chosen = {c.id for c in rubric.checks() if c.session in sessions}
    found = {}
    for check in checks_of(result):
        if check["id"] in chosen:
            found[check["id"]] = "passed" if is_excused(check) else check["outcome"]
    return found


def is_excused(check: dict[str, Any]) -> bool:
    """Say if a check is undecided because of the machine alone."""
    if check["outcome"] != "inconclusive":
        return False
    return str(check["reason"]).startswith(MACHINE)


def faults_of_verdict(attack: Attack, result: dict[str, Any]) -> list[str]:
    """Return differences between the verdict and the expected one."""
    expect, found = attack.expect, outcomes(result, attack.sessions)
    wanted = dict(expect.checks)
    if expect.all == "passed":
        wanted = dict.fromkeys(found, "passed")
    excused = {check["id"] for check in checks_of(result) if is_excused(check)}
    faults = []
    for name, outcome in wanted.items():
        if found.get(name) != outcome and name not in excused:
            faults.append(f"{name} is {found.get(name)}, not {outcome}")
    if expect.all == "failed":
        for name, outcome in found.items():
            if outcome not in ("failed", "not_reached"):
                faults.append(f"{name} is {outcome}")
    return faults + faults_of_notes(expect, result)


def faults_of_notes(expect: Expectation, result: dict[str, Any]) -> list[str]:
    """Return an expected limit, and an expected violation, that the result does not name."""
    limits = set()
    for session in result["provenance"]["sessions"].values():
        limits.update(session["limits"].values())
    kinds = {violation["kind"] for violation in result.get("violations", [])}
    faults = []
    if expect.limit is not None and limits.isdisjoint(expect.limit.split(" or ")):
        faults.append(f"the limits named are {limits or 'none'}, not {expect.limit}")
    if expect.violation is not None and expect.violation not in kinds:
        faults.append(f"the violations are {kinds or 'none'}, not {expect.violation}")
    return faults


def printed(folder: Path) -> list[str]:
    """Return all that the processes of a submission's sessions printed."""
    lines = []
    for path in sorted(folder.glob("recordings/*/session.json")):
        record = json.loads(path.read_text(encoding="utf-8"))
        for run in record["processes"]:
            lines += [line["text"] for line in run["output"]]
    return lines


def faults_of_recording(attack: Attack, folder: Path, result: dict[str, Any]) -> list[str]:
    """Return things that escaped the sandbox or entered the recording against the rules."""
    expect, lines = attack.expect, printed(folder)
    faults = unknown_escapes(attack, lines, result)
    if expect.no_output is not None:
        faults += [line for line in lines if expect.no_output in line]
    if expect.no_text is not None:
        files = [p for p in folder.rglob("*") if p.suffix in (".json", ".html")]
        faults += [
            f"{expect.no_text!r} is in {p.name}"
            for p in files
            if expect.no_text in p.read_text(encoding="utf-8")
        ]
    if expect.left_out is not None:
        faults += faults_of_left_out(expect.left_out, folder)
    return faults


def unknown_escapes(attack: Attack, lines: list[str], result: dict[str, Any]) -> list[str]:
    """Return printed escapes that are not known at the isolation of this grading, once each."""
    known = set[str]()
    for session in result["provenance"]["sessions"].values():
        known.update(attack.gaps.get(session["isolation"], {}))
    found = []
    for line in dict.fromkeys(lines):
        if line.startswith(ESCAPED):
            word = line.removeprefix(ESCAPED).split(":")[0].split()[0]
            if word not in known:
                found.append(line)
    return found


def faults_of_left_out(expected: str, folder: Path) -> list[str]:
    """Return a fault unless the submission's record has the expected reason for a file left out."""
    record = (folder / "recordings/submission.json").read_text(encoding="utf-8")
    told = json.loads(record)["left_out"]
    if told and any(expected in reason for reason in told):
        return []
    return [f"nothing is said to be left out for {expected!r}: {told}"]


def graded_cases() -> list[Any]:
    """Pair each attack with the batch that it is in."""
    cases: list[Any] = []
    for batch in BATCHES:
        cases += [pytest.param(batch, a, id=f"{batch.name}-{a.name}") for a in batch.attacks]
    return cases


@pytest.mark.parametrize(("graded", "attack"), graded_cases(), indirect=["graded"])
def test_an_attack_gains_nothing_and_breaks_nothing(graded: Graded, attack: Attack) -> None:
    """An attack gets its attack.yaml's verdict, at most its twin's points, and a proper report."""
    expect, folder = attack.expect, graded.results[attack.name]
    if expect.nothing_at is not None:
        assert not Path(expect.nothing_at).exists()
    refused = not (folder / "result.json").exists()
    assert refused == expect.refused or "refused" in expect.either, graded.remains.output
    if refused:
        assert graded.remains.exit_status == REFUSED, graded.remains.errors
        assert f"{attack.name}: not graded: " in graded.remains.output
        assert not (folder / "report.html").exists()
        return
    result = graded.result_of(attack.name)
    most = attack.most_points(rubrics.read_rubric(None))
    faults = faults_of_result(result, float(most)) + faults_of_page(folder / "report.html")
    honest = Page((graded.results[HONEST] / "report.html").read_text(encoding="utf-8"))
    scripts = scripts_of(Page((folder / "report.html").read_text(encoding="utf-8")))
    faults += (
        []
        if scripts == scripts_of(honest)
        else ["the report has other scripts than the honest one's"]
    )
    faults += faults_of_verdict(attack, result) + faults_of_recording(attack, folder, result)
    assert not faults, "\n".join([*faults, *result["problems"]])


def require_unharmed(result: dict[str, Any], sessions: tuple[str, ...]) -> None:
    """Fail unless the honest neighbour of the attacks lost no point and is blamed for nothing."""
    # Points left undecided by a busy machine are not lost.
    lost = []
    for check in checks_of(result):
        if check["earned"] + check["undecided"] < check["possible"]:
            lost.append(f"{check['id']}: {check['reason']}")
    assert not lost, "\n".join(lost)
    assert result["score"]["earned"] > 0
    assert result.get("violations", []) == []
    assert set(outcomes(result, sessions).values()) <= {"passed", "inconclusive"}


@pytest.mark.parametrize("graded", [pytest.param(b, id=b.name) for b in BATCHES], indirect=True)
def test_attacks_leave_the_machine_and_their_neighbour_as_they_were(
    graded: Graded, request: pytest.FixtureRequest
) -> None:
    """The grader ends by itself, the honest submission gets all points, and no process, mount or file is left."""
    batch: Batch = request.node.callspec.params["graded"]
    left = graded.remains
    refused = any(not (folder / "result.json").exists() for folder in graded.results.values())
    assert left.exit_status == (REFUSED if refused else 0), left.errors
    assert "Traceback" not in left.output + left.errors
    assert not [c for c in left.output + left.errors if is_control(c)]
    assert (left.processes, left.mounts, graded.littered, graded.temporary) == ([], [], [], [])
    results = graded.results[HONEST].parent
    assert faults_of_page(results / "index.html") + faults_of_table(results / "grades.csv") == []
    require_unharmed(graded.result_of(HONEST), batch.sessions)
