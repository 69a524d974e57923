"""Interface for a lab's own checks: import it in a file beside the rubric.

A check is a pure function of a recording. The rubric names it by its file, `check: checks/mine.py:keeps_away`, and its
parameters are given under `with`, as for the built-in checks:

    from dataclasses import dataclass

    from grader.own_checks import Context, Finding, Topic, Window, failed, graded


    @dataclass
    class Parameters:
        topic: Topic
        window: Window
        least_m: float = 0.3


    def keeps_away(context: Context, p: Parameters) -> Finding:
        rows = context.messages(p.topic, p.window).numbers("ranges")
        nearest = [min(row) for row in rows if row is not None and len(row)]
        expected = f"never nearer than {p.least_m:g} m"
        if not nearest:
            return failed(expected, "no ranges", "No message with ranges was published.")
        share = sum(distance >= p.least_m for distance in nearest) / len(nearest)
        return graded(share, expected, f"{min(nearest):.2f} m", "The robot came too near.", levels=10)

- The second argument names a dataclass (or a pydantic model) of the same file. A field without a value is required.
  A field annotated as `Topic`, `Window`, `Process`, `FieldPath`, ... is looked up when the rubric loads, so that a
  typing mistake is reported with its line. Without parameters the function takes the context alone.
- A check of files alone, without a session, takes `submission: Submission` in place of the context.
- It returns a finding of `passed`, `failed`, `graded` or `inconclusive`: the expected and the measured value, and why
  points are lost. `inconclusive` is for losses that the grading computer may have caused (`Context.delay_s`); it costs none.
- An exception, more than 10 s of computing, or more than 30 s in all makes it an error that names file and line; that
  costs nothing either.
- Points that it takes stay open where a program needs a library or interface that the grading computer lacks, as with
  the built-in checks. A parameter called `artifact` or `process` says which program that is; without, any of the session.
- Messages and output come from students' programs: expect any, also of another type. An error that a
  message brings about costs its author nothing.
- A file imports installed packages, not its neighbours: it alone is kept with each recording.
- Limits and descriptions in pydantic's `Field` count when the rubric loads. Models that are keys of a dict are frozen.
- The decorator `check` states commands for students, and which parts of a recording the check needs.
- A parameter called `artifact` names a file; where that was not handed in, the check fails without being called.

Within a version of `API_VERSION` nothing that is defined here is removed or changes its meaning. A file that says
`API_VERSION = 1` is refused by a grader of another version.
"""

from grader.checks.base import Part as Part
from grader.checks.base import apart as apart
from grader.checks.base import excused as excused
from grader.checks.base import failed as failed
from grader.checks.base import graded as graded
from grader.checks.base import inconclusive as inconclusive
from grader.checks.base import not_reached as not_reached
from grader.checks.base import of_parts as of_parts
from grader.checks.base import passed as passed
from grader.checks.base import percent as percent
from grader.checks.base import quantise as quantise
from grader.checks.base import ramp as ramp
from grader.checks.base import unclear as unclear
from grader.checks.base import undecided as undecided
from grader.checks.base import unexplained as unexplained
from grader.checks.endpoints import clash as clash
from grader.checks.own import check as check
from grader.checks.own_context import Call as Call
from grader.checks.own_context import Claim as Claim
from grader.checks.own_context import Context as Context
from grader.checks.own_context import Line as Line
from grader.checks.own_context import Messages as Messages
from grader.checks.own_context import Run as Run
from grader.checks.own_context import Series as Series
from grader.checks.own_context import Step as Step
from grader.checks.own_context import Submission as Submission
from grader.checks.service import answer_cause as answer_cause
from grader.checks.service import parameter_cause as parameter_cause
from grader.evidence.bounds import Delayed as Delayed
from grader.evidence.bounds import cpu_delay_doubt as cpu_delay_doubt
from grader.evidence.bounds import without_delay as without_delay
from grader.evidence.cpu_delay import Backlog as Backlog
from grader.evidence.recorded import NumericStream as NumericStream
from grader.evidence.source_causes import always_true_parameter as always_true_parameter
from grader.evidence.source_causes import appended_again as appended_again
from grader.evidence.source_causes import debug_log as debug_log
from grader.evidence.source_causes import hidden_exception as hidden_exception
from grader.evidence.source_causes import idle_callback as idle_callback
from grader.evidence.source_causes import late_lambda as late_lambda
from grader.evidence.text.printed import PrintedVector as PrintedVector
from grader.evidence.text.printed import Report as Report
from grader.evidence.text.result_rows import ResultRow as ResultRow
from grader.lab.lab_code import API_VERSION as API_VERSION
from grader.lab.patterns import search as search
from grader.lab.references import AnyStep as AnyStep
from grader.lab.references import Artifact as Artifact
from grader.lab.references import CallLabel as CallLabel
from grader.lab.references import CheckId as CheckId
from grader.lab.references import Durability as Durability
from grader.lab.references import EarlierCheckId as EarlierCheckId
from grader.lab.references import ExitLabel as ExitLabel
from grader.lab.references import FieldPath as FieldPath
from grader.lab.references import GetLabel as GetLabel
from grader.lab.references import GivenName as GivenName
from grader.lab.references import History as History
from grader.lab.references import Loadable as Loadable
from grader.lab.references import MessageType as MessageType
from grader.lab.references import Pattern as Pattern
from grader.lab.references import Patterns as Patterns
from grader.lab.references import PlanLabel as PlanLabel
from grader.lab.references import Process as Process
from grader.lab.references import ReferenceNode as ReferenceNode
from grader.lab.references import Reliability as Reliability
from grader.lab.references import RosName as RosName
from grader.lab.references import ServiceType as ServiceType
from grader.lab.references import SessionId as SessionId
from grader.lab.references import SetLabel as SetLabel
from grader.lab.references import Share as Share
from grader.lab.references import StampField as StampField
from grader.lab.references import TextField as TextField
from grader.lab.references import Topic as Topic
from grader.lab.references import Window as Window
from grader.lab.references import fields_of_type as fields_of_type
from grader.lab.steps.get_parameters import ParameterValue as ParameterValue
from grader.lab.steps.send_goal import Feedback as Feedback
from grader.lab.steps.send_goal import GoalRecord as GoalRecord
from grader.result import Finding as Finding
from grader.result import Location as Location
from grader.result import Outcome as Outcome
from ros_bag.qos import Qos as Qos
