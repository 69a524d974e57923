"""Frames of a compiled program that crashes: settings of the library that names them, and a careful reader of its text.

The text is two lines a frame, the innermost first, for example:

    Crash (innermost frame first):
    Talker::on_timer()
    /ws/src/arm/src/talker.cpp:12 (discriminator 2)
    main
    /ws/src/arm/src/talker.cpp:31
    End of crash

Any code in the process can write to its pipe; the reader therefore bounds all that it keeps.
"""

from __future__ import annotations

import re
from pathlib import Path

from grader.recording.session import StackFrame

#: Name of the library in the folder that a sandbox sees.
LIBRARY = "crash_tap.so"
SOURCE = Path(__file__).parent / "compiled/crash_tap.c"
_BEGIN = "Crash (innermost frame first):\n"
_PLACE = re.compile(r"(/.{1,520}):(\d{1,7})(?: \(discriminator \d+\))?")
_MOST_FRAMES = 60
_LONGEST_NAME = 300


def crash_variables(folder: str, below: str) -> dict[str, str]:
    """Return the variables with which a program loads the library.

    Parameters
    ----------
    folder
        Folder of the library.
    below
        Folder with the student's programs and libraries; only their frames are named.
    """
    return {
        "LD_PRELOAD": f"{folder}/{LIBRARY}",
        "GRADER_CRASH_BELOW": f"{below}/",
        # A program with the address sanitizer refuses to start with another library before the sanitizer's.
        "ASAN_OPTIONS": "verify_asan_link_order=0",
    }


def frames_in(text: str, above: str) -> list[StackFrame]:
    """Read the frames of a crash in the text of a program's tap, and drop `above` from paths."""
    _, _, crash = text.partition(_BEGIN)
    lines = crash.split("\n")
    functions = lines[::2]
    places = lines[1::2]
    frames = []
    for function, place in zip(functions[:_MOST_FRAMES], places, strict=False):
        found = _PLACE.fullmatch(place)
        if found is None:
            continue
        file = found[1].removeprefix(above)
        line = int(found[2])
        frames.append(StackFrame(file[:_LONGEST_NAME], line, function[:_LONGEST_NAME]))
    return frames
