"""Pointing with a wheel on the pitch axis: pitch by the wheel, the rest by torquers.

The wheel turns the body about its axis and gives it gyroscopic stiffness; torquers damp nutation,
keep the momentum of the wheel, and (beyond the paper) bring the whole angular momentum to the orbit
normal. A torque of torquers is always across the field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.attitude.orbit_axes import orbit_rate, roll_pitch_yaw, rotation_gcrf_to_orbit
from vtff_dynamics.vectors import FloatArray, cross, norm

__all__ = [
    "MomentumGains",
    "PitchGains",
    "PointingErrors",
    "momentum_moment",
    "pitch_to_target",
    "pitch_wheel_torque",
    "pointing_errors",
]


@dataclass(frozen=True)
class PointingErrors:
    """Attitude against the orbit axes.

    Attributes
    ----------
    angles
        Roll, pitch and yaw, rad, shape (3,).
    rate_body
        Rate against the orbit axes, rad/s, body axes, shape (3,).
    rotation_body_from_orbit
        Rotation matrix, shape (3, 3).
    orbit_rate
        rad/s.
    """

    angles: FloatArray
    rate_body: FloatArray
    rotation_body_from_orbit: FloatArray
    orbit_rate: float


def pointing_errors(
    rotation_gcrf_from_body: FloatArray, rate_body: FloatArray, state_gcrf: FloatArray
) -> PointingErrors:
    """Return the angles and rates of a body against the orbit axes of a state (6,)."""
    orbit = rotation_gcrf_to_orbit(state_gcrf)
    body_from_orbit = rotation_gcrf_from_body.T @ orbit.T
    speed = orbit_rate(state_gcrf)
    relative = rate_body + speed * body_from_orbit[:, 1]
    return PointingErrors(roll_pitch_yaw(body_from_orbit), relative, body_from_orbit, speed)


@dataclass(frozen=True)
class PitchGains:
    """Gains of the wheel for a body on its pitch axis, sampled and held.

    Attributes
    ----------
    angle
        1/s2.
    rate
        1/s.
    """

    angle: float
    rate: float

    @staticmethod
    def for_settling_time(
        settling_time: float, period: float, damping: float = math.sqrt(0.5)
    ) -> PitchGains:
        """Return the gains of a settling time to 2 %, s, for a period of the ADCS, s.

        The poles of the sampled loop are those of the continuous one (pole placement).

        Raises
        ------
        ValueError
            If the loop cannot be that fast.
        """
        if not 0.0 < damping < 1.0:
            raise ValueError(f"damping: expected between 0 and 1; got {damping}")
        frequency = _settling_of_unit_frequency(damping) / settling_time
        if not 0.0 < frequency * period < 0.7:
            raise ValueError(
                f"settling_time: at least {_settling_of_unit_frequency(damping) * period / 0.7:.1f}"
                f" s expected with a period of {period:g} s; got {settling_time:g} s"
            )
        shrink = math.exp(-damping * frequency * period)
        total = 2.0 * shrink * math.cos(frequency * period * math.sqrt(1.0 - damping**2))
        product = shrink**2
        return PitchGains(
            (1.0 - total + product) / period**2, (3.0 - total - product) / (2 * period)
        )


def _settling_of_unit_frequency(damping: float) -> float:
    """Return the time after which an oscillator of 1 rad/s released at 1 stays below 2 %."""
    times = np.linspace(0.0, 12.0 / damping, 40001)
    damped = math.sqrt(1.0 - damping**2)
    motion = np.exp(-damping * times) * (
        np.cos(damped * times) + damping / damped * np.sin(damped * times)
    )
    return float(times[np.nonzero(np.abs(motion) > 0.02)[0][-1] + 1])


def pitch_wheel_torque(
    angle_error: float, rate_error: float, inertia: float, gains: PitchGains, largest: float
) -> float:
    """Return the torque on the wheel that removes a pitch error, N m; the body gets the opposite.

    Parameters
    ----------
    angle_error, rate_error : float
        rad, rad/s.
    inertia : float
        Moment of inertia of the body about the axis of the wheel, kg m2.
    gains : PitchGains
    largest : float
        Limit, N m.
    """
    torque = inertia * (gains.angle * angle_error + gains.rate * rate_error)
    return min(max(torque, -largest), largest)


@dataclass(frozen=True)
class MomentumGains:
    """Gains of the torquers: torque over what is wrong.

    Parameters
    ----------
    nutation : float
        Gain on the rate about x and z, 1/s (times the inertia).
    wheel : float
        Gain on the error of the wheel's momentum, 1/s.
    direction : float
        Gain on the angular momentum across the orbit normal, 1/s. The paper's law has none.
    """

    nutation: float = 3e-2
    wheel: float = 3e-3
    direction: float = 1e-3


def momentum_moment(
    errors: PointingErrors,
    inertia: FloatArray,
    wheel_momentum: float,
    wheel_reference: float,
    wheel_axis: FloatArray,
    field_body: FloatArray,
    gains: MomentumGains,
) -> FloatArray:
    """Return the moment of the cross-product law, A m2, shape (3,): M = B x N / B^2.

    N is the wanted torque against nutation, momentum of the wheel and direction of the whole
    momentum; of it the part across the field results.

    Parameters
    ----------
    errors : PointingErrors
    inertia : ndarray, shape (3, 3)
        kg m2.
    wheel_momentum, wheel_reference : float
        N m s.
    wheel_axis, field_body : ndarray, shape (3,)
        Axis of the wheel; field, T.
    """
    across = errors.rate_body - wheel_axis * float(wheel_axis @ errors.rate_body)
    wanted = -gains.nutation * (inertia @ across)
    wanted = wanted - gains.wheel * (wheel_momentum - wheel_reference) * wheel_axis
    if gains.direction > 0.0:
        # The spin axis shall be along -normal of the orbit, which is y of the orbit axes.
        normal = errors.rotation_body_from_orbit[:, 1]
        momentum = (
            inertia @ (errors.rate_body - errors.orbit_rate * normal) + wheel_momentum * wheel_axis
        )
        goal = math.copysign(1.0, wheel_reference) * normal
        wanted = wanted + gains.direction * _turn_towards(goal, momentum)
    square = float(field_body @ field_body)
    return cross(field_body, wanted) / square


def _turn_towards(goal: FloatArray, momentum: FloatArray) -> FloatArray:
    """Return the change that turns a momentum to a direction, N m s, shape (3,).

    It is across the momentum, with the sine of the angle up to 90 deg and in full beyond: a law
    that takes away what is across the goal holds a momentum that is opposite to it.
    """
    size = norm(momentum)
    if not size > 0.0:
        return np.zeros(3)
    cosine = float(goal @ momentum) / size
    turn = goal * size - cosine * momentum
    sine = norm(turn) / size
    return turn / sine if cosine < 0.0 and sine > 0.0 else turn


def pitch_to_target(target_gcrf: FloatArray, state_gcrf: FloatArray) -> tuple[float, float]:
    """Return pitch and roll at which the z axis of the body looks at a target, rad.

    With one wheel the pitch is commanded; the roll is what the camera misses the target by, across
    the track.

    Parameters
    ----------
    target_gcrf : ndarray, shape (3,)
        Position of the target, m.
    state_gcrf : ndarray, shape (6,)
        Position and velocity, m and m/s.

    Raises
    ------
    ValueError
        If the target is not in view: behind the Earth's limb.
    """
    line = rotation_gcrf_to_orbit(state_gcrf) @ (target_gcrf - state_gcrf[:3])
    if float(target_gcrf @ (state_gcrf[:3] - target_gcrf)) <= 0.0:
        raise ValueError("target: below the horizon of the spacecraft")
    return math.atan2(line[0], line[2]), math.atan2(-line[1], math.hypot(line[0], line[2]))
