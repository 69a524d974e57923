"""Seven joints with second-order position servos: the mechanics of the simulated arm.

Pure: no ROS, no clock, no numpy. The same seed and the same targets give the same motion, bit for bit.

Each joint is a servo that follows its target like a damped spring,

    q'' = ω² (r − q) − 2 ζ ω q'

with position q, target r, natural frequency ω and damping ratio ζ. For a target held over a step
(zero-order hold) this linear equation is solved exactly, so the step's length does not change the
motion; velocity and position limits are applied at the end of each step.
"""

from __future__ import annotations

import cmath
import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

JOINT_COUNT = 7


@dataclass(frozen=True)
class Joint:
    """The constants of one joint.

    Attributes
    ----------
    natural_frequency_rad_s : float
        ω: how fast the servo is.
    damping_ratio : float
        ζ: 1 is critical; below it the joint overshoots.
    velocity_limit_rad_s : float
        Rated speed; multiplied by the arm's `max_velocity`.
    position_limit_rad : float
        The joint stays within plus and minus this.
    """

    natural_frequency_rad_s: float
    damping_ratio: float
    velocity_limit_rad_s: float
    position_limit_rad: float


# A made-up arm: slow strong joints at the base, quick ones at the wrist. At the lowest ω the lag behind
# a slow target is 2ζ/ω = 0.06 s, so a sinusoid of 0.5 rad at 0.2 Hz is followed within 0.04 rad.
JOINTS = (
    Joint(30.0, 0.9, 2.0, 2.9),
    Joint(30.0, 0.9, 2.0, 1.9),
    Joint(35.0, 0.9, 2.0, 2.9),
    Joint(35.0, 0.9, 2.0, 2.4),
    Joint(45.0, 0.9, 2.5, 2.9),
    Joint(45.0, 0.9, 2.5, 2.0),
    Joint(45.0, 0.9, 2.5, 2.9),
)


@dataclass(frozen=True)
class ArmState:
    """Positions (rad) and velocities (rad/s) of all joints."""

    positions: tuple[float, ...]
    velocities: tuple[float, ...]


@dataclass(frozen=True)
class _Transition:
    """One joint over one step: the matrix that takes (q − r, q') to its next value, and the limits."""

    error_from_error: float
    error_from_velocity: float
    velocity_from_error: float
    velocity_from_velocity: float
    velocity_limit_rad_s: float
    position_limit_rad: float


def _transition(joint: Joint, max_velocity: float, step_s: float) -> _Transition:
    """Give exp(A·T) of the servo, with A = [[0, 1], [−ω², −2ζω]] and T the step.

    Notes
    -----
    With σ = ω·sqrt(ζ² − 1), real or imaginary, C = cosh(σT) and S = sinh(σT)/σ (T for σ = 0):

        exp(A·T) = exp(−ζωT) · [[C + ζωS, S], [−ω²S, C − ζωS]]

    which is real for every ζ, so one formula serves under-, over- and critically damped joints.

    References
    ----------
    K. J. Åström and B. Wittenmark, "Computer-Controlled Systems", 3rd ed., 1997, section 2.3
    (zero-order-hold sampling of a continuous system).
    """
    omega, decay = joint.natural_frequency_rad_s, joint.damping_ratio * joint.natural_frequency_rad_s
    sigma = omega * cmath.sqrt(joint.damping_ratio**2 - 1.0)
    c = cmath.cosh(sigma * step_s).real
    s = (cmath.sinh(sigma * step_s) / sigma).real if abs(sigma) * step_s > 1e-9 else step_s
    shrink = math.exp(-decay * step_s)
    return _Transition(
        error_from_error=shrink * (c + decay * s),
        error_from_velocity=shrink * s,
        velocity_from_error=-shrink * omega * omega * s,
        velocity_from_velocity=shrink * (c - decay * s),
        velocity_limit_rad_s=joint.velocity_limit_rad_s * max_velocity,
        position_limit_rad=joint.position_limit_rad,
    )


def _clip(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


def _step_joint(t: _Transition, step_s: float, q: float, v: float, target: float) -> tuple[float, float]:
    """Give the joint's position and velocity after one step."""
    error = q - _clip(target, t.position_limit_rad)
    free_motion = t.error_from_error * error + t.error_from_velocity * v - error
    free_velocity = t.velocity_from_error * error + t.velocity_from_velocity * v
    position = q + _clip(free_motion, t.velocity_limit_rad_s * step_s)
    velocity = _clip(free_velocity, t.velocity_limit_rad_s)
    stopped = _clip(position, t.position_limit_rad)
    return stopped, (velocity if stopped == position else 0.0)


class ArmModel:
    """The arm's motion at a fixed step.

    Parameters
    ----------
    step_s : float
        Length of a step.
    max_velocity : float
        Scales the velocity limits of all joints.
    joints : sequence of Joint
        Constants of the joints.

    Raises
    ------
    ValueError
        If the step or `max_velocity` is not positive.
    """

    def __init__(self, step_s: float, max_velocity: float = 1.0, joints: Sequence[Joint] = JOINTS) -> None:
        if not step_s > 0 or not max_velocity > 0:
            raise ValueError("the step and max_velocity must be positive numbers")
        self.step_s = step_s
        self.joints = tuple(joints)
        self._transitions = tuple(_transition(joint, max_velocity, step_s) for joint in joints)

    def initial_state(self, seed: int, offset_rad: float = 0.0) -> ArmState:
        """Give the arm at rest, each joint at most `offset_rad` away from zero, drawn from the seed."""
        draw = random.Random(f"arm {seed}")
        positions = tuple(draw.uniform(-offset_rad, offset_rad) for _ in self.joints)
        return ArmState(positions, (0.0,) * len(self.joints))

    def step(self, state: ArmState, targets: Sequence[float], enabled: bool = True) -> ArmState:
        """Give the state one step later.

        Parameters
        ----------
        state : ArmState
            Where the arm is.
        targets : sequence of float
            Finite target of each joint (rad), held over the step; clipped to the position limits.
        enabled : bool
            If false the brakes are on: the position is held and the velocity is zero.
        """
        if not enabled:
            return ArmState(state.positions, (0.0,) * len(self.joints))
        moved = [
            _step_joint(t, self.step_s, q, v, r)
            for t, q, v, r in zip(self._transitions, state.positions, state.velocities, targets, strict=True)
        ]
        return ArmState(tuple(q for q, _ in moved), tuple(v for _, v in moved))
