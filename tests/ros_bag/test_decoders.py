"""Messages are decoded as by the store of `rosbags`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ros_bag.decoders import ReadingStore
from ros_bag.definitions import SEPARATOR

NAME = "arm_msgs/msg/Scan"
TEXT = (
    "Joint first\nJoint[] joints\nJoint[2] two\nstring[] names\nbool[3] flags\nfloat64[] values\n"
    f"uint8[<=4] few\nint16 last\n{SEPARATOR}\nMSG: arm_msgs/Joint\nstring name\nfloat64 angle\nbyte kind\n"
)


def theirs_and_ours() -> tuple[Any, Any]:
    """Return a store of `rosbags` and ours, both with the same types."""
    types = get_types_from_msg(TEXT, NAME)
    theirs = get_typestore(Stores.EMPTY)
    theirs.register(types)
    ours = ReadingStore()
    ours.register(types)
    return theirs, ours


def message(store: Any) -> Any:
    """Return a message with a value in each field."""
    joint = store.types["arm_msgs/msg/Joint"]
    joints = [joint("elbow", 1.5, 1), joint("wrist", -0.25, 2)]
    return store.types[NAME](
        first=joint("", 0.0, 0),
        joints=joints * 2,
        two=joints,
        names=["a", "\N{LATIN SMALL LETTER E WITH ACUTE}"],
        flags=np.array([True, False, True]),
        values=np.array([1.0, 2.0]),
        few=np.array([7], np.uint8),
        last=-3,
    )


@pytest.mark.parametrize("little_endian", [True, False])
def test_both_decode_alike(little_endian: bool) -> None:
    """Nested messages, arrays, texts and both orders of bytes give the same values."""
    theirs, ours = theirs_and_ours()
    data = bytes(theirs.serialize_cdr(message(theirs), NAME, little_endian=little_endian))
    assert repr(ours.deserialize_cdr(data, NAME)) == repr(theirs.deserialize_cdr(data, NAME))


def test_both_refuse_alike() -> None:
    """A message cut anywhere has the same fault."""
    theirs, ours = theirs_and_ours()
    data = bytes(theirs.serialize_cdr(message(theirs), NAME))
    for length in range(len(data)):
        told = []
        for store in (theirs, ours):
            try:
                told.append(repr(store.deserialize_cdr(data[:length], NAME)))
            except Exception as error:
                told.append(repr(error))
        assert told[0] == told[1]


@pytest.mark.parametrize("field", ["wstring text", "wstring[] texts", "wstring[2] two"])
def test_wide_strings_have_no_decoder(field: str) -> None:
    """The store of `rosbags` fails for these types, too."""
    for store in (get_typestore(Stores.EMPTY), ReadingStore()):
        store.register(get_types_from_msg(field, NAME))
        with pytest.raises(KeyError):
            store.get_msgdef(NAME)
