"""Records faulty servers by the real grader, and keeps the recordings for tests without ROS.

.venv/bin/python tests/labs/fibonacci/record.py [NAME ...]
"""

from __future__ import annotations

import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))

from grader import pipeline, result_folder  # noqa: E402
from grader.judging import rubrics  # noqa: E402
from grader.judging.judge import judge, open_recordings  # noqa: E402
from grader.live.session.scheduler import Scheduler  # noqa: E402
from grader.result import Result  # noqa: E402
from grader.submission.artifacts import read_submission_folder  # noqa: E402
from tests.labs.fibonacci.defects import DEFECTS, FOLDER  # noqa: E402

#: Replacement, in kept recordings, for the folder of this machine's virtual environment.
ENVIRONMENT = "/opt/venv"


def record(name: str, folder: Path, scheduler: Scheduler | None = None) -> Path:
    """Record the session of a server in a folder, and return where the recordings are."""
    submission = folder / "submission"
    submission.mkdir(parents=True)
    (submission / "server.py").write_text(DEFECTS[name].source, encoding="utf-8")
    rubric = rubrics.read_rubric(FOLDER / "rubric.yaml")
    options = pipeline.Options(Path(sys.executable), seed=1)
    read = read_submission_folder(submission, rubric)
    results = folder / "results"
    pipeline.Grading(
        submission, read, rubric, results, options, lambda progress: None, scheduler=scheduler
    ).record()
    return results / result_folder.RECORDINGS


def judged(recordings: Path) -> Result:
    """Judge recordings."""
    rubric = rubrics.read_rubric(FOLDER / "rubric.yaml")
    return judge(open_recordings(recordings, rubric), rubric)


def keep(name: str, recordings: Path) -> None:
    """Pack recordings beside this file."""
    for path in recordings.rglob("*.json"):
        path.write_text(
            path.read_text(encoding="utf-8").replace(sys.prefix, ENVIRONMENT), encoding="utf-8"
        )
    with tarfile.open(FOLDER / "recordings" / f"{name}.tar.xz", "w:xz") as archive:
        archive.add(recordings, ".")


def main() -> None:
    """Record those that are named, or all."""
    (FOLDER / "recordings").mkdir(exist_ok=True)
    for name in sys.argv[1:] or DEFECTS:
        with tempfile.TemporaryDirectory(prefix="record-") as scratch:
            recordings = record(name, Path(scratch))
            result = judged(recordings)
            print(name, result.score.earned, flush=True)
            for check in result.checks:
                if check.earned < check.possible:
                    print(
                        f"  {check.id} {check.outcome.value} {check.earned} of {check.possible}: {check.measured}"
                    )
                    print(f"    {check.reason} {check.hint}")
            keep(name, recordings)


if __name__ == "__main__":
    main()
