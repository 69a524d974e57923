"""Logging of launch files, and the values of `output`."""

from __future__ import annotations

import logging
from logging import DEBUG, ERROR, INFO, WARNING, Logger
from typing import Any

from launch_plan.inside.problems import mistake

_OUTPUT_WORDS = ("screen", "log", "both", "own_log", "full")
_STREAM_WORDS = ("screen", "log", "own_log")


class LaunchConfig:
    """Settings of the log, without effect here."""

    def __init__(self) -> None:
        self.level = INFO
        self.log_dir: str | None = None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda *args, **kwargs: None


launch_config = LaunchConfig()


def get_logger(name: str | None = None) -> Logger:
    return logging.getLogger(name)


def get_output_loggers(process_name: str, output_config: Any) -> tuple[Logger, Logger]:
    """Return the loggers of a process; refuse an unknown destination of its output."""
    if isinstance(output_config, str):
        _require_known(output_config)
        output_config = {}
    for stream, words in dict(output_config).items():
        if stream not in ("stdout", "stderr", "both"):
            raise _unknown(f"output can be set for stdout, stderr or both, but not for '{stream}'")
        listed = [words] if isinstance(words, str) else words
        if not set(listed) <= set(_STREAM_WORDS):
            known = ", ".join(_STREAM_WORDS)
            raise _unknown(f"the output of {stream} must be among {known}, but it is {words!r}")
    return get_logger(f"{process_name}-stdout"), get_logger(f"{process_name}-stderr")


def _require_known(word: str) -> None:
    if word not in _OUTPUT_WORDS:
        raise _unknown(f"output must be one of {', '.join(_OUTPUT_WORDS)}, but it is '{word}'")


def _unknown(message: str) -> Any:
    return mistake(ValueError, message, "bad_output", "Write output='screen'.")
