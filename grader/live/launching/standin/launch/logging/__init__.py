"""Logging of launch files, and the words that `output` may be."""

from __future__ import annotations

import logging
from logging import DEBUG, ERROR, INFO, WARNING, Logger
from typing import Any

from .._catalogue import missing_name

__all__ = ["DEBUG", "ERROR", "INFO", "WARNING", "get_logger", "get_output_loggers", "launch_config"]

OUTPUT_WORDS = ("screen", "log", "both", "own_log", "full")
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
    """A logger of Python's own."""
    return logging.getLogger(name)


def get_output_loggers(process_name: str, output_config: Any) -> Any:
    """Check where the output of a process is to go, and return that.

    Raises
    ------
    ValueError
        It is not one of the known words.
    """
    if isinstance(output_config, str):
        if output_config not in OUTPUT_WORDS:
            raise ValueError(f"output must be one of {', '.join(OUTPUT_WORDS)}, but it is '{output_config}'")
        return output_config
    plain: dict[str, Any] = {}
    for stream, words in dict(output_config).items():
        if stream not in ("stdout", "stderr", "both"):
            raise ValueError(f"output can be set for stdout, stderr or both, but not for '{stream}'")
        chosen = [words] if isinstance(words, str) else sorted(words)
        if any(word not in _STREAM_WORDS for word in chosen):
            raise ValueError(f"the output of {stream} must be among {', '.join(_STREAM_WORDS)}, but it is {words!r}")
        plain[stream] = chosen
    return plain


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)
