"""Checks and conversions that actions share."""

from __future__ import annotations

from .._base import (
    ensure_argument_type,
    is_a_subclass,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
