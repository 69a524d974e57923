"""The arm's mechanics against closed forms, against the laws of energy, and at its limits."""

import functools
import math
import random
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "reference"))

from arm_model import CHAIN, JOINT_COUNT, MODEL_FILE, ArmModel

from tests.thorough import THOROUGH

STEP_S = 0.005
STILL = [0.0] * JOINT_COUNT
GRAVITY = 9.81

Floats = NDArray[np.float64]


def resting(seed: int = 0, offset_rad: float = 0.0, **more: float) -> ArmModel:
    """Give an arm at rest."""
    arm = ArmModel(STEP_S, **more)
    arm.rest(seed, offset_rad)
    return arm


def moved(arm: ArmModel, targets: Sequence[float], steps: int) -> Floats:
    """Give the positions after each of some steps towards constant targets."""
    rows = []
    for _ in range(steps):
        arm.step(targets)
        rows.append(arm.positions)
    return np.array(rows)


# -- what arm.xml says, read without the engine ------------------------------------------------


@dataclass(frozen=True)
class Placed:
    """Something of the arm at its posture of all zeros: its name, the joint that carries it, and where it is."""

    name: str
    joint: int
    points: Floats  # (n, 3), even in its volume
    mass: float


def turned(about_y_rad: float) -> Floats:
    """Give the matrix of a turn about the y axis, the only one that bodies of this arm are laid with."""
    c, s = math.cos(about_y_rad), math.sin(about_y_rad)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def numbers(element: ElementTree.Element, key: str, default: str = "0 0 0") -> Floats:
    """Give the numbers of an attribute."""
    return np.array(element.get(key, default).split(), dtype=float)


def volume(geom: ElementTree.Element) -> Floats:
    """Give points that fill a sphere, or a capsule with round ends, evenly."""
    radius, ends = (
        float(numbers(geom, "size")[0]),
        numbers(geom, "fromto", "0 0 0 0 0 0").reshape(2, 3),
    )
    low, high = ends.min(axis=0) - radius, ends.max(axis=0) + radius
    axes = [np.linspace(a, b, 61)[:-1] + (b - a) / 120 for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    along = ends[1] - ends[0]
    share = np.clip((grid - ends[0]) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    inside = np.linalg.norm(grid - ends[0] - share[:, None] * along, axis=1) <= radius
    return np.array(grid[inside])


def placed(body: ElementTree.Element, joint: int, origin: Floats, turn: Floats) -> Iterator[Placed]:
    """Walk down the arm."""
    origin = origin + turn @ numbers(body, "pos")
    turn = turn @ turned(numbers(body, "euler")[1])
    joint += len(body.findall("joint"))
    for site in body.findall("site"):
        yield Placed(site.get("name", ""), joint, (origin + turn @ numbers(site, "pos"))[None], 0.0)
    for geom in body.findall("geom"):
        yield Placed("", joint, origin + volume(geom) @ turn.T, float(geom.get("mass", 0)))
    for child in body.findall("body"):
        yield from placed(child, joint, origin, turn)


@functools.cache
def parts() -> list[Placed]:
    """Give all that moves, with the number of joints that carry it."""
    world = ElementTree.parse(MODEL_FILE).getroot().find("worldbody")
    assert world is not None
    return list(placed(world.findall("body")[0], 0, np.zeros(3), np.eye(3)))


# -- motion ------------------------------------------------------------------------------------


def test_the_points_are_where_the_dimensions_put_them() -> None:
    """The drawn points match arm.xml's dimensions, at zero angles and with a turned base."""
    known = {part.name: part.points[0] for part in parts() if part.name} | {"base": np.zeros(3)}
    arm = resting()
    assert arm.posture(STILL) == pytest.approx(np.array([known[name] for name in CHAIN]), abs=1e-9)
    turned_around = np.array(arm.posture([math.pi, *STILL[1:]]))
    assert turned_around == pytest.approx(
        np.array([known[name] for name in CHAIN]) * [-1, -1, 1], abs=1e-9
    )


def test_servos_give_way_to_the_weight_as_the_closed_form_says() -> None:
    """At rest, shoulder and elbow hang by the torque of the masses beyond them divided by the servo's stiffness."""
    arm = resting()
    sag = -moved(arm, STILL, 600)[-1]
    known = {part.name: part.points[0] for part in parts() if part.name}
    for joint, pivot, stiffness in ((1, "shoulder", 6000.0), (3, "elbow", 2500.0)):
        beyond = [part for part in parts() if part.joint > joint]
        torque = sum(
            GRAVITY * part.mass * (part.points.mean(axis=0) - known[pivot])[0] for part in beyond
        )
        assert -sag[joint] == pytest.approx(torque / stiffness, rel=0.02)


def test_a_small_turn_of_the_base_is_that_of_a_damped_spring() -> None:
    """A small step of joint 0 is the textbook's response with the inertia that the masses have about the axis."""
    arm = resting()
    moved(arm, STILL, 400)
    height = [float(part.mass * (part.points[:, :2] ** 2).sum(axis=1).mean()) for part in parts()]
    inertia = sum(height) + 0.4
    stiffness, damping = 4000.0, float(-arm.model.actuator_biasprm[0, 2])
    decay, omega = damping / 2 / inertia, math.sqrt(stiffness / inertia)
    swing = np.emath.sqrt(complex(decay**2 - omega**2))
    # Within its first step the servo's target gets where it is to be, evenly: on average half a step late.
    t = (np.arange(60) + 0.5) * STEP_S
    expected = (
        1 - (np.exp(-decay * t) * (np.cosh(swing * t) + decay * np.sinh(swing * t) / swing)).real
    )
    got = moved(arm, [0.008, *STILL[1:]], 60)[:, 0] / 0.008
    assert np.abs(got - expected).max() < 0.02


def test_a_swing_without_motors_keeps_its_energy() -> None:
    """A limp arm, off the floor and without stops, falls and swings.

    Height turns into speed and back.
    """
    arm = resting(offset_rad=0.5, seed=4)
    flags = mujoco.mjtDisableBit
    off = (flags.mjDSBL_ACTUATION, flags.mjDSBL_CONTACT, flags.mjDSBL_LIMIT)
    arm.model.opt.disableflags |= sum(int(flag) for flag in off)
    arm.model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    arm.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    energies = []
    for _ in range(1000):
        arm.step(STILL)
        energies.append(tuple(arm.data.energy))
    potential, kinetic = np.array(energies).T
    assert kinetic.max() > 10
    assert np.abs(potential + kinetic - potential[0] - kinetic[0]).max() < 1e-3 * kinetic.max()


@pytest.mark.parametrize("max_velocity", [0.5, 1.5])
def test_a_jump_is_followed_at_the_scaled_velocity(max_velocity: float) -> None:
    """Sent far away at once, each joint goes there at its rated speed times `max_velocity`, and settles."""
    far = [1.5, -0.7, 1.5, 1.2, 1.5, 1.2, 1.5]
    rows = moved(resting(max_velocity=max_velocity), far, 1000)
    speeds = np.abs(np.diff(rows, axis=0)).max(axis=0) / STEP_S
    assert speeds == pytest.approx(np.array([2.0] * 4 + [2.5] * 3) * max_velocity, rel=0.1)
    assert rows[-1] == pytest.approx(far, abs=5e-3)


def test_a_target_out_of_reach_ends_at_the_joints_limit() -> None:
    """Degrees taken for rad, or a number without end, bring a joint to its stop, and not past it."""
    for target in (28.6, 1e308):
        arm = resting()
        last = moved(arm, [target, *STILL[1:]], 1000)[:, 0]
        assert last[-1] == pytest.approx(2.9, abs=2e-3)
        assert last.max() < 2.9 + 5e-3
        assert np.isfinite(arm.posture([target, *STILL[1:]])).all()


def test_the_floor_holds_and_motors_give_in() -> None:
    """Sent through the floor, the arm presses on it with no more than its motors' torque, and stays above."""
    arm = resting()
    moved(arm, [0.0, 1.7, *STILL[2:]], 600)
    assert 0 < min(z for _, _, z in arm.posture(arm.positions)[1:]) < 0.1
    assert arm.positions[1] < 1.6
    assert (np.abs(arm.data.actuator_force) <= arm.model.actuator_forcerange[:, 1] + 1e-9).all()


def test_disabled_arm_holds_its_position() -> None:
    """With the brakes on, an arm in motion stops where it is and stays; released, it starts from there."""
    arm = resting()
    moved(arm, [1.0] * JOINT_COUNT, 20)
    assert any(arm.velocities)
    stopped = arm.positions
    for target in (1.0, 0.3):
        arm.step([target] * JOINT_COUNT, enabled=False)
    assert arm.positions == stopped
    assert not any(arm.velocities)
    assert moved(arm, [1.0] * JOINT_COUNT, 1)[0] == pytest.approx(stopped, abs=1e-3)


def test_arm_follows_the_labs_sinusoids_closely() -> None:
    """The lab's sinusoids are followed within the lag of the servos, kv/kp of the speed, and their sag."""
    arm, worst = resting(), np.zeros(2)
    for k in range(2000):
        t = k * STEP_S
        targets = [0.5 * math.sin(2 * math.pi * 0.2 * t), 0.3 * math.sin(2 * math.pi * 0.3 * t)]
        arm.step([*targets, *STILL[2:]])
        worst = np.maximum(worst, np.abs(np.subtract(arm.positions[:2], targets)))
    assert (worst < 0.02).all()
    assert (worst > 0.005).all()


def digest(seed: int, steps: int, draw: Any) -> bytes:
    """Drive the arm wildly, and give its positions and velocities at each hundredth step, as bytes."""
    arm, rows, targets = resting(seed, 0.05), [], STILL
    for k in range(steps):
        if k % 40 == 0:
            targets = [draw.choice([draw.uniform(-3, 3), draw.uniform(-30, 30)]) for _ in STILL]
        arm.step(targets, enabled=k % 700 > 50)
        if k % 100 == 0:
            rows += [*arm.positions, *arm.velocities]
    assert np.isfinite(rows).all()
    assert np.abs(rows).max() < 60
    return np.array(rows).tobytes()


def test_the_same_seed_gives_the_same_bytes() -> None:
    """Long jumps, stops and collisions give the same motion again, and with another seed another."""
    steps = round((1000 if THOROUGH else 20) / STEP_S)
    first = digest(1, steps, random.Random(1))
    assert first == digest(1, steps, random.Random(1))
    assert first[:2000] != digest(2, 1000, random.Random(2))[:2000]


def test_the_pairs_touch_as_all_geoms_would(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """With a search for contacts of all parts, instead of pairs, the arm moves alike, to the byte."""
    steps = round((1000 if THOROUGH else 20) / STEP_S)
    by_pairs = digest(3, steps, random.Random(3))
    tree = ElementTree.parse(MODEL_FILE)
    root = tree.getroot()
    for contacts in root.findall("contact"):
        root.remove(contacts)
    for geom in root.iter("geom"):
        geom.set("contype", "1")
        geom.set("friction", "0.6 0.01 0.001")
        if geom.get("name") == "floor":
            geom.set("contype", "0")
            geom.set("conaffinity", "1")
    tree.write(tmp_path / "arm.xml")
    monkeypatch.setattr("arm_model.MODEL_FILE", tmp_path / "arm.xml")
    arm = resting()
    moved(arm, [0.0, 1.7, *STILL[2:]], 600)
    assert arm.data.ncon > 0
    assert digest(3, steps, random.Random(3)) == by_pairs


def test_initial_offsets_come_from_the_seed() -> None:
    """The same seed gives the same small offsets, another seed gives others, and no offset means zero."""
    assert resting(3, 0.05).positions == resting(3, 0.05).positions != resting(4, 0.05).positions
    assert 0 < max(map(abs, resting(3, 0.05).positions)) <= 0.05
    assert resting(3).positions == STILL


@pytest.mark.parametrize(("step_s", "max_velocity"), [(0.0, 1.0), (0.01, 0.0), (float("nan"), 1.0)])
def test_step_and_velocity_must_be_positive(step_s: float, max_velocity: float) -> None:
    """A step or a velocity scale that is not a positive number is refused."""
    with pytest.raises(ValueError, match="positive"):
        ArmModel(step_s, max_velocity)
