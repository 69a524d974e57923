"""Logging of launch files, and the words that `output` may be."""

from __future__ import annotations

import logging
from logging import DEBUG, ERROR, INFO, WARNING, Logger
from typing import Any

from launch_plan.inside.problems import mistake

_OUTPUT_WORDS = ("screen", "log", "both", "own_log", "full")
_STREAM_WORDS = ("screen", "log", "own_log")


class LaunchConfig:
    """How a launch logs; nothing depends on it here."""

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
    """Loggers of a process, if it is known where its output is to go."""
    if isinstance(output_config, str):
        if output_config not in _OUTPUT_WORDS:
            raise _unknown(
                f"output must be one of {', '.join(_OUTPUT_WORDS)}, but it is '{output_config}'"
            )
        output_config = {}
    for stream, words in dict(output_config).items():
        if stream not in ("stdout", "stderr", "both"):
            raise _unknown(f"output can be set for stdout, stderr or both, but not for '{stream}'")
        if not set([words] if isinstance(words, str) else words) <= set(_STREAM_WORDS):
            raise _unknown(
                f"the output of {stream} must be among {', '.join(_STREAM_WORDS)}, but it is {words!r}"
            )
    return get_logger(f"{process_name}-stdout"), get_logger(f"{process_name}-stderr")


def _unknown(message: str) -> Any:
    return mistake(ValueError, message, "bad_output", "Write output='screen'.")
