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
        self.name, self.source, self.target, self.prefixes = source.name, source, target, prefixes
        self.work = target.with_name(f"{target.name}.work")
        # Two generators write files of the same names.
        self.code, self.described = self.work / self.name, self.work / "introspection" / self.name
        self.files = sorted(path.relative_to(source) for path in source.glob("*/*.*"))
        self.messages: dict[str, Any] = {}

    def build(self) -> None:
        """Make the prefix."""
        signal.alarm(_READING_S)
        idl = [self._translate(file) for file in self.files]
        for name in self.messages:
            if (size := self._size(self.name, name)) > _MOST_BYTES:
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
        read = {"msg": parser.parse_message_string, "srv": parser.parse_service_string}.get(
            kind, parser.parse_action_string
        )
        try:
            spec = read(self.name, file.stem, (self.source / file).read_text(encoding="utf-8"))
        except Exception as problem:
            raise Refused(
                f"{file}: {' '.join(str(problem).split())[:300]}", invalid=True
            ) from problem
        parts = {"srv": ("request", "response"), "action": ("goal", "result", "feedback")}.get(
            kind, ()
        )
        for message in [getattr(spec, part) for part in parts] or [spec]:
            self.messages[message.msg_name] = message
            self._clean(file, message)
        output = (self.code / file).with_suffix(".idl")
        output.parent.mkdir(parents=True, exist_ok=True)
        data = {"pkg_name": self.name, "relative_input_file": file.as_posix(), kind: spec}
        resource.expand_template(f"{kind}.idl.em", data, output, encoding="utf-8")
        return output

    def _clean(self, file: Path, message: Any) -> None:
        message.annotations = {}
        for part in (*message.constants, *message.fields):
            part.annotations = {}
            value = (
                getattr(part, "default_value", None)
                if isinstance(part, parser.Field)
                else part.value
            )
            texts = [
                text
                for text in (value if isinstance(value, list) else [value])
                if isinstance(text, str)
            ]
            if not all(map(_PLAIN.fullmatch, texts)):
                text = f"{file}: the value of {part.name} has characters that the grader does not pass on"
                raise Refused(text, invalid=False)
        for field in message.fields:
            self._require(file, field.type)

    def _require(self, file: Path, kind: Any) -> None:
        """See to it that a field's type is there."""
        if kind.is_primitive_type():
            return
        if kind.pkg_name == self.name:
            if Path("msg", f"{kind.type}.msg") not in self.files:
                raise Refused(f"{file}: there is no {kind.type}.msg in {self.name}", invalid=True)
        elif not any(self._shared(kind.pkg_name)):
            raise Refused(
                f"{file}: {kind.pkg_name} is not installed where it was graded", invalid=False
            )
        elif not any(
            (share / "msg" / f"{kind.type}.msg").is_file() for share in self._shared(kind.pkg_name)
        ):
            raise Refused(f"{file}: {kind.pkg_name} has no message {kind.type}", invalid=True)

    def _shared(self, package: str) -> Iterator[Path]:
        shares = (prefix / "share" / package for prefix in self.prefixes)
        return (share for share in shares if share.is_dir())

    def _size(self, package: str, name: str, depth: int = 0) -> int:
        """Return the largest size of a message in bytes, with each unbounded part counted once."""
        if depth > _MOST_DEPTH:
            raise Refused(f"{name} holds itself", invalid=True)
        return sum(
            self._field_size(field.type, depth) for field in self._message(package, name).fields
        )

    def _message(self, package: str, name: str) -> Any:
        if package == self.name:
            return self.messages[name]
        file = next(
            file
            for share in self._shared(package)
            if (file := share / "msg" / f"{name}.msg").is_file()
        )
        return parser.parse_message_string(package, name, file.read_text(encoding="utf-8"))

    def _field_size(self, kind: Any, depth: int) -> int:
        if not kind.is_primitive_type():
            return self._size(kind.pkg_name, kind.type, depth + 1) * (kind.array_size or 1)
        bits = "".join(filter(str.isdigit, kind.type))  # of "float64"
        one = _BYTES.get(kind.type) or int(bits) // 8
        return one * (kind.string_upper_bound or 1) * (kind.array_size or 1)

    # -- generating ---------------------------------------------------------------------------

    def _arguments(self, generator: str, idl: Sequence[Path], **more: Any) -> str:
        """Write a file of arguments, as rosidl's own CMake functions do."""
        names = [path.relative_to(self.code).as_posix() for path in idl]
        templates = next(self._shared(generator)) / "resource"
        output = self.described if "introspection" in generator else self.code
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
            text = control.read_text().replace("@PROJECT_NAME_UPPER@", self.name.upper())
            header = output / "msg" / control.name.removesuffix(".in")
            header.parent.mkdir(parents=True, exist_ok=True)
            header.write_text(text.replace("@PROJECT_NAME@", self.name))
        return str(file)

    def _generate(self, idl: Sequence[Path]) -> None:
        shares = {
            share.name: share
            for prefix in reversed(self.prefixes)
            for share in (prefix / "share").iterdir()
        }
        hashes = self._arguments(
            "rosidl_generator_type_description",
            idl,
            include_paths=[f"{name}:{share}" for name, share in shares.items()],
        )
        rosidl_generator_type_description.generate_type_hash(hashes)
        described = {p.relative_to(self.code).as_posix(): str(p.with_suffix(".json")) for p in idl}
        tuples = [f"{name}:{json_file}" for name, json_file in described.items()]

        def arguments(generator: str) -> str:
            return self._arguments(generator, idl, type_description_tuples=tuples)

        rosidl_generator_c.generate_c(arguments("rosidl_generator_c"))
        fast, describing = map(arguments, _SUPPORTS)
        rosidl_typesupport_fastrtps_c.generate_typesupport_fastrtps_c(fast)
        rosidl_typesupport_introspection_c.generate_c(describing)
        rosidl_typesupport_c.generate_c(arguments("rosidl_typesupport_c"), list(_SUPPORTS))
        rosidl_generator_py.generate_py(arguments("rosidl_generator_py"), ["rosidl_typesupport_c"])
        (self.code / "__init__.py").touch()

    # -- compiling ----------------------------------------------------------------------------

    def _compile(self) -> None:
        home = Path(sys.prefix)
        headers = [
            self.work,
            self.described.parent,
            Path(sysconfig.get_path("include")),
            Path(numpy.get_include()),
        ]
        for prefix in self.prefixes:
            headers += [prefix / "include", *(prefix / "include").glob("*")]
        search = [f"-I{folder}" for folder in headers]
        entry = self.code / f"_{self.name}_s.ep.rosidl_typesupport_c.c"
        sources = [
            path
            for path in sorted(self.work.rglob("*.c*"))
            if path.suffix in (".c", ".cpp") and path != entry
        ]

        def compiled(source: Path) -> str:
            output = str(source.with_suffix(f"{source.suffix}.o"))
            standard = ("cc", "-std=gnu11") if source.suffix == ".c" else ("c++", "-std=gnu++17")
            _run([*standard, *_FLAGS, *search, "-c", str(source), "-o", output])
            return output

        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as threads:
            objects = list(threads.map(compiled, [*sources, entry]))
        library = self.target / "lib" / f"lib{self.name}__interfaces.so"
        module = self._python / f"{self.name}_s__rosidl_typesupport_c.so"
        library.parent.mkdir(parents=True)
        self._python.mkdir(parents=True)
        _link([*objects[:-1], *self._libraries(home)], library, "$ORIGIN")
        # One library has all code. Each library found by its name is loaded already, and leads there.
        names = [library.with_name(f"lib{self.name}__{support}.so") for support in _SUPPORTS]
        for name in names:
            _link([str(library)], name, "$ORIGIN")
        _link([objects[-1], str(library), *map(str, names)], module, "$ORIGIN/../../..")

    def _libraries(self, home: Path) -> Iterator[str]:
        """Yield linker arguments for the used packages, valid wherever the sibling prefixes are moved."""
        used = {
            field.type.pkg_name for message in self.messages.values() for field in message.fields
        }
        yield from (
            f"-L{home}/lib",
            "-lrosidl_runtime_c",
            "-lrosidl_typesupport_fastrtps_c",
            "-lfastcdr",
            "-lrcutils",
        )
        yield from ("-lrosidl_typesupport_fastrtps_cpp", "-lrmw", "-lrosidl_typesupport_c")
        yield "-lrosidl_typesupport_introspection_c"
        for package in sorted({*used, *_IMPLIED} - {None, self.name}):
            own = next(
                (
                    p
                    for p in self.prefixes
                    if (p / "lib" / f"lib{package}__interfaces.so").is_file()
                ),
                None,
            )
            if own is not None:
                yield f"-L{own}/lib"
                yield f"-l{package}__interfaces"
                yield f"-Wl,-rpath,$ORIGIN/../../{own.name}/lib"
            else:
                yield from (f"-l{package}__{part}" for part in _PARTS)

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
        for kind, text in {
            "packages": "",
            "rosidl_interfaces": "\n".join(map(str, self.files)),
        }.items():
            (index / kind).mkdir(parents=True)
            (index / kind / self.name).write_text(text)


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
        lines = (done.stderr.strip() or f"status {done.returncode}").splitlines()
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
            raise Refused(
                f"there is an installed package {source.name}, which counts", invalid=False
            )
        Package(source, target, [*prefixes, Path(sys.prefix)]).build()
        answer: dict[str, Any] = {}
    except Refused as refused:
        answer = {"problem": str(refused), "invalid": refused.invalid}
    sys.__stdout__.write(json.dumps(answer) + "\n")


if __name__ == "__main__":
    with Path(os.devnull).open("w") as sys.stdout:  # rosidl tells of each file that it writes
        main()
