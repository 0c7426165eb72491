"""Relative motion linearised about a flown reference orbit, in steps of constant thrust.

The reference orbit and twelve neighbours fly under the point mass and J2; their central differences
are the transition of relative states. So the model has the J2 and the eccentricity of the orbit in
it, and its only error is of the second order in the distance over the radius: about 1 mm in an
orbit for a formation of 30 m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import GM_EARTH, J2_EARTH
from vtff_dynamics.frames.rtn import angular_velocity_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.vectors import FloatArray, norm

__all__ = ["LinearisedMotion", "linearise_motion"]

_OFFSET = 100.0  # m; third-order terms of the differences stay below 1e-6 over two orbits
_LONGEST_SUBSTEP = 12.0  # s


@dataclass(frozen=True, eq=False)
class LinearisedMotion:
    """Relative motion about a reference orbit over n steps of equal length.

    Relative states are RTN positions (m) and rotating-frame velocities (m/s) as in
    `vtff_dynamics.frames.rtn.relative_state_rtn`; thrust is constant in RTN during a step.

    Attributes
    ----------
    step
        Length of a step, s.
    states_reference_gcrf
        Reference orbit at the ends of the steps, m and m/s, shape (n + 1, 6).
    transitions
        Over each step, shape (n, 6, 6).
    effects
        Relative state at the end of a step by 1 m/s2 during it, shape (n, 6, 3).
    within_transitions, within_effects
        The same from the start of the step to the ends of its m substeps, of which the last is the
        end of the step, shapes (n, m, 6, 6) and (n, m, 6, 3).
    from_start
        Transition from the beginning to the ends of the steps, shape (n + 1, 6, 6).
    """

    step: float
    states_reference_gcrf: FloatArray
    transitions: FloatArray
    effects: FloatArray
    within_transitions: FloatArray
    within_effects: FloatArray
    from_start: FloatArray

    @property
    def count(self) -> int:
        """Number of steps."""
        return len(self.transitions)

    def first(self, count: int) -> LinearisedMotion:
        """Return the first steps alone."""
        return LinearisedMotion(
            self.step,
            self.states_reference_gcrf[: count + 1],
            self.transitions[:count],
            self.effects[:count],
            self.within_transitions[:count],
            self.within_effects[:count],
            self.from_start[: count + 1],
        )

    def fly(self, states: npt.ArrayLike, accelerations: npt.ArrayLike) -> FloatArray:
        """Return relative states at the ends of the steps.

        Parameters
        ----------
        states
            Initial relative states of m spacecraft, shape (m, 6).
        accelerations
            Thrust in RTN, m/s2, shape (m, k, 3) with k up to n.

        Returns
        -------
        ndarray, shape (m, k + 1, 6)
        """
        thrust = np.asarray(accelerations, dtype=float)
        flown = np.empty((len(thrust), thrust.shape[1] + 1, 6))
        flown[:, 0] = states
        for index in range(thrust.shape[1]):
            flown[:, index + 1] = (
                flown[:, index] @ self.transitions[index].T
                + thrust[:, index] @ self.effects[index].T
            )
        return flown

    def fly_within(self, states: npt.ArrayLike, accelerations: npt.ArrayLike) -> FloatArray:
        """Return relative positions (m) at the start and at the end of every substep.

        Parameters
        ----------
        states, accelerations
            As in `fly`, with k = n.

        Returns
        -------
        ndarray, shape (m, n, substeps + 1, 3)
            The first position of a step is the last one of the step before.
        """
        thrust = np.asarray(accelerations, dtype=float)
        at_steps = self.fly(states, thrust)[:, :-1]
        inside = np.einsum("nsij,cnj->cnsi", self.within_transitions[:, :, :3], at_steps)
        inside += np.einsum("nsij,cnj->cnsi", self.within_effects[:, :, :3], thrust)
        return np.concatenate((at_steps[:, :, np.newaxis, :3], inside), axis=2)


def linearise_motion(
    state_reference_gcrf: npt.ArrayLike, step: float, count: int, j2: float = J2_EARTH
) -> LinearisedMotion:
    """Return the relative motion about the free flight of a reference.

    Parameters
    ----------
    state_reference_gcrf
        Position and velocity at the start, m and m/s, shape (6,).
    step
        Length of a step, s.
    count
        Number of steps.
    j2
        Second zonal coefficient.

    Raises
    ------
    ValueError
        If the step is not positive or there is none.
    """
    if not (math.isfinite(step) and step > 0.0 and count > 0):
        raise ValueError(f"step, count: positive numbers expected, got {step:g} s and {count}")
    reference = np.asarray(state_reference_gcrf, dtype=float)
    # An even number of substeps, for Simpson's rule.
    substeps = 2 * max(1, math.ceil(0.5 * step / _LONGEST_SUBSTEP))
    times = step / substeps * np.arange(substeps * count + 1)
    mean_motion = math.sqrt(GM_EARTH / norm(reference[:3]) ** 3)
    scale = np.array([1.0, 1.0, 1.0, mean_motion, mean_motion, mean_motion])
    offsets = _OFFSET * np.diag(scale)
    flown = free_flight(np.vstack((reference, reference + offsets, reference - offsets)), times, j2)
    # Columns: derivative of the state by each component of the first one, times that one's scale.
    inertial = np.swapaxes(flown[:, 1:7] - flown[:, 7:13], 1, 2) / (2.0 * _OFFSET)
    to_rtn = np.array([_relative_matrix(state) for state in flown[:, 0]])
    # Scaled on both sides, so that the inverse is well conditioned.
    carried = to_rtn @ inertial / scale[:, np.newaxis]
    inverse = np.linalg.inv(carried)
    spread = scale[:, np.newaxis] / scale

    begins = substeps * np.arange(count)
    within = np.empty((count, substeps, 6, 6))
    for inner in range(substeps):
        within[:, inner] = spread * (carried[begins + inner + 1] @ inverse[begins])
    effects = np.empty((count, substeps, 6, 3))
    to_inner = np.empty((count, substeps + 1, 6, 3))
    for inner in range(substeps):
        # Effect at the end of this substep of a unit velocity change at each earlier instant.
        for earlier in range(inner + 2):
            to_inner[:, earlier] = (
                spread * (carried[begins + inner + 1] @ inverse[begins + earlier])
            )[:, :, 3:]
        effects[:, inner] = _integrate(to_inner[:, : inner + 2], step / substeps)
    ends = substeps * np.arange(count + 1)
    return LinearisedMotion(
        step,
        flown[ends, 0],
        within[:, -1],
        effects[:, -1],
        within,
        effects,
        spread * (carried[ends] @ inverse[0]),
    )


def _integrate(values: FloatArray, spacing: float) -> FloatArray:
    """Return the integral over the second axis by Simpson's rule, the last odd interval by 3/8."""
    count = values.shape[1] - 1
    if count == 1:
        # One substep: the trapezoid is exact enough for a position within a step.
        return 0.5 * spacing * (values[:, 0] + values[:, 1])
    weights = np.zeros(count + 1)
    even = count if count % 2 == 0 else count - 3
    for index in range(0, even, 2):
        weights[index : index + 3] += np.array([1.0, 4.0, 1.0]) / 3.0
    if even != count:
        weights[even:] += np.array([3.0, 9.0, 9.0, 3.0]) / 8.0
    integral: FloatArray = spacing * np.einsum("k,nkij->nij", weights, values)
    return integral


def _relative_matrix(state_gcrf: FloatArray) -> FloatArray:
    """Return the matrix (6, 6) from differences of states in GCRF to relative states in RTN."""
    rotation = rotation_gcrf_to_rtn(state_gcrf)
    x, y, z = angular_velocity_rtn(state_gcrf).tolist()
    turn = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = rotation
    matrix[3:, :3] = -turn @ rotation
    return matrix
