"""The result in the forms that CI systems and learning platforms read; each is one function over `result.json`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from grader.errors import GraderError
from grader.report.exports.variables import CLASSROOM50
from grader.result_folder import EXPORTED

if TYPE_CHECKING:
    from grader.report.exports.graded import Graded
    from grader.report.exports.returned import Returned, ReturnedClass
    from grader.result import Result


@dataclass(frozen=True)
class Export:
    """A form of the result for another system, and the environment variables that it needs.

    The form is written into the results folder under `file_name` unless another file is given.
    """

    name: str
    description: str
    file_name: str
    render: Callable[[Graded, Mapping[str, str]], str]
    variables: tuple[str, ...] = ()

    def require_variables(self, environment: Mapping[str, str]) -> None:
        """Raise GraderError if a variable of this form is not set."""
        missing = [name for name in self.variables if not environment.get(name)]
        if missing:
            raise GraderError(
                f"the form {self.name} needs the variables {', '.join(missing)}",
                remedy="The system that reads this form sets them where it grades; see docs/ci.md.",
            )


def _in(module: str, function: str = "render") -> Callable[..., Any]:
    """Return a function of a module in this folder.

    The module is imported by the first call, because all modules together take 3 % of a grading's own time.
    """

    def call(*arguments: Any) -> Any:
        found = import_module(f"{__name__}.{module}")
        return attrgetter(function)(found)(*arguments)

    return call


_ALL = (
    Export(
        "github-summary", "Markdown for GitHub's job summary", "summary.md", _in("github_summary")
    ),
    Export(
        "github-annotations",
        "GitHub workflow commands that mark lines of the student's files",
        "annotations.txt",
        _in("github_annotations"),
    ),
    Export("junit", "JUnit XML, as Jenkins and GitLab read it", "junit.xml", _in("junit")),
    Export(
        "gitlab-codequality",
        "GitLab's code quality report",
        "codequality.json",
        _in("gitlab_codequality"),
    ),
    Export("gradescope", "Gradescope's results.json", "gradescope.json", _in("gradescope")),
    Export(
        "classroom50",
        "Classroom 50's result.json",
        "classroom50.json",
        _in("classroom50"),
        tuple(CLASSROOM50.values()),
    ),
)
EXPORTS: Mapping[str, Export] = {export.name: export for export in _ALL}


@dataclass(frozen=True)
class ClassExport:
    """A form of the results of a class, or of one submission, for another system or a mail program."""

    name: str
    description: str
    file_name: str
    render: Callable[[ReturnedClass], Returned]


_ALL_OF_CLASS = (
    ClassExport(
        "moodle", "grades for Moodle", f"{EXPORTED}/moodle.csv", _in("gradebooks", "MOODLE.render")
    ),
    ClassExport(
        "canvas", "grades for Canvas", f"{EXPORTED}/canvas.csv", _in("gradebooks", "CANVAS.render")
    ),
    ClassExport(
        "blackboard",
        "grades for Blackboard",
        f"{EXPORTED}/blackboard.csv",
        _in("gradebooks", "BLACKBOARD.render"),
    ),
    ClassExport(
        "brightspace",
        "grades for Brightspace",
        f"{EXPORTED}/brightspace.csv",
        _in("gradebooks", "BRIGHTSPACE.render"),
    ),
    ClassExport(
        "feedback",
        "reports, as Moodle and Canvas take them",
        f"{EXPORTED}/feedback.zip",
        _in("feedback"),
    ),
    ClassExport(
        "mail", "a mailbox with a mail a student", f"{EXPORTED}/mail.mbox", _in("mail", "mailbox")
    ),
    ClassExport("eml", "the same mails as files", f"{EXPORTED}/mail.zip", _in("mail", "files")),
)
CLASS_EXPORTS: Mapping[str, ClassExport] = {export.name: export for export in _ALL_OF_CLASS}
#: Forms by their names.
Forms = Mapping[str, Export | ClassExport]


def render_export(
    name: str,
    result: Result,
    *,
    path_prefix: str = "",
    environment: Mapping[str, str] | None = None,
) -> str:
    """Return a result in another system's form; `path_prefix` is the submission's folder in its repository.

    Raises
    ------
    GraderError
        If a variable of the form is not set.
    """
    # Imported late: a grading without exports does not need it.
    from grader.report.exports.graded import graded

    export = EXPORTS[name]
    variables = environment or {}
    export.require_variables(variables)
    return export.render(graded(result, path_prefix), variables)
