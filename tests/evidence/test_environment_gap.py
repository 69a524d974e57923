"""Programs that run on a student's machine and not on the grader's."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest

from grader.evidence.crash.causes import Diagnosis
from grader.evidence.environment_gap import environment_gap, for_teachers, modules_to_look_for
from grader.recording.submission import PackageFact
from tests.synthetic import submission

NEWER, BROKEN = "type Wave = tuple[float, float]\n", "x = (1\n"


def missing(subject: str, kind: str = "missing-module", line: int = 1) -> Diagnosis:
    """Give the diagnosis of a program that ended at an import."""
    return Diagnosis(kind, "", "", "it.py", line, "ModuleNotFoundError", subject=subject)


@pytest.mark.parametrize(
    ("module", "imported", "is_gap"),
    [
        ("matplotlib.pyplot", "matplotlib.pyplot", True),
        ("control_msgs.msg", "control_msgs.msg", True),
        ("tf2_msgs.msg", "tf2_msgs.msg", True),
        ("my_lab_trajectories", "my_lab_trajectories", False),
        ("matplotlib", "math", False),
    ],
)
def test_a_library_that_is_missing_is_for_a_person_to_decide(
    module: str, imported: str, is_gap: bool
) -> None:
    """A known package that the source imports there is told; a name that nobody knows, or that is not imported, not."""
    record = submission({"it.py": f"import {imported}\n"})
    told = environment_gap(missing(module), record, "it.py")
    assert (told is not None) == is_gap
    assert told is None or f"needs {module.split('.')[0]}" in told


def test_what_the_grader_found_is_not_missing() -> None:
    """The grader's own list decides.

    For a module not on the list (older recordings), the source decides.
    """
    record = submission({"it.py": "import matplotlib\n"})
    record.absent_modules = []
    assert environment_gap(missing("matplotlib"), record, "it.py") is None
    record.absent_modules = ["matplotlib"]
    assert environment_gap(missing("matplotlib"), record, "it.py") is not None
    assert environment_gap(None, record, "it.py") is None
    assert environment_gap(missing("matplotlib", line=2), record, "it.py") is None


def test_a_file_that_the_program_does_not_import_excuses_nothing() -> None:
    """A missing import counts in the program's file and in its imported files."""
    decoy = submission({"it.py": "import rclpy\n", "helper.py": "import scipy\n"})
    used = submission({"it.py": "from .helper import wave\n", "helper.py": "import scipy\n"})
    found = Diagnosis(
        "missing-module", "", "", "helper.py", 1, "ModuleNotFoundError", subject="scipy"
    )
    assert environment_gap(found, decoy, "it.py") is None
    assert environment_gap(found, used, "it.py") is not None


def test_files_that_import_each_other_are_looked_at_once() -> None:
    """As many files as are extracted, which all import all others, take no time to speak of."""
    names = [f"m{n}" for n in range(2000)]
    every = submission(
        {
            "it.py": f"import {', '.join(names)}\n",
            **{f"{name}.py": "import it, m1\n" for name in names},
        }
    )
    found = Diagnosis(
        "missing-module", "", "", "m1999.py", 1, "ModuleNotFoundError", subject="scipy"
    )
    began_s = time.process_time()
    assert environment_gap(found, every, "it.py") is None
    assert time.process_time() - began_s < 2.0


def test_interfaces_of_a_package_of_the_submission_are_not_built() -> None:
    """A package of interfaces that was handed in is not assessable; one without a definition is a mistake."""
    files = {"it.py": "from lab_interfaces.msg import Pose\n", "lab_interfaces/package.xml": ""}
    defined = submission({**files, "lab_interfaces/msg/Pose.msg": "float64 x\n"})
    for record in (defined, submission(files)):
        record.packages.append(PackageFact("lab_interfaces", "lab_interfaces", "ament_cmake"))
        told = environment_gap(missing("lab_interfaces", "missing-sibling"), record, "it.py")
        assert (told is not None) == (record is defined)


def test_interfaces_that_were_tried_are_missing_only_through_no_fault_of_theirs() -> None:
    """Interfaces that could not be built here are excused, with the reason.

    Interfaces with a mistake are not.
    """
    files = {
        "it.py": "from lab_interfaces.msg import Pose\n",
        "lab_interfaces/msg/Pose.msg": "int x\n",
    }
    record = submission(files)
    record.packages.append(PackageFact("lab_interfaces", "lab_interfaces", "ament_cmake"))
    record.absent_modules, record.not_built = ["lab_interfaces"], {}
    # Python takes a folder without modules for an empty package.
    no_name = Diagnosis("missing-name", "", "", "it.py", 1, "ImportError", subject="Pose")
    for found in (missing("lab_interfaces", "missing-sibling"), no_name):
        record.not_built = {}
        assert environment_gap(found, record, "it.py") is None
        record.not_built = {"lab_interfaces": "there is no compiler"}
        assert "there is no compiler" in (environment_gap(found, record, "it.py") or "")


def test_a_part_that_lacks_of_a_package_is_missing_where_it_is_used() -> None:
    """The grader has only a part of tf2_ros.

    The source must import the package and use the missing part.
    """
    record = submission({"it.py": "import tf2_ros\nb = tf2_ros.Buffer()\nb.transform(p, 'map')\n"})
    record.absent_modules = ["tf2_ros"]
    told = environment_gap(missing("tf2_ros.Buffer.transform", line=3), record, "it.py")
    assert told is not None
    assert "needs tf2_ros.Buffer.transform" in told
    assert environment_gap(missing("tf2_ros.Buffer.transform", line=2), record, "it.py") is None
    assert environment_gap(missing("scipy.transform", line=3), record, "it.py") is None


def test_a_submission_is_searched_for_what_may_be_missing() -> None:
    """Known packages that the sources name are looked for, but none that is a file of the submission."""
    record = submission(
        {
            "it.py": "import scipy, pandas, unheard_of\n",
            "pandas.py": "",
            "README.md": "import torch",
        }
    )
    assert modules_to_look_for(record) == ["scipy"]


@pytest.mark.parametrize("name", ["NaN", "float_", "product"])
def test_a_name_of_numpy_1_is_for_a_person_to_decide(name: str) -> None:
    """ROS 2 distributions have NumPy 1, with the names in the source; a made-up message excuses nothing."""
    found = Diagnosis("removed-from-numpy", "", "", file="it.py", line=2, subject=name)
    record = submission({"it.py": f"import numpy as np\nx = np.{name}\n"})
    told = environment_gap(found, record, "it.py")
    assert told is not None
    assert told.startswith(f"it.py (line 2) uses np.{name}, which the NumPy of ROS 2 Jazzy has")
    assert environment_gap(replace(found, line=1), record, "it.py") is None
    made_up = replace(found, subject="made_up")
    assert environment_gap(made_up, submission({"it.py": "\nnp.made_up"}), "it.py") is None


def test_a_file_in_newer_syntax_is_for_a_person_to_decide() -> None:
    """The file and its line are named; a mistake is no newer syntax."""
    found = Diagnosis("syntax-error", "", "", file="it.py", line=1)
    told = environment_gap(found, submission({"it.py": NEWER}), "it.py")
    assert told is not None
    assert told.startswith("it.py (line 1) uses syntax of Python 3.12")
    assert environment_gap(found, submission({"it.py": BROKEN}), "it.py") is None
    assert environment_gap(found, submission({"other.py": ""}), "other.py") is None


def test_a_teacher_is_told_how_to_install_a_missing_library() -> None:
    """The text for students names a person; the text for that person names commands."""
    reason = "It needs tabulate.core, which the grading computer lacks. Your instructor will run it by hand."
    text = for_teachers(reason)
    assert text.startswith("It needs tabulate.core, which the grading computer lacks. Install it")
    assert "the package of tabulate" in text
    assert "grade this submission again" in text
    assert "instructor" not in text
    busy = "Not your fault: the grading computer was too busy to measure this (2.00 s of 6.0 s)."
    assert for_teachers(busy).startswith("The grading computer was too busy")
    built = "talker is compiled by the package arm, which was not built: it lacks rclcpp."
    assert for_teachers(f"{built} Your instructor decides.") == f"T{built[1:]}"
