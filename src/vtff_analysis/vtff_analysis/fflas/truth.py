"""Nonlinear flight of a formation with thrust under the point mass and J2: the truth of plans."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

from vtff_dynamics.constants import GM_EARTH, J2_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn
from vtff_dynamics.vectors import FloatArray

__all__ = ["ThrustFlight", "fly_with_thrust"]

_RELATIVE_TOLERANCE = 1e-12
_ABSOLUTE_TOLERANCE = np.array([1e-6] * 3 + [1e-9] * 3)  # m, m/s


@dataclass(frozen=True, eq=False)
class ThrustFlight:
    """Flight of a reference orbit and m spacecraft.

    Attributes
    ----------
    times
        s, shape (k,).
    states_gcrf
        Reference first, then the spacecraft, m and m/s, shape (k, m + 1, 6).
    relative_states
        States of the spacecraft relative to the reference in RTN, m and m/s, shape (k, m, 6).
    """

    times: FloatArray
    states_gcrf: FloatArray
    relative_states: FloatArray


def fly_with_thrust(
    state_reference_gcrf: npt.ArrayLike,
    relative_states: npt.ArrayLike,
    accelerations_rtn: npt.ArrayLike,
    step: float,
    substeps: int = 6,
) -> ThrustFlight:
    """Fly spacecraft with thrust that is constant in the reference's RTN axes during each step.

    DOP853 of scipy with J2 as a gradient of the potential: neither the integration nor the force is
    the code of the plans.

    Parameters
    ----------
    state_reference_gcrf
        Initial state of the reference, which has no thrust, m and m/s, shape (6,).
    relative_states
        Initial relative states, m and m/s, shape (m, 6).
    accelerations_rtn
        Thrust, m/s2, shape (m, n, 3).
    step
        s.
    substeps
        Samples of the result in a step.
    """
    reference = np.asarray(state_reference_gcrf, dtype=float)
    thrust = np.asarray(accelerations_rtn, dtype=float)
    craft = [deputy_state_gcrf(reference, relative) for relative in np.asarray(relative_states)]
    states = np.array([reference, *craft])
    shape = states.shape
    flown, times = [states], [0.0]
    offsets = step / substeps * np.arange(1, substeps + 1)
    for index in range(thrust.shape[1]):

        def rate(_: float, flat: FloatArray, held: FloatArray = thrust[:, index]) -> FloatArray:
            return _rates(flat.reshape(shape), held).ravel()

        solution = solve_ivp(
            rate,
            (0.0, step),
            states.ravel(),
            method="DOP853",
            t_eval=offsets,
            rtol=_RELATIVE_TOLERANCE,
            atol=np.tile(_ABSOLUTE_TOLERANCE, len(states)),
        )
        stepped = solution.y.T.reshape(-1, *shape)
        flown.extend(stepped)
        times.extend(step * index + offsets)
        states = stepped[-1]
    everything = np.array(flown)
    relative = np.array(
        [[relative_state_rtn(moment[0], state) for state in moment[1:]] for moment in everything]
    )
    return ThrustFlight(np.array(times), everything, relative)


def _rates(states: FloatArray, thrust_rtn: FloatArray) -> FloatArray:
    """Return the rates of states (m + 1, 6), the first of which has no thrust."""
    position, velocity = states[:, :3], states[:, 3:]
    squared = (position**2).sum(axis=1, keepdims=True)
    sine_squared = position[:, 2:] ** 2 / squared
    pole = np.array([0.0, 0.0, 1.0])
    # Gradient of GM/r (1 - J2 (R/r)^2 (3 sin^2 - 1)/2).
    strength = 1.5 * J2_EARTH * GM_EARTH * RADIUS_EARTH_JGM3**2 / squared**2.5
    acceleration = -GM_EARTH / squared**1.5 * position + strength * (
        (5.0 * sine_squared - 1.0) * position - 2.0 * position[:, 2:] * pole
    )
    radial = position[0] / np.linalg.norm(position[0])
    normal = np.cross(position[0], velocity[0])
    normal = normal / np.linalg.norm(normal)
    acceleration[1:] += thrust_rtn @ np.array([radial, np.cross(normal, radial), normal])
    return np.hstack((velocity, acceleration))
