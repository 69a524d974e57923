"""What would run on a student's machine and does not here: libraries that are missing, and newer syntax.

That is no mistake of the student's as long as the lab does not forbid it, and for a person to decide.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from grader.evidence.diagnosis import Diagnosis
from grader.evidence.syntax import expression_tree, normalise, tree_of

#: Libraries that students know from courses and tutorials, and those of a desktop installation of ROS 2. A name that is
#: none of these is more likely a file of their own that was not handed in, or a misspelling.
_LIBRARY_NAMES = (
    "matplotlib scipy pandas seaborn plotly sklearn sympy numba cv2 PIL skimage imageio torch tensorflow jax casadi",
    "transforms3d pyquaternion quaternion tabulate prettytable rich colorama termcolor tqdm loguru psutil pydantic",
    "attr attrs click typer requests serial pynput keyboard pygame h5py openpyxl xlsxwriter yaml toml tomli dotenv",
    "control roboticstoolbox spatialmath pinocchio ikpy mujoco pybullet gymnasium gym statsmodels networkx uvloop",
    "message_filters tf2_ros tf2_py tf2_geometry_msgs tf2_msgs tf_transformations cv_bridge image_geometry",
    "sensor_msgs_py rosbag2_py ros2topic ros2param ros2service ros2node ros2cli ros2run ros2launch launch",
    "launch_ros launch_testing rqt_gui qt_gui python_qt_binding ament_index_python rcl_interfaces",
    "example_interfaces action_tutorials_interfaces control_msgs moveit_msgs nav2_msgs visualization_msgs",
    "urdf_parser_py xacro diagnostic_updater laser_geometry gazebo_msgs ros_gz_interfaces turtlesim pcl_msgs",
    "map_msgs shape_msgs trajectory_msgs object_recognition_msgs octomap_msgs rmw_dds_common test_msgs",
    "controller_manager_msgs",
)
_LIBRARIES = frozenset(name for line in _LIBRARY_NAMES for name in line.split())
_LAST_WORD = "A person has to decide."


def only_elsewhere(found: Diagnosis | None, texts: Mapping[str, str]) -> str | None:
    """Say why a program that ended with this diagnosis may run elsewhere; None if it would not.

    Parameters
    ----------
    texts : mapping
        Texts of the submission, by path.
    """
    if found is None:
        return None
    if found.kind in ("missing-module", "missing-interface") and found.subject.split(".")[0] in _LIBRARIES:
        library = found.subject.split(".")[0]
        return f"It needs {library}, which is not installed where it was graded. {_LAST_WORD}"
    if found.kind != "syntax-error" or not is_newer_python(texts.get(found.file or "", "")):
        return None
    place = f" (line {found.line})" if found.line else ""
    return (
        f"{found.file}{place} is written in Python 3.12 or later, and was run with an older one, which cannot read it. "
        f"{_LAST_WORD}"
    )


_TYPE_ALIAS = re.compile(r"^([ \t]*)type[ \t]+(\w+)[ \t]*(?:\[[^\]\n]*\])?[ \t]*=", re.MULTILINE)
_TYPE_PARAMETERS = re.compile(r"^([ \t]*(?:async[ \t]+)?(?:def|class)[ \t]+\w+)[ \t]*\[[^\]\n]*\]", re.MULTILINE)
_F_STRING = re.compile(r"(?<!\w)(?:[fF][rR]?|[rR][fF])(\"\"\"|'''|\"|')")
_MOST_STRINGS = 2000


def is_newer_python(text: str) -> bool:
    """Whether a text is right by the syntax of Python 3.12, and not by an older one's.

    Type aliases, type parameters, and f-strings that hold their own quotation marks are written as before 3.12;
    what is then right was right.
    """
    text = normalise(text)
    older = _TYPE_PARAMETERS.sub(r"\1", _TYPE_ALIAS.sub(r"\1\2 =", text))
    older = _without_inner_quotes(older)
    return older != text and tree_of(older)[0] is not None


def _without_inner_quotes(text: str) -> str:
    """Return a text in which a bare name stands in those fields of f-strings that are expressions of the newer kind."""
    pieces: list[str] = []
    at = 0
    for _ in range(_MOST_STRINGS):
        match = _F_STRING.search(text, at)
        if match is None:
            break
        end, replaced = _f_string(text, match.end(), match[1])
        pieces += [text[at : match.end()], replaced]
        at = end
    return "".join(pieces) + text[at:]


def _f_string(text: str, start: int, quotes: str) -> tuple[int, str]:
    """Return the place behind an f-string, and its contents with a name in each field."""
    contents: list[str] = []
    at = start
    while at < len(text) and not text.startswith(quotes, at):
        if text[at] == "\n" and len(quotes) == 1:
            break  # It is not closed: leave it to Python to say so.
        if text.startswith(("{{", "}}", "\\"), at):
            contents.append(text[at : at + 2])
            at += 2
        elif text[at] == "{":
            end = _field_end(text, at + 1)
            field = text[at + 1 : end - 1]
            newer = any(sign in field for sign in (quotes, "\n" if len(quotes) == 1 else quotes, "\\"))
            contents.append("{_}" if newer and _is_expression(field) else text[at:end])
            at = end
        else:
            contents.append(text[at])
            at += 1
    closed = text.startswith(quotes, at)
    return at + len(quotes) * closed, "".join(contents) + quotes * closed


def _field_end(text: str, start: int) -> int:
    """Return the place behind the brace that closes a field."""
    depth, at = 1, start
    while at < len(text):
        letter = text[at]
        if letter in "\"'":
            end = text.find(letter, at + 1)
            at = end if end >= 0 and "\n" not in text[at:end] else at
        depth += {"{": 1, "[": 1, "(": 1, "}": -1, "]": -1, ")": -1}.get(letter, 0)
        at += 1
        if not depth:
            break
    return at


_CONVERSION = re.compile(r"(?<![!=<>])=?\s*(?:![rsa])?(?::(?!=).*)?$", re.DOTALL)


def _is_expression(field: str) -> bool:
    """Whether the contents of a field are an expression, with what says how to show it or without."""
    if len(field) > _LONGEST_FIELD:
        return False
    for text in dict.fromkeys((field, _CONVERSION.sub("", field), field.rpartition(":")[0])):
        if text.strip() and expression_tree(f"({_without_inner_quotes(text)})") is not None:
            return True
    return False


_LONGEST_FIELD = 500
