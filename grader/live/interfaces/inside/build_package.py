"""Generates and compiles one interface package; runs confined, as students' code does, and knows nothing of the grader.

    python -I build_package.py SOURCE TARGET PREFIX...

SOURCE is the package's folder with `msg/`, `srv/` and `action/`; TARGET becomes an ament prefix of its own; the
PREFIXES hold packages that it may depend on. One line of JSON is printed: `{}`, or `problem` with the reason
that it cannot be built, and `invalid` if `colcon build` would refuse it too.

No build file of the package is run or read, and of its definitions nothing reaches the generators but names, types and
values of a few characters: rosidl puts comments into C as they stand, so that one with the end of a C comment is code.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy
import rosidl_generator_c
import rosidl_generator_py
import rosidl_generator_type_description
import rosidl_typesupport_c
import rosidl_typesupport_fastrtps_c
import rosidl_typesupport_introspection_c
from rosidl_adapter import parser, resource

#: Longest time for reading the definitions: some texts keep rosidl's patterns busy for ever.
_READING_S = 10
#: Largest size of a bounded message, because the middleware reserves memory for many before the first is sent.
_MOST_BYTES = 64 * 1024
_MOST_DEPTH = 20
#: Text permitted in a definition: nothing with a meaning within C, IDL or Python.
_PLAIN = re.compile(r"[A-Za-z0-9 _.,:;/+=()<>&!|^~-]{0,1000}")
_BYTES = {"bool": 1, "byte": 1, "char": 1, "wstring": 4, "string": 1}
#: Packages that every service and action uses.
_IMPLIED = ("builtin_interfaces", "service_msgs", "action_msgs", "unique_identifier_msgs")
#: Type supports for sending messages and for describing their types; found by the names of their libraries.
_SUPPORTS = ("rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c")
_PARTS = ("rosidl_generator_c", *_SUPPORTS, "rosidl_typesupport_c", "rosidl_generator_py")
#: Libraries that the generated code uses.
_RUNTIME = (
    "rosidl_runtime_c",
    "rosidl_typesupport_fastrtps_c",
    "fastcdr",
    "rcutils",
    "rosidl_typesupport_fastrtps_cpp",
    "rmw",
    "rosidl_typesupport_c",
    "rosidl_typesupport_introspection_c",
)
#: Functions that read definitions; all others are actions.
_READERS = {"msg": parser.parse_message_string, "srv": parser.parse_service_string}
#: Attributes of a definition that are messages.
_MESSAGES = {"srv": ("request", "response"), "action": ("goal", "result", "feedback")}
_COMPILERS = {".c": ("cc", "-std=gnu11"), ".cpp": ("c++", "-std=gnu++17")}
#: Without optimisation, as `colcon build` compiles where nothing else is asked for.
_FLAGS = ("-fPIC", "-O0", "-w")


class Refused(Exception):
    """The package is not built; `invalid` where that is for a mistake in it."""

    def __init__(self, problem: str, *, invalid: bool) -> None:
        super().__init__(problem)
        self.invalid = invalid


class Package:
    """The definitions of a package, and where those are that it may use."""

    def __init__(self, source: Path, target: Path, prefixes: Sequence[Path]) -> None:
        self.name = source.name
        self.source = source
        self.target = target
        self.prefixes = prefixes
        self.work = target.with_name(f"{target.name}.work")
        # Two generators write files of the same names.
        self.code = self.work / self.name
        self.described = self.work / "introspection" / self.name
        self.files = sorted(path.relative_to(source) for path in source.glob("*/*.*"))
        self.messages: dict[str, Any] = {}

    def build(self) -> None:
        """Make the prefix."""
        signal.alarm(_READING_S)
        idl = [self._translate(file) for file in self.files]
        for name in self.messages:
            size = self._size(self.name, name)
            if size > _MOST_BYTES:
                text = f"{name} takes {size} bytes, more than the {_MOST_BYTES} for which the grader has room"
                raise Refused(text, invalid=False)
        signal.alarm(0)
        self._generate(idl)
        self._compile()
        self._install()

    # -- reading ------------------------------------------------------------------------------

    def _translate(self, file: Path) -> Path:
        """Read a definition, and write its needed parts as IDL."""
        kind = file.suffix[1:]
        read = _READERS.get(kind, parser.parse_action_string)
        path = self.source / file
        try:
            text = path.read_text(encoding="utf-8")
            spec = read(self.name, file.stem, text)
        except Exception as problem:
            reason = " ".join(str(problem).split())
            raise Refused(f"{file}: {reason[:300]}", invalid=True) from problem
        for message in _messages_of(spec, kind):
            self.messages[message.msg_name] = message
            self._clean(file, message)
        described = self.code / file
        output = described.with_suffix(".idl")
        output.parent.mkdir(parents=True, exist_ok=True)
        data = {"pkg_name": self.name, "relative_input_file": file.as_posix(), kind: spec}
        resource.expand_template(f"{kind}.idl.em", data, output, encoding="utf-8")
        return output

    def _clean(self, file: Path, message: Any) -> None:
        message.annotations = {}
        for part in (*message.constants, *message.fields):
            part.annotations = {}
            if not all(map(_PLAIN.fullmatch, _texts_of(part))):
                text = f"{file}: the value of {part.name} has characters that the grader does not pass on"
                raise Refused(text, invalid=False)
        for field in message.fields:
            self._require(file, field.type)

    def _require(self, file: Path, kind: Any) -> None:
        """See to it that a field's type is there."""
        if kind.is_primitive_type():
            return
        package = kind.pkg_name
        if package == self.name:
            if Path("msg", f"{kind.type}.msg") not in self.files:
                raise Refused(f"{file}: there is no {kind.type}.msg in {self.name}", invalid=True)
        elif not any(self._shared(package)):
            problem = f"{file}: {package} is not installed where it was graded"
            raise Refused(problem, invalid=False)
        elif not any(self._files_of(package, kind.type)):
            raise Refused(f"{file}: {package} has no message {kind.type}", invalid=True)

    def _shared(self, package: str) -> Iterator[Path]:
        shares = (prefix / "share" / package for prefix in self.prefixes)
        return filter(Path.is_dir, shares)

    def _files_of(self, package: str, message: str) -> Iterator[Path]:
        files = (share / "msg" / f"{message}.msg" for share in self._shared(package))
        return filter(Path.is_file, files)

    def _size(self, package: str, name: str, depth: int = 0) -> int:
        """Return the largest size of a message in bytes, with each unbounded part counted once."""
        if depth > _MOST_DEPTH:
            raise Refused(f"{name} holds itself", invalid=True)
        fields = self._message(package, name).fields
        return sum(self._field_size(field.type, depth) for field in fields)

    def _message(self, package: str, name: str) -> Any:
        if package == self.name:
            return self.messages[name]
        file = next(self._files_of(package, name))
        text = file.read_text(encoding="utf-8")
        return parser.parse_message_string(package, name, text)

    def _field_size(self, kind: Any, depth: int) -> int:
        elements = kind.array_size or 1
        if not kind.is_primitive_type():
            return elements * self._size(kind.pkg_name, kind.type, depth + 1)
        characters = kind.string_upper_bound or 1
        return elements * characters * _element_size(kind.type)

    # -- generating ---------------------------------------------------------------------------

    def _arguments(self, generator: str, idl: Sequence[Path], **more: Any) -> str:
        """Write a file of arguments, as rosidl's own CMake functions do."""
        names = [path.relative_to(self.code).as_posix() for path in idl]
        templates = next(self._shared(generator)) / "resource"
        output = self.code
        if "introspection" in generator:
            output = self.described
        file = self.work / f"{generator}.json"
        settings = {
            "package_name": self.name,
            "idl_tuples": [f"{self.code}:{name}" for name in names],
            "ros_interface_dependencies": [],
            "target_dependencies": [],
            "output_dir": str(output),
            "template_dir": str(templates),
            **more,
        }
        file.write_text(json.dumps(settings))
        for control in templates.glob("*__visibility_control.h.in"):
            self._write_header(control, output / "msg")
        return str(file)

    def _write_header(self, template: Path, folder: Path) -> None:
        text = template.read_text()
        text = text.replace("@PROJECT_NAME_UPPER@", self.name.upper())
        text = text.replace("@PROJECT_NAME@", self.name)
        folder.mkdir(parents=True, exist_ok=True)
        header = folder / template.name.removesuffix(".in")
        header.write_text(text)

    def _include_paths(self) -> list[str]:
        """Return the share folders of all packages as rosidl's arguments; the first prefix wins."""
        shares: dict[str, Path] = {}
        for prefix in reversed(self.prefixes):
            folder = prefix / "share"
            shares |= {share.name: share for share in folder.iterdir()}
        return [f"{name}:{share}" for name, share in shares.items()]

    def _generate(self, idl: Sequence[Path]) -> None:
        hashes = self._arguments(
            "rosidl_generator_type_description", idl, include_paths=self._include_paths()
        )
        rosidl_generator_type_description.generate_type_hash(hashes)
        tuples = []
        for path in idl:
            name = path.relative_to(self.code).as_posix()
            json_file = path.with_suffix(".json")
            tuples.append(f"{name}:{json_file}")

        def arguments(generator: str) -> str:
            return self._arguments(generator, idl, type_description_tuples=tuples)

        rosidl_generator_c.generate_c(arguments("rosidl_generator_c"))
        fast, describing = map(arguments, _SUPPORTS)
        rosidl_typesupport_fastrtps_c.generate_typesupport_fastrtps_c(fast)
        rosidl_typesupport_introspection_c.generate_c(describing)
        dispatching = arguments("rosidl_typesupport_c")
        rosidl_typesupport_c.generate_c(dispatching, list(_SUPPORTS))
        python = arguments("rosidl_generator_py")
        rosidl_generator_py.generate_py(python, ["rosidl_typesupport_c"])
        (self.code / "__init__.py").touch()

    # -- compiling ----------------------------------------------------------------------------

    def _compile(self) -> None:
        home = Path(sys.prefix)
        search = self._search_flags()
        entry = self.code / f"_{self.name}_s.ep.rosidl_typesupport_c.c"
        sources = [path for path in sorted(self.work.rglob("*.c*")) if path.suffix in _COMPILERS]
        sources.remove(entry)

        def compiled(source: Path) -> str:
            output = str(source.with_suffix(f"{source.suffix}.o"))
            compiler = _COMPILERS[source.suffix]
            _run([*compiler, *_FLAGS, *search, "-c", str(source), "-o", output])
            return output

        cores = len(os.sched_getaffinity(0))
        with ThreadPoolExecutor(cores) as threads:
            *objects, entry_object = threads.map(compiled, [*sources, entry])
        library = self.target / "lib" / f"lib{self.name}__interfaces.so"
        module = self._python / f"{self.name}_s__rosidl_typesupport_c.so"
        library.parent.mkdir(parents=True)
        self._python.mkdir(parents=True)
        libraries = self._libraries(home)
        _link([*objects, *libraries], library, "$ORIGIN")
        # One library has all code. Each library found by its name is loaded already, and leads there.
        names = [library.with_name(f"lib{self.name}__{support}.so") for support in _SUPPORTS]
        for name in names:
            _link([str(library)], name, "$ORIGIN")
        linked = [library, *names]
        _link([entry_object, *map(str, linked)], module, "$ORIGIN/../../..")

    def _search_flags(self) -> list[str]:
        headers = [self.work, self.described.parent]
        headers.append(Path(sysconfig.get_path("include")))
        headers.append(Path(numpy.get_include()))
        for prefix in self.prefixes:
            folder = prefix / "include"
            headers.append(folder)
            headers.extend(folder.glob("*"))
        return [f"-I{folder}" for folder in headers]

    def _libraries(self, home: Path) -> Iterator[str]:
        """Yield linker arguments for the used packages, valid wherever the sibling prefixes are moved."""
        used = set(_IMPLIED)
        for message in self.messages.values():
            used.update(field.type.pkg_name for field in message.fields)
        used -= {None, self.name}
        yield f"-L{home}/lib"
        for library in _RUNTIME:
            yield f"-l{library}"
        for package in sorted(used):
            own = self._prefix_of_built(package)
            if own is not None:
                yield f"-L{own}/lib"
                yield f"-l{package}__interfaces"
                yield f"-Wl,-rpath,$ORIGIN/../../{own.name}/lib"
            else:
                yield from (f"-l{package}__{part}" for part in _PARTS)

    def _prefix_of_built(self, package: str) -> Path | None:
        """Return the prefix of a package built by this program; None for an installed one."""
        for prefix in self.prefixes:
            library = prefix / "lib" / f"lib{package}__interfaces.so"
            if library.is_file():
                return prefix
        return None

    # -- installing ---------------------------------------------------------------------------

    @property
    def _python(self) -> Path:
        version = f"python{sys.version_info.major}.{sys.version_info.minor}"
        return self.target / "lib" / version / "site-packages" / self.name

    def _install(self) -> None:
        index = self.target / "share/ament_index/resource_index"
        _copy(self.code.rglob("*.py"), self.code, self._python)
        for made in (self.code, self.described):
            _copy(made.rglob("*.h"), made, self.target / "include" / self.name / self.name)
        share = self.target / "share" / self.name
        for suffix in ("idl", "json"):
            _copy(self.code.rglob(f"*.{suffix}"), self.code, share)
        _copy([self.source / file for file in self.files], self.source, share)
        interfaces = "\n".join(map(str, self.files))
        for kind, text in (("packages", ""), ("rosidl_interfaces", interfaces)):
            resources = index / kind
            resources.mkdir(parents=True)
            entry = resources / self.name
            entry.write_text(text)


def _messages_of(spec: Any, kind: str) -> list[Any]:
    """Return the messages of a definition: itself, or the parts of a service or an action."""
    if kind not in _MESSAGES:
        return [spec]
    return [getattr(spec, part) for part in _MESSAGES[kind]]


def _texts_of(part: Any) -> list[str]:
    """Return the texts in a field's default value, or in a constant's value."""
    if isinstance(part, parser.Field):
        value = getattr(part, "default_value", None)
    else:
        value = part.value
    values = value if isinstance(value, list) else [value]
    return [text for text in values if isinstance(text, str)]


def _element_size(kind: str) -> int:
    """Return the bytes of a primitive type, e.g. 8 for "float64"."""
    if kind in _BYTES:
        return _BYTES[kind]
    bits = "".join(filter(str.isdigit, kind))
    return int(bits) // 8


def _copy(paths: Iterable[Path], above: Path, target: Path) -> None:
    for path in paths:
        copied = target / path.relative_to(above)
        copied.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copied)


def _link(objects: Sequence[str], output: Path, run_path: str) -> None:
    names = [f"-Wl,-soname,{output.name}", f"-Wl,-rpath,{run_path}", "-Wl,--no-as-needed"]
    _run(["c++", "-shared", *names, *objects, "-o", str(output)])


def _run(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode != 0:
        complaint = done.stderr.strip() or f"status {done.returncode}"
        lines = complaint.splitlines()
        reason = next((line for line in lines if "error" in line), lines[-1])
        raise Refused(f"its generated code could not be compiled: {reason[-300:]}", invalid=False)


def _too_long(*_: object) -> None:
    raise Refused("its definitions took too long to read", invalid=False)


def main() -> None:
    """Build the package named by the arguments, and print the outcome."""
    source, target, *prefixes = map(Path, sys.argv[1:])
    signal.signal(signal.SIGALRM, _too_long)
    try:
        if importlib.util.find_spec(source.name) is not None:
            problem = f"there is an installed package {source.name}, which counts"
            raise Refused(problem, invalid=False)
        package = Package(source, target, [*prefixes, Path(sys.prefix)])
        package.build()
        answer: dict[str, Any] = {}
    except Refused as refused:
        answer = {"problem": str(refused), "invalid": refused.invalid}
    sys.__stdout__.write(json.dumps(answer) + "\n")


if __name__ == "__main__":
    with Path(os.devnull).open("w") as sys.stdout:  # rosidl tells of each file that it writes
        main()
