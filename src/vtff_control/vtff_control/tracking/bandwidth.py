"""How fast a formation is to be held, by how well its state is known.

A deviation that is smaller than the error of navigation is not worth thrust. Bryson's rule (Bryson
and Ho 1975, Applied Optimal Control, section 5.2) weighs a state with the inverse square of the
deviation that is tolerated, so the weight of the position is

    Q = Q0 s0^2 / (s0^2 + sigma^2)

with s0 the deviation that is tolerated with perfect navigation. The bandwidth of the loop is the
fourth root of Q / R: it falls with the square root of sigma. Errors of navigation with correlation
time tau cause an acceleration of the order sigma bandwidth^1.5 tau^-0.5 (bandwidth tau > 1) or
sigma bandwidth^2.5 tau^0.5 (below), so that the fuel spent on noise hardly depends on sigma.

Deviations that stand out are removed faster, in proportion, up to the bandwidth of the design, and
a deputy in motion is never held by a loop that could not stop it before the target or the chief.
"""

from __future__ import annotations

import math

from vtff_control.tracking.riccati import Weights
from vtff_dynamics.vectors import FloatArray

__all__ = ["LEVELS_PER_OCTAVE", "BandwidthSchedule", "weights_at_level"]

LEVELS_PER_OCTAVE = 4
"""Bandwidths are those of the design times 2^(-level / 4), so that a run solves few gains."""

LOWEST_LEVEL = 28
"""1/128 of the bandwidth of the design: below the orbital rate for 0.1 rad/s in low orbit."""

SIGNIFICANCE = 3.0
"""Deviations above so many sigma are removed faster."""

_HYSTERESIS = 0.75
"""A level is kept until the wanted one is that far away."""


def weights_at_level(weights: Weights, level: int) -> Weights:
    """Return the weights for a level of the bandwidth, with the damping of the design."""
    if level == 0:
        return weights
    ratio = 2.0 ** (-level / LEVELS_PER_OCTAVE)
    return Weights(weights.position * ratio**4, weights.velocity * ratio**2, weights.control)


class BandwidthSchedule:
    """Level of the bandwidth for each sample: 0 is that of the design, each further one slower.

    Parameters
    ----------
    bandwidth
        Bandwidth of the design, rad/s.
    tolerated_deviation
        Deviation of the position that is tolerated with perfect navigation, m.
    """

    def __init__(self, bandwidth: float, tolerated_deviation: float) -> None:
        self._bandwidth = bandwidth
        self._tolerated = tolerated_deviation
        self._level = 0

    def update(
        self, relative_state_rtn: FloatArray, deviation_rtn: FloatArray, covariance_rtn: FloatArray
    ) -> int:
        """Return the level for a state.

        Parameters
        ----------
        relative_state_rtn, deviation_rtn
            Relative state and its difference from the target, m and m/s, shape (6,).
        covariance_rtn
            Covariance of the relative state as navigation gives it, shape (6, 6).
        """
        wanted = LEVELS_PER_OCTAVE * math.log2(
            self._bandwidth / self._wanted(relative_state_rtn, deviation_rtn, covariance_rtn)
        )
        if abs(wanted - self._level) > _HYSTERESIS:
            self._level = min(max(round(wanted), 0), LOWEST_LEVEL)
        return self._level

    def _wanted(
        self, relative_state: FloatArray, deviation: FloatArray, covariance: FloatArray
    ) -> float:
        # Numbers one by one: operations on arrays of three take three times as long.
        a, b, c, d, e, f = covariance.diagonal().tolist()
        sigma = math.hypot(self._tolerated, math.sqrt((a + b + c) / 3.0))
        keeping = self._bandwidth * math.sqrt(self._tolerated / sigma)
        velocity_sigma = math.sqrt(d + e + f)
        x, y, z, vx, vy, vz = deviation.tolist()
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        velocity = max(0.0, speed - 2.0 * velocity_sigma)
        limit = SIGNIFICANCE * math.sqrt(3.0) * sigma
        distance = math.sqrt(x * x + y * y + z * z)
        by_position = keeping * distance / limit
        # A slower loop could not stop within the distance that is left.
        by_velocity = velocity / max(distance, limit)
        x, y, z, vx, vy, vz = relative_state.tolist()
        separation = math.sqrt(x * x + y * y + z * z)
        closing = max(0.0, -(x * vx + y * vy + z * vz))
        by_approach = 2.0 * closing / (separation * separation) if separation > 0.0 else 0.0
        return min(self._bandwidth, max(keeping, by_position, by_velocity, by_approach))
