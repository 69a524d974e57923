"""The arm's mechanics against closed forms."""

import math
import sys
from itertools import pairwise
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "reference"))

from arm_model import JOINT_COUNT, JOINTS, ArmModel, ArmState, Joint

STEP_S = 0.005


def moved(model: ArmModel, targets: list[float], steps: int, state: ArmState | None = None) -> list[ArmState]:
    """Give the states after each of some steps towards constant targets."""
    states = [state or model.initial_state(0)]
    for _ in range(steps):
        states.append(model.step(states[-1], targets))
    return states[1:]


def step_response(joint: Joint, t_s: float) -> float:
    """Give the unit step response of a damped spring, from the textbook forms."""
    omega, zeta = joint.natural_frequency_rad_s, joint.damping_ratio
    if zeta == 1:
        return 1 - math.exp(-omega * t_s) * (1 + omega * t_s)
    if zeta < 1:
        damped = omega * math.sqrt(1 - zeta**2)
        swing = math.cos(damped * t_s) + zeta * omega / damped * math.sin(damped * t_s)
        return 1 - math.exp(-zeta * omega * t_s) * swing
    slow, fast = (omega * (zeta - sign * math.sqrt(zeta**2 - 1)) for sign in (1, -1))
    return 1 - (fast * math.exp(-slow * t_s) - slow * math.exp(-fast * t_s)) / (fast - slow)


@pytest.mark.parametrize("damping_ratio", [0.2, 0.9, 1.0, 1.7])
@pytest.mark.parametrize("step_s", [0.001, 0.01])
def test_step_response_is_that_of_a_damped_spring(damping_ratio: float, step_s: float) -> None:
    """Below the limits, the motion is the closed form whatever the damping and the step's length."""
    joint = Joint(30.0, damping_ratio, 100.0, 3.0)
    states = moved(ArmModel(step_s, joints=[joint]), [0.5], 200, ArmState((0.0,), (0.0,)))
    for k, state in enumerate(states, start=1):
        assert state.positions[0] == pytest.approx(0.5 * step_response(joint, k * step_s), abs=1e-9)


@pytest.mark.parametrize("max_velocity", [0.5, 1.5])
def test_velocity_stays_within_the_scaled_limit(max_velocity: float) -> None:
    """A far target is approached at the rated speed times `max_velocity`, and no faster."""
    model = ArmModel(STEP_S, max_velocity)
    states = moved(model, [1.8] * JOINT_COUNT, 2000)
    for j, joint in enumerate(JOINTS):
        limit = joint.velocity_limit_rad_s * max_velocity
        positions = [state.positions[j] for state in states]
        speeds = [abs(b - a) / STEP_S for a, b in pairwise(positions)]
        assert max(speeds) == pytest.approx(limit)
        assert max(abs(state.velocities[j]) for state in states) <= limit
        assert positions[-1] == pytest.approx(1.8, abs=1e-6)


def test_position_stays_within_its_limit() -> None:
    """A target beyond the limit brings the joint to the limit, and never past it."""
    joint = Joint(30.0, 0.2, 100.0, 1.0)
    states = moved(ArmModel(STEP_S, joints=[joint]), [5.0], 400, ArmState((0.0,), (0.0,)))
    assert max(state.positions[0] for state in states) == 1.0
    assert states[-1].positions[0] == pytest.approx(1.0, abs=0.01)


def test_disabled_arm_holds_its_position() -> None:
    """With the brakes on, an arm in motion stops where it is and stays."""
    model = ArmModel(STEP_S)
    moving = moved(model, [1.0] * JOINT_COUNT, 20)[-1]
    held = model.step(model.step(moving, [1.0] * JOINT_COUNT, enabled=False), [0.3] * JOINT_COUNT, False)
    assert any(moving.velocities)
    assert held == ArmState(moving.positions, (0.0,) * JOINT_COUNT)


def test_arm_follows_the_labs_sinusoid_closely() -> None:
    """The lab's sinusoid of 0.3 rad at 0.3 Hz is followed within the lag that the servo's formula gives."""
    model = ArmModel(0.01)
    state, worst_rad = model.initial_state(0), 0.0
    lag_s = 2 * JOINTS[1].damping_ratio / JOINTS[1].natural_frequency_rad_s
    for k in range(1000):
        target = 0.3 * math.sin(2 * math.pi * 0.3 * k * 0.01)
        state = model.step(state, [0.0, target, *[0.0] * 5])
        worst_rad = max(worst_rad, abs(target - state.positions[1]))
    # The held target is newer than the state that it is compared with by up to a step.
    assert worst_rad <= 0.3 * 2 * math.pi * 0.3 * (lag_s + 0.01)


def test_initial_offsets_come_from_the_seed() -> None:
    """The same seed gives the same small offsets, another seed gives others, and no offset means zero."""
    model = ArmModel(STEP_S)
    assert model.initial_state(3, 0.05) == model.initial_state(3, 0.05) != model.initial_state(4, 0.05)
    assert max(map(abs, model.initial_state(3, 0.05).positions)) <= 0.05
    assert model.initial_state(3).positions == (0.0,) * JOINT_COUNT


@pytest.mark.parametrize(("step_s", "max_velocity"), [(0.0, 1.0), (0.01, 0.0), (float("nan"), 1.0)])
def test_step_and_velocity_must_be_positive(step_s: float, max_velocity: float) -> None:
    """A step or a velocity scale that is not a positive number is refused."""
    with pytest.raises(ValueError, match="positive"):
        ArmModel(step_s, max_velocity)
