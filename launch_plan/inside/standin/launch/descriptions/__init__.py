"""Descriptions of programs."""

from __future__ import annotations

import os
import re
import shlex
from typing import Any

from .._base import Field, Located, Pairs, Text, Texts, perform_substitutions
from ..substitutions import LaunchConfiguration


class Executable(Located):
    """A command line with its working folder and environment."""

    cmd = Texts()
    prefix = Text(None)
    name = Text(None)
    cwd = Text(None)
    env = Pairs(None)
    additional_env = Pairs(None)
    arguments = Field(None)

    final_name: str | None = None
    final_cmd: list[str] | None = None
    final_cwd: str | None = None
    final_env: dict[str, str] | None = None

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__letters = isinstance(kwargs["cmd"], str)
        if self.arguments is not None:
            self.cmd.extend(type(self).cmd.normal(self.arguments))

    def _prefix(self, context: Any, program: str) -> list[str]:
        if self.prefix is not None:
            return shlex.split(perform_substitutions(context, self.prefix))
        wanted = LaunchConfiguration("launch-prefix-filter", default="").perform(context)
        found = LaunchConfiguration("launch-prefix", default="").perform(context)
        return shlex.split(found) if re.match(wanted, program) else []

    def prepare(self, context: Any, action: Any) -> None:
        """Resolve the command line, the name, the working folder and the environment."""
        command = [perform_substitutions(context, item) for item in self.cmd]
        program = os.path.basename(command[0])  # noqa: PTH119 - as the process is named, trailing slash and all
        self.final_cmd = self._prefix(context, program) + command
        name = os.path.basename(self.final_cmd[0])  # noqa: PTH119
        if self.name is not None:
            name = perform_substitutions(context, self.name)
        self.final_name = f"{name}-{next(context.process_numbers)}"
        if self.cwd is not None:
            self.final_cwd = perform_substitutions(context, self.cwd)
        self.final_env = self._environment(context)
        if self.__letters:
            message = "cmd is one text, of which each letter becomes a word: "
            context.session.warn(f"{message}cmd=['program', 'argument']", action)

    def _environment(self, context: Any) -> dict[str, str]:
        env = dict(context.environment) if self.env is None else {}
        for key, value in (self.env or []) + (self.additional_env or []):
            name = perform_substitutions(context, key)
            env[name] = perform_substitutions(context, value)
        return env
