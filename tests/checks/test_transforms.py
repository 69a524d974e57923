"""Transforms that are broadcast: frames, tree, stamps, static ones, rates and poses; right, wrong and at the edge."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from grader.checks.transforms import TransformTree
from grader.evidence.near_miss import is_misspelt
from grader.evidence.transforms import Broadcast, FrameTree
from grader.result import Finding, Outcome
from tests.synthetic import RELIABLE, Session, at, evenly, judged, submission

TF = "tf2_msgs/msg/TFMessage"
LATCHED = replace(RELIABLE, durability="transient_local")
FRAMES = [
    {"child": "base", "parent": "odom", "rate_hz": 20.0},
    {"child": "laser", "parent": "base", "static": True},
]
TREE: dict[str, Any] = {"process": "it", "frames": FRAMES, "window": "window"}
LASER = {"frame": "laser", "within": "base", "xyz": [0.2, 0.0, 0.3], "rpy": [0.0, 0.0, 0.5]}
NOTHING = dict.fromkeys(("frames", "tree", "values", "stamps", "static", "rates", "poses"), 0.0)
TIMES = evenly(20, 3.0)


def yawed(angle: float, length: float = 1.0) -> list[float]:
    """Give the quaternion x, y, z, w of a turn about z."""
    return [0.0, 0.0, length * math.sin(angle / 2), length * math.cos(angle / 2)]


def transform(
    parent: str,
    child: str,
    time_s: float,
    xyz: Sequence[float] = (0, 0, 0),
    xyzw: Sequence[float] = (0, 0, 0, 1),
) -> dict[str, Any]:
    """Give a transform as a message has it."""
    stamp_ns = at(time_s) if time_s else 0
    pose = {
        "translation": dict(zip("xyz", xyz, strict=True)),
        "rotation": dict(zip("xyzw", xyzw, strict=True)),
    }
    header = {"frame_id": parent, "stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}}
    return {"header": header, "child_frame_id": child, "transform": pose}


def base(
    time_s: float, late_s: float = 0.0, *, parent: str = "odom", child: str = "base"
) -> dict[str, Any]:
    """Give the frame that drives along x at 0.5 m/s and turns at 0.2 rad/s."""
    return transform(parent, child, time_s - late_s, (0.5 * time_s, 0, 0), yawed(0.2 * time_s))


def laser(**other: Any) -> dict[str, Any]:
    """Return the static frame in its right place, apart from the given fields."""
    return transform(
        **{
            "parent": "base",
            "child": "laser",
            "time_s": 0.9,
            "xyz": (0.2, 0, 0.3),
            "xyzw": yawed(0.5),
            **other,
        }
    )


def session(
    folder: Path,
    moving: Iterable[tuple[float, dict[str, Any]]] | None = None,
    static: Iterable[dict[str, Any]] | None = None,
    *,
    durability: str = "transient_local",
) -> Session:
    """Record transforms by the time of their publication, and static ones."""
    sent = list(moving if moving is not None else ((t, base(t)) for t in TIMES))
    latched = list(static if static is not None else [laser()])
    made = Session(folder).process("it").window(1.0, 4.0)
    made.typed("/tf", TF, [{"transforms": [each]} for _, each in sent], [t for t, _ in sent])
    made.typed(
        "/tf_static", TF, [{"transforms": latched}] if latched else [], [0.9] if latched else []
    )
    made.endpoint("publisher", "/tf", topic_type=TF)
    made.endpoint(
        "publisher", "/tf_static", topic_type=TF, qos=replace(LATCHED, durability=durability)
    )
    return made


def only(part: str, made: Session, **parameters: Any) -> Finding:
    """Judge one part of the tree."""
    return judged("transform_tree", {**TREE, "weights": {**NOTHING, part: 1.0}, **parameters}, made)


def test_all_as_asked_passes(tmp_path: Path) -> None:
    """Frames, rates, stamps and poses are right."""
    poses = [
        LASER,
        {
            "frame": "laser",
            "within": "odom",
            "oracle": "tests/checks/test_transforms.py:laser_in_odom",
        },
    ]
    finding = judged("transform_tree", {**TREE, "poses": poses}, session(tmp_path))
    assert (finding.outcome, finding.reason) == (Outcome.PASSED, "")
    assert "base at 20.0 Hz" in finding.measured


def laser_in_odom(
    streams: Mapping[str, Any], parameters: Mapping[str, Any], seed: int
) -> list[list[float]]:
    """Compute where the laser is, by the formula of the drive; an oracle as a lab has it."""
    found = []
    for time_ns in parameters["times_ns"]:
        time_s = (int(time_ns) - at(0.0)) / 1e9 * parameters.get("factor", 1.0)
        x, y = 0.5 * time_s + 0.2 * math.cos(0.2 * time_s), 0.2 * math.sin(0.2 * time_s)
        found.append([x, y, 0.3, *yawed(0.2 * time_s + 0.5)])
    return found


def test_nothing_sent_fails(tmp_path: Path) -> None:
    """No transforms, or another type on the topic, is said as such."""
    assert (
        "No transform was sent on /tf or /tf_static."
        in only("frames", session(tmp_path, [], [])).reason
    )
    made = Session(tmp_path, "other").window(1.0, 4.0)
    made.typed("/tf", "geometry_msgs/msg/TransformStamped", [base(2.0)], [2.0])
    finding = only("frames", made)
    assert finding.outcome is Outcome.FAILED
    assert (
        "/tf carries geometry_msgs/msg/TransformStamped, not tf2_msgs/msg/TFMessage."
        in finding.reason
    )


@pytest.mark.parametrize(
    ("node", "credit"),
    [("/student", "1"), ("/of_another/student", "1"), ("/broadcaster", "0.8")],
    ids=["right", "within", "other"],
)
def test_another_node_costs_a_part(tmp_path: Path, node: str, credit: str) -> None:
    """The sender of the transforms is looked up in the graph; only another name costs."""
    finding = only("frames", session(tmp_path), node=node)
    assert (finding.credit, "from node" in finding.expected) == (Decimal(credit), True)
    assert finding.reason == ("" if credit == "1" else f"The node is named /student, not {node}.")


# -- frames and tree -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "credit", "words"),
    [
        ({}, "1", ""),
        (
            {"parent": "base", "child": "odom"},
            "0.75",
            "Parent and child are exchanged: odom was sent as a child of base.",
        ),
        ({"parent": "/odom", "child": "/base"}, "0.75", "leading slash"),
        ({"parent": "map"}, "0.5", "The parent of base is map, not odom."),
        ({"child": "robot"}, "0.5", "No transform of the frame base arrived on /tf."),
    ],
)
def test_wrong_names_cost_their_frame(
    tmp_path: Path, names: dict[str, Any], credit: str, words: str
) -> None:
    """One of two frames is worth half; a mistake in a name costs half of that."""
    finding = only("frames", session(tmp_path, [(t, base(t, **names)) for t in TIMES]))
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


@pytest.mark.parametrize(
    ("more", "credit", "words"),
    [
        ([], "1", ""),
        (
            [transform("camera", "lens", 1.0)],
            "0.667",
            "There are 2 roots, not connected: camera, odom.",
        ),
        (
            [transform("map", "base", 1.0), transform("map", "odom", 1.0)],
            "0.667",
            "The frame base has 2 parents",
        ),
        ([transform("laser", "odom", 1.0)], "0.667", "The frames form a circle"),
    ],
)
def test_a_tree_has_one_root_one_parent_each_and_no_circle(
    tmp_path: Path, more: list[dict[str, Any]], credit: str, words: str
) -> None:
    """Each of the three is a third."""
    finding = only("tree", session(tmp_path, None, [laser(), *more]))
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


@pytest.mark.parametrize(
    "names", [{"child": "robot", "parent": "odom"}, {"parent": "base", "child": "odom"}]
)
def test_one_mistake_costs_once(tmp_path: Path, names: dict[str, Any]) -> None:
    """A frame that is missing, or exchanged with its parent, does not break the tree besides."""
    finding = only("tree", session(tmp_path, [(t, base(t, **names)) for t in TIMES]))
    assert finding.outcome is Outcome.PASSED
    exchanged = session(tmp_path / "again", [(t, base(t, **names)) for t in TIMES])
    pose = {
        "frame": "base",
        "within": "odom",
        "oracle": "tests/checks/test_transforms.py:base_in_odom",
    }
    found = only("poses", exchanged, poses=[pose])
    assert found.outcome is (Outcome.FAILED if names["child"] == "robot" else Outcome.PASSED)


@pytest.mark.parametrize("names", [{"child": "bases"}, {"parent": "odoms"}, {"parent": "Odom"}])
def test_a_misspelt_frame_is_judged_under_the_name_that_it_has(
    tmp_path: Path, names: dict[str, Any]
) -> None:
    """The misspelt name costs its part of the frames, as any wrong name.

    Position and tree are right.
    """
    made = session(
        tmp_path, [(t, base(t, **names)) for t in TIMES], [laser(parent=names.get("child", "base"))]
    )
    pose = {
        "frame": "base",
        "within": "odom",
        "oracle": "tests/checks/test_transforms.py:base_in_odom",
    }
    wrong = only("frames", made)
    assert wrong.credit == Decimal("0.5")
    assert next(iter(names.values())) in wrong.reason
    assert only("poses", made, poses=[pose]).outcome is Outcome.PASSED
    assert only("tree", made).outcome is Outcome.PASSED


def test_a_misspelt_parent_costs_only_the_frame_that_names_it(tmp_path: Path) -> None:
    """The frame itself is sent under its right name, below another."""
    made = session(tmp_path, static=[laser(parent="bas")])
    wrong = only("frames", made)
    assert (wrong.credit, "The parent of laser is bas, not base." in wrong.reason) == (
        Decimal("0.5"),
        True,
    )
    pose = {
        "frame": "laser",
        "within": "odom",
        "oracle": "tests/checks/test_transforms.py:laser_in_odom",
    }
    assert only("poses", made, poses=[pose]).outcome is Outcome.PASSED


@pytest.mark.parametrize(
    ("wanted", "name", "is_slip"),
    [
        ("forearm_link", "forearm", True),
        ("forearm_link", "fore_arm_link", True),
        ("upper_arm_link", "upper_arm_lnk", True),
        ("Camera_Link", "camera_link", True),
        ("sensor_1", "sensor_2", False),
        ("camera_1_link", "camera_2_lnk", False),
        ("robot1/camera_link", "robot2/camera_link", False),
        ("gripper_left_finger", "gripper_right_finger", False),
        ("upper_arm_link", "lower_arm_link", False),
        ("upper_arm_link", "forearm_link", False),
        ("wrist_roll_link", "wrist_link", False),
        ("camera_optical_frame", "camera_frame", False),
        ("base_link", "base_footprint", False),
        ("base", "laser", False),
        ("_", "base", False),
    ],
)
def test_what_is_a_slip_in_the_name_of_a_frame(wanted: str, name: str, is_slip: bool) -> None:
    """Word by word: another number, side or part of a robot is another frame."""
    assert is_misspelt(wanted, name) is is_slip


def test_a_name_that_is_sent_is_not_taken_for_another(tmp_path: Path) -> None:
    """A known frame with a similar name is not taken for the missing frame."""
    made = session(tmp_path, [(t, base(t, child="laser")) for t in TIMES], [])
    assert "No transform of the frame base" in only("frames", made).reason


def base_in_odom(
    streams: Mapping[str, Any], parameters: Mapping[str, Any], seed: int
) -> list[list[float]]:
    """Compute where the base is."""
    times_s = [(int(time_ns) - at(0.0)) / 1e9 for time_ns in parameters["times_ns"]]
    return [[0.5 * time_s, 0.0, 0.0, *yawed(0.2 * time_s)] for time_s in times_s]


# -- numbers, stamps, topics, rates ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("xyzw", "credit", "words"),
    [
        (yawed(0.5, 1.0049), "1", ""),
        (yawed(0.5, 1.0051), "0.5", "not normalised"),
        ([0.0, 0.0, 0.0, 0.0], "0.5", "is 0, 0, 0, 0, which is not a rotation"),
        ([0.0, 0.0, math.nan, 1.0], "0.5", "not finite"),
    ],
)
def test_quaternions_have_the_length_1(
    tmp_path: Path, xyzw: list[float], credit: str, words: str
) -> None:
    """Half a percent is allowed."""
    finding = only("values", session(tmp_path, None, [laser(xyzw=xyzw)]))
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


@pytest.mark.parametrize(
    ("late_s", "outcome", "words"),
    [
        (0.0, Outcome.PASSED, ""),
        (0.099, Outcome.PASSED, ""),
        (0.101, Outcome.FAILED, "0.10 s old"),
        (-0.019, Outcome.PASSED, ""),
        (-0.5, Outcome.FAILED, "0.50 s in the future"),
    ],
)
def test_stamps_are_of_the_time_of_publication(
    tmp_path: Path, late_s: float, outcome: Outcome, words: str
) -> None:
    """A tenth of a second old, or a fiftieth ahead, is allowed."""
    finding = only("stamps", session(tmp_path, [(t, base(t, late_s=late_s)) for t in TIMES]))
    assert finding.outcome is outcome
    assert words in finding.reason


def test_stamps_of_0_are_named(tmp_path: Path) -> None:
    """The hint explains how to set a forgotten stamp."""
    finding = only(
        "stamps", session(tmp_path, [(t, transform("odom", "base", 0.0)) for t in TIMES])
    )
    assert (finding.outcome, finding.reason) == (Outcome.FAILED, "The stamps of base are 0.")
    assert "get_clock().now()" in finding.hint


def test_a_stamp_that_the_machine_made_old_is_undecided(tmp_path: Path) -> None:
    """A machine delay between stamp and publication is no mistake; an old stamp without one is."""
    late = {2.0: 0.4, 3.0: 0.4}
    sent = [(t, base(t, late_s=late.get(round(t, 2), 0.0))) for t in TIMES]
    assert only("stamps", session(tmp_path, sent)).outcome is Outcome.PARTIAL
    made = session(tmp_path / "delayed", sent).disturbed("it", (1.65, 0.34), (2.65, 0.34))
    assert only("stamps", made).outcome is Outcome.INCONCLUSIVE
    assert (
        only("stamps", session(tmp_path / "other", sent).disturbed("it", (3.5, 0.4))).outcome
        is Outcome.PARTIAL
    )


def test_simulated_time_is_that_of_the_clock(tmp_path: Path) -> None:
    """Stamps of the simulation are held against /clock, and not against the machine's time."""

    def stamped(time_s: float) -> dict[str, Any]:
        sent = transform("odom", "base", 1.0)
        sent["header"]["stamp"] = {"sec": int(time_s), "nanosec": round(time_s % 1 * 1e9)}
        return sent

    def made(name: str, shift_s: float) -> Session:
        recorded = session(tmp_path / name, [(t, stamped(2 * t + shift_s)) for t in TIMES])
        clock = []
        for t in evenly(100, 4.0, 0.5):
            clock.append({"clock": {"sec": int(2 * t), "nanosec": round(2 * t % 1 * 1e9)}})
        return recorded.typed("/clock", "rosgraph_msgs/msg/Clock", clock, evenly(100, 4.0, 0.5))

    assert only("stamps", made("right", 0.0), simulated=True).outcome is Outcome.PASSED
    assert only("stamps", made("wrong", -1.0), simulated=True).outcome is Outcome.FAILED
    assert only("stamps", made("system", 0.0)).outcome is Outcome.FAILED


AGAIN = [(t, base(t)) for t in TIMES] + [(t, laser()) for t in TIMES]


@pytest.mark.parametrize(
    ("moving", "static", "durability", "credit", "words"),
    [
        (None, None, "transient_local", "1", ""),
        (None, None, "volatile", "0.5", "/tf_static is offered VOLATILE"),
        (AGAIN, None, "transient_local", "0.75", "and again on /tf"),
        (AGAIN, [], "transient_local", "0.75", "was sent on /tf, where it ages"),
        (
            [*AGAIN[: len(TIMES)], (0.5, laser())],
            [],
            "transient_local",
            "0.5",
            "sent once on /tf, without being latched",
        ),
        (
            [],
            [laser(), base(1.0)],
            "transient_local",
            "0.5",
            "base moves, and was sent on /tf_static",
        ),
    ],
)
def test_what_is_static_is_latched(
    tmp_path: Path,
    moving: list[tuple[float, dict[str, Any]]] | None,
    static: list[dict[str, Any]] | None,
    durability: str,
    credit: str,
    words: str,
) -> None:
    """A static frame is latched on its own topic for late listeners, and nowhere else.

    A moving frame is not static.
    """
    finding = only("static", session(tmp_path, moving, static, durability=durability))
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


@pytest.mark.parametrize(
    ("rate_hz", "credit"),
    [(20.0, "1"), (18.1, "1"), (17.0, "0.8"), (21.9, "1"), (13.9, "0.4"), (8.0, "0"), (40.0, "0")],
)
def test_rates_fall_with_their_deviation(tmp_path: Path, rate_hz: float, credit: str) -> None:
    """A tenth is full, and half off is none."""
    finding = only("rates", session(tmp_path, [(t, base(t)) for t in evenly(rate_hz, 3.0)]))
    assert finding.credit == Decimal(credit)


def test_a_rate_that_the_machine_lowered_is_undecided(tmp_path: Path) -> None:
    """A rate that would be right without the delay is undecided.

    A node that falls silent is slow.
    """
    slow = [(t, base(t)) for t in evenly(15.0, 3.0)]
    assert only("rates", session(tmp_path, slow)).outcome is Outcome.PARTIAL
    delayed = session(tmp_path / "delayed", slow).disturbed(
        "it", *((1.0 + n / 2, 0.15) for n in range(6))
    )
    assert only("rates", delayed).outcome is Outcome.INCONCLUSIVE
    silent = session(tmp_path / "silent", [(t, base(t)) for t in evenly(20.0, 1.0)])
    assert only("rates", silent).outcome is Outcome.FAILED


@pytest.mark.parametrize(
    ("absent", "outcome"),
    [(["transforms3d"], Outcome.INCONCLUSIVE), ([], Outcome.FAILED)],
    ids=["absent", "there"],
)
def test_a_broadcaster_that_lacks_a_library_here_is_for_a_person(
    tmp_path: Path, absent: list[str], outcome: Outcome
) -> None:
    """A node that ended at the import of a missing library shows no frames.

    The points stay open.
    """
    lines = ["Traceback (most recent call last):", '  File "/ws/src/it.py", line 1, in <module>']
    lines.append("ModuleNotFoundError: No module named 'transforms3d'")
    made = (
        Session(tmp_path).process("it", lines, interrupted_ns=None, exit_status=1).window(1.0, 4.0)
    )
    record = submission({"it.py": "import transforms3d\n"})
    record.absent_modules = absent
    finding = judged("transform_tree", TREE, made, record)
    assert finding.outcome is outcome


# -- poses -----------------------------------------------------------------------------------------

INVERSE = {"xyz": (-0.2 * math.cos(0.5), 0.2 * math.sin(0.5), -0.3), "xyzw": yawed(-0.5)}


@pytest.mark.parametrize(
    ("sent", "credit", "words"),
    [
        ({}, "1", ""),
        ({"xyz": (0.2099, 0, 0.3)}, "1", ""),
        ({"xyz": (0.2101, 0, 0.3)}, "0", "laser in base is off by 0.0101 m and 0.000°"),
        ({"xyzw": yawed(0.5 + math.radians(0.99))}, "1", ""),
        ({"xyzw": yawed(0.5 + math.radians(1.01))}, "0", "1.010°"),
        ({"xyzw": [-n for n in yawed(0.5, 3.0)]}, "1", ""),
        (INVERSE, "0.5", "It is the inverse: where base lies in laser."),
        ({"xyzw": [math.cos(0.25), 0, 0, math.sin(0.25)]}, "0.5", "in the order w, x, y, z"),
        ({"xyzw": yawed(math.degrees(0.5))}, "0.5", "in degrees where radians are meant"),
        ({"xyzw": [0, 0, 0, 0]}, "0", "numbers that are not a pose"),
    ],
)
def test_a_pose_is_where_it_should_be(
    tmp_path: Path, sent: dict[str, Any], credit: str, words: str
) -> None:
    """Within a centimetre and a degree; known mistakes have their names, and leave half of the credit."""
    finding = only("poses", session(tmp_path, None, [laser(**sent)]), poses=[LASER])
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


def test_turns_about_the_moving_axes_have_their_name(tmp_path: Path) -> None:
    """A roll of 90°, and then a yaw of 90°, turns x to z where the axes move along, and to y where they stay."""
    turned = {**LASER, "rpy": [math.pi / 2, 0.0, math.pi / 2]}
    moving, fixed = [0.5, -0.5, 0.5, 0.5], [0.5, 0.5, 0.5, 0.5]
    finding = only("poses", session(tmp_path, None, [laser(xyzw=moving)]), poses=[turned])
    assert finding.credit == Decimal("0.5")
    assert "about the moving axes" in finding.reason
    right = session(tmp_path / "right", None, [laser(xyzw=fixed)])
    assert only("poses", right, poses=[turned]).outcome is Outcome.PASSED
    other = session(tmp_path / "other", None, [laser(xyzw=yawed(0.5))])
    assert only("poses", other, poses=[turned]).outcome is Outcome.FAILED


ORACLE = {
    "frame": "laser",
    "within": "odom",
    "oracle": "tests/checks/test_transforms.py:laser_in_odom",
}
SLIP = {"parameters": {"factor": 2.0}, "meaning": "a drive that is twice as fast", "credit": 0.5}


@pytest.mark.parametrize(("factor", "credit"), [(1.0, "1"), (2.0, "0.5"), (1.5, "0")])
def test_an_oracle_says_where_a_frame_is_at_each_time(
    tmp_path: Path, factor: float, credit: str
) -> None:
    """Poses are composed along the tree.

    The oracle's pose with other parameters names a mistake.
    """
    sent = []
    for t in TIMES:
        sent.append(
            (t, transform("odom", "base", t, (0.5 * t * factor, 0, 0), yawed(0.2 * t * factor)))
        )
    finding = only("poses", session(tmp_path, sent), poses=[{**ORACLE, "alternatives": [SLIP]}])
    assert finding.credit == Decimal(credit)
    assert ("twice as fast" in finding.reason) == (factor == 2.0)


def test_what_was_sent_before_anybody_listened_is_said(tmp_path: Path) -> None:
    """Sequence numbers show lost messages on /tf; a static frame may have been among them."""
    made = session(tmp_path, [], [])
    made.typed("/tf", TF, [{"transforms": [base(t)]} for t in TIMES], TIMES)
    assert only("frames", made).reason == "No transform of the frame laser arrived."
    late = session(tmp_path / "late", [(t, base(t)) for t in TIMES], [])
    recorded = late.recorded()
    recorded.stream("/tf").sequence[:] += 2
    finding = judged("transform_tree", {**TREE, "weights": {**NOTHING, "frames": 1.0}}, recorded)
    assert "The first 2 messages on /tf were sent before anybody listened" in finding.reason
    assert "TRANSIENT_LOCAL" in finding.hint


def test_what_was_not_latched_lies_where_it_should_all_the_same(tmp_path: Path) -> None:
    """A static frame that was sent once on /tf has cost its part, and no pose besides."""
    made = session(tmp_path, [*((t, base(t)) for t in TIMES), (0.5, laser())], [])
    assert only("poses", made, poses=[LASER, ORACLE]).outcome is Outcome.PASSED


def test_at_given_times_a_pose_is_interpolated(tmp_path: Path) -> None:
    """A pose between two stamps is interpolated; outside the sent stamps there is none."""
    pose = {
        "frame": "base",
        "within": "odom",
        "xyz": [0.5 * 2.025, 0, 0],
        "rpy": [0, 0, 0.2 * 2.025],
    }
    close = {**pose, "tolerance_m": 1e-6, "tolerance_deg": 1e-4}
    assert (
        only("poses", session(tmp_path), poses=[{**close, "at_s": [1.025]}]).outcome
        is Outcome.PASSED
    )
    late = only("poses", session(tmp_path / "late"), poses=[{**close, "at_s": [9.0]}])
    assert late.outcome is Outcome.FAILED
    assert "nothing connects them at the time that is looked at" in late.reason


def test_poses_that_the_machine_delayed_are_undecided(tmp_path: Path) -> None:
    """A pose that was computed for another time than it is stamped with is wrong, unless the machine was late."""
    sent = []
    for t in TIMES:
        sent.append(
            (t, base(t) if abs(t - 2.5) > 0.3 else {**base(t - 0.2), "header": base(t)["header"]})
        )
    assert only("poses", session(tmp_path, sent), poses=[ORACLE]).outcome is Outcome.PARTIAL
    made = session(tmp_path / "delayed", sent).disturbed(
        "it", *((2.2 + n / 10, 0.05) for n in range(7))
    )
    assert only("poses", made, poses=[ORACLE]).outcome is Outcome.INCONCLUSIVE
    wrong = [(t, transform("odom", "base", t)) for t in TIMES]
    made = session(tmp_path / "wrong", wrong).disturbed(
        "it", *((2.2 + n / 10, 0.05) for n in range(7))
    )
    assert only("poses", made, poses=[ORACLE]).outcome is Outcome.FAILED


def test_frames_that_nothing_connects_are_said(tmp_path: Path) -> None:
    """A pose between two trees is not tested, nor a pose with an oracle that lacks its messages."""
    finding = only("poses", session(tmp_path, [], [laser()]), poses=[ORACLE])
    assert "nothing connects them" in finding.reason
    streams = {"pose": {"topic": "/pose", "field": "pose.position"}}
    made = session(tmp_path / "again")
    finding = only("poses", made, poses=[{**ORACLE, "streams": streams}])
    assert finding.outcome is Outcome.FAILED
    assert "nothing was recorded from which it follows" in finding.reason


@pytest.mark.parametrize("number", [1, 4])
def test_few_wrong_poses_are_wrong(tmp_path: Path, number: int) -> None:
    """A few wrong poses prove a mistake if the machine delayed nothing.

    If all were delayed, the machine may be the cause.
    """
    sent = [(t, transform("odom", "base", t)) for t in TIMES[:number]]
    assert only("poses", session(tmp_path, sent), poses=[ORACLE]).outcome is Outcome.FAILED
    made = session(tmp_path / "delayed", sent).disturbed("it", (1.0, 0.3))
    assert only("poses", made, poses=[ORACLE]).outcome is Outcome.INCONCLUSIVE


def test_other_frames_than_the_wanted_earn_nothing(tmp_path: Path) -> None:
    """A sound tree of good numbers is no achievement where none of the frames is asked for."""
    made = session(tmp_path, [(t, base(t, parent="map", child="robot")) for t in TIMES], [])
    finding = judged("transform_tree", TREE, made)
    assert (finding.outcome, finding.reason) == (
        Outcome.FAILED,
        "None of the frames was sent, but robot.",
    )


def test_numbers_of_other_frames_do_not_count(tmp_path: Path) -> None:
    """However many good ones are sent, a bad one among the wanted costs as much."""
    more = [transform("base", f"frame_{n}", 1.0) for n in range(60)]
    finding = only("values", session(tmp_path, None, [laser(xyzw=[0, 0, 0, 0]), *more]))
    assert finding.credit == Decimal("0.5")


def test_a_long_way_between_frames_is_judged_soon(tmp_path: Path) -> None:
    """A flood of frames is not searched link by link for another order of the numbers."""
    names = ["base", *(f"link_{n}" for n in range(30)), "laser"]
    made = session(tmp_path, None, [transform(a, b, 0.9, (0, 0, 1)) for a, b in pairwise(names)])
    rolled: list[int] = []
    tree = FrameTree.rolled

    def counted(self: FrameTree, edges: Sequence[Broadcast]) -> FrameTree:
        rolled.append(len(edges))
        return tree(self, edges)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FrameTree, "rolled", counted)
        assert only("poses", made, poses=[LASER]).outcome is Outcome.FAILED
    assert len(rolled) <= 11


def test_times_in_a_window_need_one() -> None:
    """Times are counted in a window, and would be overlooked without one."""
    wanted = {**TREE, "window": None, "poses": [{**LASER, "at_s": [1.0]}]}
    with pytest.raises(ValidationError, match="at_s needs a window"):
        TransformTree.model_validate(wanted)
