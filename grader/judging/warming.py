"""Builds the common parts of all judgements before the first one, in the process or before its forks."""

from __future__ import annotations

import numpy as np

from grader.checks.registry import former_checks
from grader.evidence.crash.causes import table
from grader.lab.steps import STEPS
from grader.recording.record import prepare
from grader.recording.session import SessionRecord
from grader.recording.submission import SubmissionRecord
from launch_plan.plan import prepare_reader


def build_readers() -> None:
    """Build the readers of recordings and of launch plans, and read the tables of causes and of former checks.

    The first judgement takes a thirtieth of its time for that.
    """
    prepare([SessionRecord, SubmissionRecord, *(model.result for model in STEPS.values())])
    prepare_reader()
    table()
    former_checks()


def keep_freed_memory() -> None:
    """Let this process and its forks use the memory of freed arrays of up to 8 MiB again.

    The C library of GNU gives freed blocks above its threshold back to the kernel, and a page of a new block costs a
    fault: a fifth of the faults of a judgement. The threshold rises to the size of the largest block that was freed.

    References
    ----------
    mallopt(3), M_MMAP_THRESHOLD.
    """
    block = np.empty(2**20)
    del block
