"""Recordings outlive whatever fails after them: they are in their place, and the command that goes on is named."""

from __future__ import annotations

import json
import shutil
import signal
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("rclpy")

sys.path.append(str(Path(__file__).parents[2]))

from grader import pipeline, result_folder
from grader.cli import main
from grader.recording.session import read_session
from tests.classroom.small_class import make_class
from tests.live.small_lab import TALKER, TEXT, make_lab, published

pytestmark = pytest.mark.live

#: Sound until it is called by a figure, which the checks do not see.
UNFIT = "def spans(streams, parameters, seed):\n    return 5\n"
#: Ctrl-C while a figure is drawn.
INTERRUPTS = "import os, signal\n\ndef spans(streams, parameters, seed):\n    os.kill(os.getpid(), signal.SIGINT)\n"
SOUND = "def spans(streams, parameters, seed):\n    return []\n"
STEPS: list[dict[str, Any]] = [
    {"start": {"student": "talker"}},
    {"wait_for": {"publisher": "/chatter", "type": TEXT, "timeout_s": 20}},
    {"observe": {"duration_s": 0.5, "first_message_on": "/chatter", "timeout_s": 20}},
]


def with_figure(rubric: Path, oracle: str) -> None:
    """Add a figure with an oracle to a small lab."""
    (rubric.parent / "oracle.py").write_text(oracle, encoding="utf-8")
    plain = yaml.safe_load(rubric.read_text(encoding="utf-8"))
    settings = {"artifact": "talker", "pattern": r"it is ([0-9.]+)", "streams": {}, "field": "data"}
    figure = {
        "kind": "reports",
        "title": "A",
        "session": "only",
        "with": settings | {"oracle": "oracle.py:spans"},
    }
    plain["criteria"][0]["figures"] = [figure]
    rubric.write_text(yaml.safe_dump(plain, sort_keys=False), encoding="utf-8")


def test_what_breaks_after_the_sessions_leaves_the_recordings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A figure that breaks, or Ctrl-C while judging: no old result stays beside new recordings, and regrading works."""
    lab = make_lab(tmp_path, {"talker": TALKER}, {"only": STEPS}, checks=[published("/chatter")])
    command = [
        "--one",
        str(lab.submission),
        "--rubric",
        str(lab.rubric_file),
        "-o",
        str(lab.results),
    ]
    assert main(command) == 0
    results = lab.results / lab.submission.name
    seen = {read_session(results / "recordings/only").started_ns}
    for oracle, status in ((UNFIT, 70), (INTERRUPTS, 130)):
        with_figure(lab.rubric_file, oracle)
        capsys.readouterr()
        assert main(command) in (status, 70)
        assert (
            f"The recordings are kept; `grade regrade {results}` continues from there."
            in capsys.readouterr().err
        )
        assert sorted(path.name for path in results.iterdir()) == ["recordings"]
        recorded = read_session(results / "recordings/only")
        assert recorded.started_ns not in seen
        seen.add(recorded.started_ns)
        mended = shutil.copytree(
            tmp_path, tmp_path / f"mended-{status}", ignore=lambda *_: {"results", "mended-70"}
        )
        with_figure(Path(mended) / "rubric.yaml", SOUND)
        assert main(["regrade", str(results), "--rubric", str(Path(mended) / "rubric.yaml")]) == 0
        assert (
            json.loads((results / result_folder.RESULT_FILE).read_text(encoding="utf-8"))["score"][
                "earned"
            ]
            == 1
        )
        assert read_session(results / "recordings/only").started_ns == recorded.started_ns


def test_a_class_goes_on_from_recordings_that_were_not_judged(tmp_path: Path) -> None:
    """The same command judges earlier recordings without a verdict, and records nothing twice."""
    small = make_class(tmp_path, {"ann": TALKER, "bob": TALKER})
    with_figure(small.rubric, UNFIT)
    status, output, _ = small.grade()
    assert status == 70
    assert "0 graded, 2 not graded" in output
    recordings = small.results / "ann/recordings"
    (session,) = (
        path.name
        for path in recordings.iterdir()
        if path.is_dir() and (path / "session.json").exists()
    )
    before = read_session(recordings / session).started_ns
    assert f"grade regrade {small.results / 'ann'}" in " ".join(output.split())
    with_figure(small.rubric, SOUND)
    assert small.grade()[0] == 0
    assert read_session(recordings / session).started_ns == before
    assert small.result("ann")["score"]["earned"] == 1


def test_a_request_to_end_before_the_sessions_have_ended_leaves_the_earlier_result(
    tmp_path: Path,
) -> None:
    """Half of a recording never takes the place of a whole one."""
    lab = make_lab(tmp_path, {"talker": TALKER}, {"only": STEPS}, checks=[published("/chatter")])
    command = [
        "--one",
        str(lab.submission),
        "--rubric",
        str(lab.rubric_file),
        "-o",
        str(lab.results),
    ]
    assert main(command) == 0
    results = lab.results / lab.submission.name
    before = {p: p.read_bytes() for p in results.rglob("*") if p.is_file()}
    options = pipeline.Options(Path(sys.executable))

    def interrupt(progress: object) -> None:
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt) as caught:
        pipeline.grade(lab.submission, lab.rubric(), results, options, interrupt)
    assert "kept" not in str(caught.value)
    assert {p: p.read_bytes() for p in results.rglob("*") if p.is_file()} == before
