"""Descriptions of what is to be executed."""

from __future__ import annotations

import os
import re
import shlex
from typing import Any

from .._base import Located, Substitution, normalize_to_list_of_substitutions, perform_substitutions
from .._catalogue import missing_name
from ..substitutions import LaunchConfiguration

__all__ = ["Executable"]


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)


def _pairs(given: Any) -> list[tuple[list[Substitution], list[Substitution]]] | None:
    if given is None:
        return None
    normal = normalize_to_list_of_substitutions
    return [(normal(name), normal(value)) for name, value in given.items()]


class Executable(Located):
    """A command line with its working folder and environment."""

    def __init__(
        self,
        *,
        cmd: Any,
        prefix: Any = None,
        name: Any = None,
        cwd: Any = None,
        env: Any = None,
        additional_env: Any = None,
        arguments: Any = None,
    ) -> None:
        normal = normalize_to_list_of_substitutions
        self.__letters = isinstance(cmd, str)
        self.cmd = [normal(item) for item in cmd] + [normal(item) for item in arguments or []]
        self.prefix = normal(LaunchConfiguration("launch-prefix", default="") if prefix is None else prefix)
        self.__filter = normal(LaunchConfiguration("launch-prefix-filter", default="")) if prefix is None else None
        self.name = None if name is None else normal(name)
        self.cwd = None if cwd is None else normal(cwd)
        self.env = _pairs(env)
        self.additional_env = _pairs(additional_env)
        self.arguments = arguments
        self.final_name: str | None = None
        self.final_cmd: list[str] | None = None
        self.final_prefix: list[str] = []
        self.final_cwd: str | None = None
        self.final_env: dict[str, str] | None = None

    def prepare(self, context: Any, action: Any) -> None:
        """Resolve everything."""
        command = [perform_substitutions(context, item) for item in self.cmd]
        program = os.path.basename(command[0])  # noqa: PTH119 - as the process is named, trailing slash and all
        wanted = self.__filter is None or re.match(perform_substitutions(context, self.__filter), program)
        self.final_prefix = shlex.split(perform_substitutions(context, self.prefix)) if wanted else []
        self.final_cmd = self.final_prefix + command
        first = os.path.basename(self.final_cmd[0])  # noqa: PTH119
        name = first if self.name is None else perform_substitutions(context, self.name)
        self.final_name = context.session.number_process(name)
        self.final_cwd = None if self.cwd is None else perform_substitutions(context, self.cwd)
        env = dict(context.environment) if self.env is None else {}
        for key, value in (self.env or []) + (self.additional_env or []):
            env[perform_substitutions(context, key)] = perform_substitutions(context, value)
        self.final_env = env
        if self.__letters:
            message = "cmd is one text, of which each letter becomes a word: cmd=['program', 'argument']"
            context.session.warn(message, action.source_line)
        context.session.warn_of_objects([*self.final_cmd, *env.values()], action.source_line)
