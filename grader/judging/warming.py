"""Builds what every judgement of a process or of its forks would build otherwise, before the first one."""

from __future__ import annotations

from grader.checks.registry import former_checks
from grader.evidence.crash.causes import table
from grader.lab.steps import STEPS
from grader.recording.record import prepare
from grader.recording.session import SessionRecord
from grader.recording.submission import SubmissionRecord
from launch_plan.plan import prepare_reader


def build_readers() -> None:
    """Build the readers of recordings and of launch plans, and read the table of causes and that of former checks.

    The first judgement takes a thirtieth of its time for that.
    """
    prepare([SessionRecord, SubmissionRecord, *(model.result for model in STEPS.values())])
    prepare_reader()
    table()
    former_checks()
