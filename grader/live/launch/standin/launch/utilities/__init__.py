"""Checks and conversions that actions share."""

from __future__ import annotations

import collections.abc
from typing import Any

from .._base import (
    LaunchDescriptionEntity,
    ensure_argument_type,
    is_a_subclass,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)


def normalize_to_list_of_entities(entities: Any) -> list[Any]:
    """Flatten entities and lists of them into one list."""
    if isinstance(entities, LaunchDescriptionEntity) or not isinstance(entities, collections.abc.Iterable):
        return [entities]
    flat: list[Any] = []
    for entity in entities:
        flat.extend(normalize_to_list_of_entities(entity))
    return flat
