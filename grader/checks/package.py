"""Check of a ROS package: `colcon build` builds it, and installs its parts where ROS finds them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from fnmatch import filter as filter_names
from fnmatch import fnmatchcase
from pathlib import PurePosixPath
from typing import ClassVar

from pydantic import Field

from grader.checks.base import Context, Part, failed, inconclusive, of_parts
from grader.evidence.build_faults import (
    BuildFault,
    build_fault,
    built_folders,
    is_put_aside,
    line_with,
    within,
)
from grader.evidence.compiled import why_not_built
from grader.evidence.installed_faults import (
    entry_fault,
    executables_in,
    has_own_marker,
    start_fault,
    use_fault,
)
from grader.evidence.known_packages import ros_packages
from grader.evidence.manifest_faults import (
    manifest_problem,
    misspelt_dependencies,
    undeclared_dependencies,
)
from grader.lab import references as ref
from grader.lab.references import Parameters
from grader.recording.submission import BuildFact, PackageFact
from grader.result import Finding, Location
from grader.submission.packages.colcon import is_launch_file

#: Names that are listed in a reason.
_MOST_NAMED = 5


class PackageBuilds(Parameters):
    """A package is built by `colcon build`, with its parts where ROS finds them.

    The parts are the build itself, executables for `ros2 run`, launch and other files, the marker in the index of ROS,
    declared dependencies, and a submission without folders made by colcon. A part with weight 0 is not judged.
    """

    of_session = False
    example: ClassVar = {"executables": ["talker"], "files": ["launch/*"]}

    package: ref.GivenName | None = Field(
        None, description="Name of the package; by default all packages of the submission count."
    )
    executables: tuple[ref.GivenName, ...] = Field(
        (), description="Executables that `ros2 run` must find; by default all that are declared."
    )
    files: tuple[str, ...] = Field(
        (),
        description="Patterns of files that must be installed below share/PACKAGE; launch files may be in any folder there.",
    )
    builds: float = Field(4.0, ge=0, description="Weight of a build without an error.")
    runs: float = Field(2.0, ge=0, description="Weight of the executables.")
    shares: float = Field(1.0, ge=0, description="Weight of the files.")
    marker: float = Field(1.0, ge=0, description="Weight of the marker in the index of ROS.")
    declares: float = Field(1.0, ge=0, description="Weight of the declared dependencies.")
    clean: float = Field(
        1.0, ge=0, description="Weight of a submission without folders that colcon makes."
    )


def package_builds(context: Context, p: PackageBuilds) -> Finding:
    """Judge the recorded build; the rest of the submission is judged by an installation as it was meant."""
    expected = f"a package {p.package} that builds" if p.package else "packages that build"
    packages = _wanted(context, p)
    if not packages:
        named = f"a package {p.package}" if p.package else "a package"
        reason = (
            f"There is no {named.removeprefix('a ')} in the submission: no package.xml names it."
        )
        hint = "`ros2 pkg create --build-type ament_python NAME` makes one."
        return failed(expected, "no package", reason, hint=hint)
    parts: list[Part] = []
    for package in packages:
        build = context.submission.build_of(package)
        undecided = _undecided(package, build)
        if build is None or undecided:
            where = (_manifest(package),)
            return inconclusive(expected, "not built here", undecided, where=where, retry=False)
        parts += _parts(context, p, package, build)
    parts.append(_clean(context, p))
    judged = [part for part in parts if part.weight > 0]
    return of_parts(expected, judged)


def _wanted(context: Context, p: PackageBuilds) -> list[PackageFact]:
    """Return the packages that count: the named one, or all but those beside COLCON_IGNORE."""
    submission = context.submission
    if p.package is not None:
        return [package for package in submission.packages if package.name == p.package]
    found = [each for each in submission.packages if not is_put_aside(each, submission.texts)]
    return found or submission.packages


def _undecided(package: PackageFact, build: BuildFact | None) -> str:
    """Say why the build of a package is unknown; empty if it is known."""
    reason = why_not_built(build)
    if not reason:
        return ""
    return f"The package {package.name} was not built: {reason}. Your instructor decides."


def _manifest(package: PackageFact) -> Location:
    return Location(file=f"{package.path}/package.xml".lstrip("/"))


def _in_build_file(context: Context, package: PackageFact, *texts: str) -> tuple[Location, ...]:
    """Return the build file of a package, at the first line with one of some texts."""
    name = "CMakeLists.txt"
    if package.build_type == "ament_python":
        name = "setup.py"
    file = within(package, name)
    return (Location(file=file, line=line_with(context.submission.texts.get(file, ""), *texts)),)


def build_cause(package: PackageFact) -> str:
    """Name the mistake of a package without a working build, to charge it once."""
    return f"build of {package.name}"


_Judge = Callable[[Context, PackageBuilds, PackageFact, BuildFact], Part]


def _parts(
    context: Context, p: PackageBuilds, package: PackageFact, build: BuildFact
) -> Iterator[Part]:
    """Yield the parts of one package; a failed build loses its unknown parts too."""
    fault = build_fault(package, build, context.submission.texts)
    weights = {_runs: p.runs, _shares: p.shares, _marker: p.marker, _declares: p.declares}
    judges: dict[_Judge, float] = {**weights}
    if fault is not None:
        lost = sum((p.builds, p.runs, p.shares, p.marker))
        part = replace(_lost(fault), weight=lost)
        yield context.charge_part(part, build_cause(package))
        judges = {_declares: p.declares}
    else:
        yield Part(1.0, f"{package.name} builds", weight=p.builds)
    for judge, weight in judges.items():
        yield replace(judge(context, p, package, build), weight=weight)


def _lost(fault: BuildFault) -> Part:
    where = (Location(file=fault.file, line=fault.line),)
    return Part(0.0, "it does not build", fault.message, hint=fault.remedy, where=where)


def _runs(context: Context, p: PackageBuilds, package: PackageFact, build: BuildFact) -> Part:
    """Judge the executables found and started by `ros2 run`."""
    found = executables_in(build)
    texts = context.submission.texts
    fault = use_fault(package, build, texts)
    if fault is None:
        fault = start_fault(package, build, texts, found)
    if fault is None:
        fault = entry_fault(package, build, texts)
    if fault is not None:
        part = replace(_lost(fault), text="executables that ROS cannot start")
        return context.charge_part(part, build_cause(package))
    missing = [name for name in p.executables if name not in found]
    if missing:
        named = _named(missing)
        reason = f"The package {package.name} installs no executable {named}."
        hint = f"Add '{missing[0]} = {package.name}.MODULE:main' to console_scripts in setup.py."
        where = _in_build_file(context, package, "console_scripts")
        if package.build_type != "ament_python":
            hint = f"Add install(TARGETS {missing[0]} DESTINATION lib/${{PROJECT_NAME}}) to CMakeLists.txt."
            where = _in_build_file(context, package, f"add_executable({missing[0]}")
        share = 1 - len(missing) / len(p.executables)
        return Part(share, f"no executable {named}", reason, hint=hint, where=where)
    return Part(1.0, f"{len(found)} executables")


def _shares(context: Context, p: PackageBuilds, package: PackageFact, build: BuildFact) -> Part:
    """Judge the wanted files in the share folder of the package."""
    if not p.files:
        return Part(1.0)
    missing = [pattern for pattern in p.files if not _is_installed(pattern, build)]
    if not missing:
        return Part(1.0, "its files are installed")
    named = _named(missing)
    reason = f"The package {package.name} does not install {named} in share/{package.name}."
    folder = str(PurePosixPath(missing[0]).parent)
    source = f"['{missing[0]}']"
    if "*" in missing[0]:
        source = f"glob('{missing[0]}')"
    hint = f"Add ('share/{package.name}/{folder}', {source}) to data_files in setup.py."
    where = _in_build_file(context, package, f"/{folder}'", f'/{folder}"', "data_files")
    if package.build_type != "ament_python":
        hint = f"Add install(DIRECTORY {folder} DESTINATION share/${{PROJECT_NAME}}) to CMakeLists.txt."
        where = _in_build_file(context, package, f"DIRECTORY {folder}", "ament_package(")
    share = 1 - len(missing) / len(p.files)
    return Part(share, f"without {named}", reason, hint=hint, where=where)


def _is_installed(pattern: str, build: BuildFact) -> bool:
    """Return whether a file fits a pattern; `ros2 launch` finds a launch file in any folder below share/PACKAGE."""
    share = f"share/{build.package}/"
    name = PurePosixPath(pattern).name
    launch = []
    for path in build.installed:
        if fnmatchcase(path, f"{share}{pattern}"):
            return True
        if not path.startswith(share):
            continue
        if is_launch_file(path):
            launch.append(PurePosixPath(path).name)
    return bool(filter_names(launch, name))


def _marker(context: Context, p: PackageBuilds, package: PackageFact, build: BuildFact) -> Part:
    """Judge the marker of the package in the index of ROS."""
    if has_own_marker(build):
        return Part(1.0, "it is in the index")
    reason = f"The build files of {package.name} do not install its marker in the index of ROS."
    folder = "share/ament_index/resource_index/packages"
    hint = f"Add ('{folder}', ['resource/{package.name}']) to data_files in setup.py."
    if package.build_type != "ament_python":
        hint = "Write ament_package() as the last line of CMakeLists.txt."
    where = _in_build_file(context, package, "data_files")
    return Part(0.0, "no marker", reason, hint=hint, where=where)


def _declares(context: Context, p: PackageBuilds, package: PackageFact, build: BuildFact) -> Part:
    """Judge whether package.xml names all imported packages of ROS, and by their names."""
    manifest = context.submission.texts.get(within(package, "package.xml"), "")
    if manifest_problem(manifest) is not None:
        return Part(1.0, "its package.xml is not read")
    misspelt = misspelt_dependencies(context.submission, package)
    for name, meant in misspelt.items():
        reason = f"package.xml of {package.name} names {name}, which no distribution of ROS 2 has."
        line = line_with(manifest, f">{name}<")
        place = replace(_manifest(package), line=line)
        hint = f"Write {meant} instead of {name}."
        return Part(0.0, f"{name} misspelt", reason, hint=hint, where=(place,))
    found = undeclared_dependencies(context.submission, package, ros_packages())
    if not found:
        return Part(1.0, "it declares its dependencies")
    named = _named(sorted(found))
    reason = f"The package {package.name} imports {named}, which package.xml does not declare."
    first = min(found)
    hint = f"Add <exec_depend>{first}</exec_depend> to package.xml."
    where = (_manifest(package), Location(file=found[first]))
    return Part(0.0, f"{named} undeclared", reason, hint=hint, where=where)


def _clean(context: Context, p: PackageBuilds) -> Part:
    """Judge whether folders made by colcon were handed in."""
    folders = built_folders(context.submission)
    if not folders:
        return Part(1.0, weight=p.clean)
    named = _named(folders)
    reason = f"The submission holds {named}, which `colcon build` makes again."
    hint = "Leave build/, install/ and log/ out of the submission."
    where = (Location(file=folders[0]),)
    return Part(0.0, f"with {named}", reason, hint=hint, where=where, weight=p.clean)


def _named(names: list[str]) -> str:
    """Return the first of some names in words."""
    more = len(names) - _MOST_NAMED
    shown = ", ".join(names[:_MOST_NAMED])
    return f"{shown} and {more} more" if more > 0 else shown
