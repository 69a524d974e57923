"""Hook of mkdocs: the gallery of labs, with the rubric and a sample report of each.

The reports are judged from kept recordings of real gradings while the site is built.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from site_pages import ROOT, plain

from grader.judging.judgement import Judgement, judge_bounded
from grader.judging.rubrics import read_rubric
from grader.lab.overrides import Overrides
from grader.lab.rubric import CheckSpec, CriterionSpec, Rubric


@dataclass(frozen=True)
class Shown:
    """A lab of the gallery.

    Attributes
    ----------
    rubric, handout, sample : str
        Paths in the repository; `sample` is a folder of recordings.
    mistake : str
        Mistake of the sample, as the end of a sentence.
    """

    rubric: str
    handout: str
    sample: str
    mistake: str


def _of_folder(name: str, mistake: str, handout: str = "handout.md") -> Shown:
    """Return a lab below `labs/` with its sample in `docs/samples/`."""
    folder = f"labs/{name}"
    return Shown(f"{folder}/rubric.yaml", f"{folder}/{handout}", f"docs/samples/{name}", mistake)


LABS: Mapping[str, Shown] = {
    "09-01": Shown(
        "rubric.yaml",
        "reference/handout/extensions.md",
        "tests/recordings/six_joints",
        "sends six numbers for seven joints; only two sessions were run",
    ),
    "09-02": _of_folder("09-02", "attaches every frame to the base", "HANDOUT.md"),
    "talker-relay": _of_folder("talker-relay", "publishes twice a second in place of 50 times"),
    "number-counter": _of_folder("number-counter", "misspells a field of its own service"),
    "go-to-goal": _of_folder("go-to-goal", "drives faster than the limit"),
    "emergency-brake": _of_folder("emergency-brake", "brakes too early"),
    "scan-filter": _of_folder("scan-filter", "tells a bearing in degrees"),
}


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Add a page and a sample report for each lab."""
    for name, lab in LABS.items():
        rubric = read_rubric(ROOT / lab.rubric)
        judged = judge_bounded(ROOT / lab.sample, rubric, Overrides())
        page = "\n".join(_page(name, lab, rubric, judged))
        files.append(File.generated(config, f"lab-{name}.md", content=page))
        files.append(File.generated(config, _report(name), content=judged.page))


def _report(name: str) -> str:
    return f"lab-{name}-report.html"


def _page(name: str, lab: Shown, rubric: Rubric, judged: Judgement) -> Iterator[str]:
    """Yield the lines of a lab's page."""
    yield f"# {rubric.lab.title}"
    checks = len(list(rubric.checks()))
    experiments = len(rubric.sessions)
    yield f"\n{rubric.lab.points} points, {checks} checks, {experiments} experiments on a live ROS graph.\n"
    yield f"[Sample report]({_report(name)}){{ .md-button .md-button--primary }}"
    yield f"[Handout](../{lab.handout}){{ .md-button }}"
    yield f"[Rubric as YAML](../{lab.rubric}){{ .md-button }}\n"
    score = judged.result.score
    yield (
        f"The sample is a real grading of a submission that {lab.mistake}: {score.earned} of {score.possible} points. "
        "It was judged again while this site was built.\n"
    )
    yield "## Rubric"
    expected = {check.id: check.expected for check in judged.result.checks}
    yield from _criteria(rubric.criteria, expected)
    if rubric.bonus:
        yield "\n## Extensions\n"
        yield "Judged where they are handed in, and shown beside the points."
        yield from _criteria(rubric.bonus, expected)


def _criteria(criteria: Iterable[CriterionSpec], expected: Mapping[str, str]) -> Iterator[str]:
    """Yield a table for each criterion."""
    for criterion in criteria:
        yield f"\n### {plain(criterion.title)} ({criterion.points} points)\n"
        if criterion.description:
            yield f"{plain(criterion.description)}\n"
        # On a phone, the style of keys lays out the columns below each other.
        yield "<div class='keys' markdown>\n"
        yield "| points | check | kind | full credit |"
        yield "|--:|---|---|---|"
        for check in criterion.checks:
            wanted = plain(expected.get(check.id, ""))
            yield f"| {check.points} | {plain(check.title)} | {_kind(check)} | {wanted} |"
        yield "\n</div>"


def _kind(check: CheckSpec) -> str:
    """Return the kind of a check: a link to a built-in one, or the name of a function of the lab."""
    if check.by_person:
        return "a person"
    if ":" in check.check:
        return f"`{check.check.partition(':')[2]}`, of the lab's own"
    return f"[{check.check}](checks.md#{check.check})"
