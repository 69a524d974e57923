"""A class of kept recordings, with its results, and a desk that serves it: the real command."""

from __future__ import annotations

import http.client
import json
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from grader.judging import rubrics
from grader.lab.kept_lab import lab_folder
from grader.result_folder import RECORDINGS, RESULT_FILE, RUBRIC_COPY
from tests.regraded import judge_results

ROOT = Path(__file__).resolve().parents[2]


def add(results: Path, name: str, recording: str, *, without: str = "") -> Path:
    """Add a submission with kept recordings; one session may be missing, and is then undecided."""
    folder = results / name
    shutil.copytree(ROOT / "tests/recordings" / recording, folder / RECORDINGS)
    if without:
        shutil.rmtree(folder / RECORDINGS / without)
    shutil.copy(lab_folder() / "rubric.yaml", folder / RECORDINGS / RUBRIC_COPY)
    record = folder / RECORDINGS / "submission.json"
    plain = {**json.loads(record.read_text(encoding="utf-8")), "name": name}
    record.unlink()  # Else the kept recording would be changed, too.
    record.write_text(json.dumps(plain), encoding="utf-8")
    return folder


def add_alike(results: Path, names: list[str], recording: str, *, without: str = "") -> None:
    """Add submissions that are judged alike: the first one is judged, and the others get its result."""
    first, *others = [add(results, name, recording, without=without) for name in names]
    judge_results(first, rubrics.read_rubric(None))
    for folder in others:
        for file in (RESULT_FILE, "report.html"):
            text = (first / file).read_text(encoding="utf-8").replace(first.name, folder.name)
            (folder / file).write_text(text, encoding="utf-8")


@dataclass
class Served:
    """A desk that is being served."""

    process: subprocess.Popen[str]
    address: str
    asked: list[str] = field(default_factory=list)

    @property
    def host(self) -> str:
        """Its `host:port`."""
        return urlsplit(self.address).netloc

    @property
    def token(self) -> str:
        """The token of its address."""
        return urlsplit(self.address).path.strip("/")

    def ask(
        self,
        method: str,
        path: str,
        body: Any = None,
        headers: Mapping[str, str] | None = None,
        token: str | None = None,
    ) -> tuple[int, bytes, Mapping[str, str]]:
        """Ask something of it as its own page would, but for the headers given; returns status, body and headers."""
        connection = http.client.HTTPConnection(self.host, timeout=60)
        own = {"Host": self.host}
        if body is not None:
            own |= {"Origin": f"http://{self.host}", "Content-Type": "application/json"}
        sent = {key: value for key, value in {**own, **(headers or {})}.items() if value}
        if isinstance(body, (str, bytes)) or body is None:
            text = body
        else:
            text = json.dumps(body)
        connection.putrequest(
            method, f"/{self.token if token is None else token}/{path}", skip_host=True
        )
        data = text.encode() if isinstance(text, str) else text
        for key, value in {
            **sent,
            **({"Content-Length": str(len(data))} if data is not None else {}),
        }.items():
            connection.putheader(key, value)
        connection.endheaders(data)
        answer = connection.getresponse()
        return answer.status, answer.read(), dict(answer.getheaders())

    def queue(self) -> dict[str, Any]:
        """Return the list that the desk shows."""
        status, body, _ = self.ask("GET", "queue")
        assert status == 200, body
        plain: dict[str, Any] = json.loads(body)
        return plain

    def until(self, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Ask for the queue until something holds of it; the test's own time limit ends it."""
        while not holds(plain := self.queue()):
            time.sleep(0.2)  # The desk needs the processor, too.
        return plain

    def kill(self) -> None:
        """End it as a machine without power does."""
        self.process.kill()
        self.process.wait()

    def stop(self) -> str:
        """End the desk by Ctrl-C; returns its output."""
        self.process.send_signal(signal.SIGINT)
        output, _ = self.process.communicate(timeout=120)
        return output


def serve(results: Path, *more: str) -> Served:
    """Start the real command."""
    command = [
        sys.executable,
        "-m",
        "grader.cli",
        "review",
        str(results),
        "--who",
        "J. Smith",
        *more,
    ]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT
    )
    assert process.stdout is not None
    seen = []
    for line in process.stdout:
        seen.append(line)
        if (found := re.search(r"http://\S+", line)) is not None:
            return Served(process, found[0])
    raise AssertionError("".join(seen))
