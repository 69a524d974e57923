"""Builds the packages of a submission, and records their outcomes; a cache keeps these and the installed files."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import shutil
import tarfile
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path, PurePosixPath

from confine.helpers import find_tool
from confine.interpreters import OWN_INTERPRETER
from confine.isolation import Isolation
from confine.scratch import scratch_prefix
from grader.files import replace_files
from grader.live.builds import colcon
from grader.live.builds.colcon import Installed, Ran
from grader.live.sandbox.cache import cache_folder
from grader.live.sandbox.installation import Installation, wheels_of
from grader.live.sandbox.room import WORKSPACE, StudentRoom, made_room
from grader.recording.record import from_plain
from grader.recording.submission import BuildFact, PackageFact, SubmissionRecord
from grader.submission.beneath import copy_tree, open_beneath

#: Characters of the output of one package that are recorded.
_MOST_OUTPUT = 8000
#: Installed files of one package that are recorded.
_MOST_INSTALLED = 1000
_MOST_CACHED = 2000
#: Lines of colcon around the output of a package.
_BEGINS = re.compile(r"^Starting >>> (\S+)\s*$")
_ENDS = re.compile(r"^(Finished|Failed|Aborted)\s+<<< (\S+) \[")
#: Beginnings of files that the system can start: a script, a program of Linux.
_STARTED = (b"#!", b"\x7fELF")
#: Lines of setuptools, colcon, CMake and make without a problem in them.
_NOISE = re.compile(
    r"(running|creating|copying|writing|reading|Copying|Installing|adding|removing) "
    r"|-- |\[ *\d+%\] |Built target |(Listing|Compiling) '"
    r"|.*(byte-compiling is disabled|doesn't contain any 'local_setup)|\s*$"
)
#: Build type with CMake and its package of ROS.
AMENT_CMAKE = "ament_cmake"
#: Commands of a build with CMake.
_CMAKE_TOOLS = ("cmake", "make", "cc", "c++")
#: Header of libssl-dev; the CMake files of Fast DDS need it.
_OPENSSL = Path("/usr/include/openssl/ssl.h")


def build_packages(
    folder: Path,
    submission: SubmissionRecord,
    isolation: Isolation,
    time_s: float,
    prefixes: Path,
    installation: Installation | None = None,
) -> list[BuildFact] | None:
    """Return the builds of a submission's packages; None if this machine cannot build.

    Parameters
    ----------
    folder
        Files of the submission.
    isolation
        Confinement of the builds; without namespaces nothing is built.
    time_s
        Time for all of its packages.
    prefixes
        Empty folder for the installed files; each built package gets a folder of its name.
    installation
        Installation of ROS of students' programs; None for the grader's own wheels.
    """
    if not submission.packages or not can_build(isolation):
        return None
    ros = _for_builds(installation)
    missing = _without_tool(submission, ros)
    others = [each for each in submission.packages if each not in missing]
    facts = [_lacks_tool(package, ros) for package in missing]
    if not others:
        return facts
    sources = _sources(submission, others)
    key = _key(others, sources, ros)
    cached = cache_folder("builds") / f"{key}.json"
    found = _from_cache(cached, prefixes)
    if found is None:
        found = _build(folder, others, sources, isolation, time_s, prefixes, ros)
        if all(fact.outcome != "not built" for fact in found):
            _keep(cached, found, prefixes)
    return facts + found


def can_build(isolation: Isolation) -> bool:
    """Return whether packages are built here: by colcon, in a sandbox that nothing outlives."""
    return isolation.namespaces and not colcon.lacking_builder()


def _for_builds(installation: Installation | None) -> Installation:
    """Return the ROS of builds with the grader's Python, which has colcon.

    The wheels of another interpreter can lack the packages for builds.
    """
    if installation is not None:
        if installation.is_named:
            return installation
    return wheels_of(OWN_INTERPRETER)


def lacking_compiler(installation: Installation | None = None) -> str:
    """Name the missing parts of a build with CMake; empty if this machine has all."""
    missing = [tool for tool in _CMAKE_TOOLS if find_tool(tool) is None]
    if not _OPENSSL.is_file():
        missing.append("libssl-dev")
    if not _for_builds(installation).has(AMENT_CMAKE):
        missing.append(AMENT_CMAKE)
    return ", ".join(missing)


def _without_tool(submission: SubmissionRecord, ros: Installation) -> list[PackageFact]:
    """Return the packages of a build type whose tools are missing here."""
    lacking = lacking_compiler(ros)
    if not lacking:
        return []
    missing = []
    for package in submission.packages:
        if package.build_type == AMENT_CMAKE and not _lacks_script(package, submission):
            missing.append(package)
    return missing


def _lacks_script(package: PackageFact, submission: SubmissionRecord) -> bool:
    """Return whether CMake, if it is here, surely stops for want of a CMakeLists.txt."""
    if find_tool("cmake") is None:
        return False
    script = f"{package.path}/CMakeLists.txt".lstrip("/")
    return all(file.path != script for file in submission.files)


def _lacks_tool(package: PackageFact, ros: Installation) -> BuildFact:
    reason = f"the grading computer lacks {lacking_compiler(ros)}, which builds it"
    return BuildFact(package.name, package.path, "not built", reason)


def _sources(submission: SubmissionRecord, packages: Iterable[PackageFact]) -> dict[str, str]:
    """Return the files of some packages with their hashes, except files of packages inside of them."""
    folders = {PurePosixPath(package.path) for package in submission.packages}
    wanted = {PurePosixPath(package.path) for package in packages}
    found = {}
    for file in submission.files:
        path = PurePosixPath(file.path)
        owners = [folder for folder in folders if path.is_relative_to(folder)]
        owner = max(owners, key=lambda folder: len(folder.parts), default=None)
        is_marker = path.name == "COLCON_IGNORE"
        if is_marker or owner in wanted:
            found[file.path] = file.sha256
    return found


def _key(packages: Iterable[PackageFact], sources: Mapping[str, str], ros: Installation) -> str:
    """Return a hash of everything on which the outcome depends."""
    named = [(package.name, package.path) for package in packages]
    how = []
    for file in (Path(__file__), Path(colcon.__file__), *colcon.INSIDE_FOLDER.iterdir()):
        how.append(file.read_text(encoding="utf-8"))
    whole = json.dumps(
        [named, sorted(sources.items()), colcon.builder_versions(), ros.facts(), how]
    )
    return hashlib.sha256(whole.encode("utf-8", "surrogateescape")).hexdigest()


def _build(
    folder: Path,
    packages: Iterable[PackageFact],
    sources: Iterable[str],
    isolation: Isolation,
    time_s: float,
    prefixes: Path,
    ros: Installation,
) -> list[BuildFact]:
    """Build packages in a throw-away workspace, and copy the prefixes of the built ones."""
    with tempfile.TemporaryDirectory(
        prefix=scratch_prefix(), ignore_cleanup_errors=True
    ) as scratch:
        building = replace(ros, interpreter=OWN_INTERPRETER)
        room = made_room(Path(scratch), building)
        workspace = room.areas[WORKSPACE]
        room.open_to_all(WORKSPACE)
        _copy(folder, sources, workspace / "src")
        ran = colcon.run_colcon(isolation, room, time_s, ros)
        parts = _parts_of(ran.output)
        facts = []
        for package in packages:
            facts.append(_fact(package, ran, parts, room))
            if facts[-1].outcome == "built":
                _copy_prefix(workspace, package.name, prefixes)
    return facts


def _copy_prefix(workspace: Path, package: str, prefixes: Path) -> None:
    """Copy the installed files of a package; a build may have put a link in their place, which is not followed."""
    with suppress(OSError):
        installed = open_beneath(workspace, f"install/{package}", os.O_RDONLY | os.O_DIRECTORY)
        try:
            (prefixes / package).mkdir()
            copy_tree(installed, prefixes / package)
        finally:
            os.close(installed)
        _settle_links(prefixes / package)


def _settle_links(prefix: Path) -> None:
    """Make links to files of the same folder, as of the versions of a library, names of these files; remove others."""
    links = filter(Path.is_symlink, list(prefix.rglob("*")))
    for link in links:
        file = Path(os.path.realpath(link))
        link.unlink()
        if file.parent != link.parent.resolve():
            continue
        if file.is_file():
            link.hardlink_to(file)


def _copy(folder: Path, sources: Iterable[str], target: Path) -> None:
    """Copy files, open to the user of a sandbox.

    Scripts with a `#!` line are made executable, because archives lose their modes.
    """
    target.mkdir()
    for name in sources:
        origin = folder / name
        if origin.is_symlink():
            continue
        if not origin.is_file():
            continue
        copy = target / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(origin, copy, follow_symlinks=False)
    for path in (target, *target.rglob("*")):
        path.chmod(_mode_of(path))


def _mode_of(path: Path) -> int:
    """Return the mode of a folder, a script or another file that is open to all."""
    if path.is_dir():
        return 0o777
    with path.open("rb") as file:
        head = file.read(2)
    if head == b"#!":
        return 0o777
    return 0o666


def _parts_of(output: str) -> dict[str, tuple[str, str]]:
    """Return for each package the word by which its build ended, and its part of the output.

    A setup.py can print the line of a success, but not take back the line of a failure: that one counts.
    """
    parts: dict[str, tuple[str, str]] = {}
    name = ""
    lines: list[str] = []
    for line in output.splitlines():
        begins = _BEGINS.match(line)
        ends = _ENDS.match(line)
        if begins is not None:
            name = begins[1]
            lines = []
        elif ends is not None and ends[2] == name:
            _end(parts, name, ends[1], lines)
        else:
            lines.append(line)
    if name and name not in parts:
        parts[name] = ("", "\n".join(lines))
    return parts


def _end(parts: dict[str, tuple[str, str]], name: str, word: str, lines: list[str]) -> None:
    """Note the end of a package's build, unless it failed before."""
    before = parts.get(name)
    if before is None or before[0] == "Finished":
        parts[name] = (word, "\n".join(lines))


def _fact(
    package: PackageFact, ran: Ran, parts: Mapping[str, tuple[str, str]], room: StudentRoom
) -> BuildFact:
    """Return the build of a package, by the run of colcon and the files that it left."""
    fact = BuildFact(package.name, package.path, "not built")
    if _is_skipped(package, parts, room):
        fact.outcome = "ignored"
        return fact
    ended, output = parts.get(package.name, ("", ran.output))
    fact.output = _shortened(output)
    is_consistent = ran.status == 0 or any(word != "Finished" for word, _ in parts.values())
    if ended == "Finished" and is_consistent:
        fact.outcome = "built"
        prefix = room.areas[WORKSPACE] / "install" / package.name
        _note_installed(fact, colcon.installed_in(prefix, _MOST_INSTALLED))
    elif ran.ended_by == "time":
        fact.reason = "its build did not end in the time that the lab gives it"
    elif ran.ended_by == "space":
        fact.outcome = "failed"
        fact.output = "The build wrote more files than fit into its workspace."
    elif ended or ran.status:
        fact.outcome = "failed"
    else:
        fact.outcome = "ignored"
    return fact


def _is_skipped(
    package: PackageFact, parts: Mapping[str, tuple[str, str]], room: StudentRoom
) -> bool:
    """Return whether colcon skips a package: below a COLCON_IGNORE, or inside another package."""
    workspace = room.areas[WORKSPACE]
    folder = PurePosixPath("src", package.path)
    for above in (folder, *folder.parents):
        if os.path.lexists(workspace / above / "COLCON_IGNORE"):
            return True
    if package.name in parts:
        return False
    for above in folder.parents:
        if os.path.lexists(workspace / above / "package.xml"):
            return True
    return False


def _note_installed(fact: BuildFact, files: Iterable[Installed]) -> None:
    """Note the installed files of a package, and the executables that the system cannot start."""
    for file in files:
        fact.installed.append(file.path)
        if not file.path.startswith(f"lib/{fact.package}/"):
            continue
        if not _can_start(file.head):
            fact.without_interpreter.append(file.path)
        elif not file.is_executable:
            fact.not_executable.append(file.path)


def _can_start(head: bytes) -> bool:
    """Return whether the system can start a file; a `#!` line of Windows, or with /usr/env, names no program."""
    if not head.startswith(_STARTED):
        return False
    return not re.match(rb"#![^\n]*\r\n|#!\s*(?!(?:/usr)?/bin/)\S*/env\b", head)


def _shortened(output: str) -> str:
    """Return the lines of an output with problems; beginning and end of a long one."""
    lines = [line for line in output.splitlines() if not _NOISE.match(line)]
    output = "\n".join(lines)
    if len(output) <= _MOST_OUTPUT:
        return output
    half = _MOST_OUTPUT // 2
    return f"{output[:half]}\n[...]\n{output[-half:]}"


# -- the cache -------------------------------------------------------------------------------------


def _from_cache(cached: Path, prefixes: Path) -> list[BuildFact] | None:
    """Return builds from the cache, with their installed files; None if it has none."""
    try:
        plain = json.loads(cached.read_text(encoding="utf-8"))
        facts = [from_plain(BuildFact, fact) for fact in plain]
        with tarfile.open(_archive(cached)) as archive:
            archive.extractall(prefixes, filter="data")
    except (OSError, ValueError, TypeError, tarfile.TarError):
        for left in prefixes.iterdir():
            shutil.rmtree(left)
        return None
    return facts


def _keep(cached: Path, facts: Iterable[BuildFact], prefixes: Path) -> None:
    """Keep builds with their installed files in the cache; without a home folder, nothing is kept."""
    with suppress(OSError):
        cached.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        archived = io.BytesIO()
        with tarfile.open(fileobj=archived, mode="w") as archive:
            archive.add(prefixes, arcname=".", filter=_plain_member)
        outcomes = json.dumps([asdict(fact) for fact in facts])
        replace_files({_archive(cached): archived.getvalue(), cached: outcomes})
        entries = sorted(cached.parent.glob("*.json"), key=lambda path: path.stat().st_mtime)
        for old in entries[:-_MOST_CACHED]:
            old.unlink()
            _archive(old).unlink(missing_ok=True)


def _archive(cached: Path) -> Path:
    """Return the archive of the installed files beside the outcomes of builds."""
    return cached.with_suffix(".tar")


def _plain_member(member: tarfile.TarInfo) -> tarfile.TarInfo | None:
    """Return a file, one more name of it, or a folder for an archive."""
    if member.type in (tarfile.DIRTYPE, tarfile.REGTYPE, tarfile.LNKTYPE):
        return member
    return None
