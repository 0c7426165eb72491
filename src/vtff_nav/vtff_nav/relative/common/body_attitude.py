"""Estimated attitudes of the spacecraft, as the lever arms of their antennas need them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vtff_dynamics.attitude.quaternion import (
    check_quaternion,
    conjugate,
    multiply,
    rotation_matrix,
    rotation_vector,
    turned_at_rate,
)
from vtff_dynamics.checks import check_vector
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = ["BodyAttitude"]

_ROUNDING = 1e-6  # of a covariance, as a share of its trace


@dataclass(frozen=True, eq=False)
class BodyAttitude:
    """Attitude of a spacecraft that an estimator found.

    Parameters
    ----------
    time : GpsTime
        Time at which it holds.
    quaternion_gcrf : array_like, shape (4,)
        Body to GCRF, x, y, z, w.
    rate_body : array_like, shape (3,)
        Rate against GCRF, rad/s, body axes; the attitude of another time follows from it.
    covariance : array_like, shape (3, 3)
        Covariance of the small rotation, in body axes, by which the true attitude differs, rad2.
    correction : array_like, shape (3,), optional
        Small rotation by which measurements have turned the attitude that was predicted from the
        estimate before this one, rad, body axes; nan where that is not known.

    Raises
    ------
    ValueError
        One line that names what is wrong.
    """

    time: GpsTime
    quaternion_gcrf: FloatArray
    rate_body: FloatArray
    covariance: FloatArray
    correction: FloatArray = field(default_factory=lambda: np.full(3, np.nan))

    def __post_init__(self) -> None:
        """Check the values and turn them into arrays."""
        quaternion = check_quaternion("quaternion_gcrf", self.quaternion_gcrf)
        object.__setattr__(self, "quaternion_gcrf", quaternion)
        object.__setattr__(self, "rate_body", check_vector("rate_body", self.rate_body, 3, "rad/s"))
        correction = np.array(self.correction, dtype=float)
        if correction.shape != (3,):
            raise ValueError("correction: three numbers (rad) expected")
        object.__setattr__(self, "correction", correction)
        covariance = np.array(self.covariance, dtype=float)
        is_finite = covariance.shape == (3, 3) and bool(np.isfinite(covariance).all())
        if not is_finite or np.diagonal(covariance).min() < 0.0:
            raise ValueError(
                "covariance: 3 x 3 finite numbers (rad2), variances 0 or more, expected"
            )
        rounding = _ROUNDING * float(np.trace(covariance))
        is_symmetric = np.abs(covariance - covariance.T).max() <= rounding
        if not is_symmetric or np.linalg.eigvalsh(covariance)[0] < -rounding:
            raise ValueError("covariance: symmetric, no correlation beyond 1, expected")
        object.__setattr__(self, "covariance", 0.5 * (covariance + covariance.T))

    def rotation_gcrf_from_body(self, time: GpsTime) -> FloatArray:
        """Return the rotation R with ``vector_gcrf = R @ vector_body`` at a time, shape (3, 3)."""
        turned = turned_at_rate(self.quaternion_gcrf, self.rate_body, time - self.time)
        rotation: FloatArray = rotation_matrix(turned)
        return rotation

    def turn_from(self, before: BodyAttitude, time: GpsTime) -> FloatArray:
        """Return the small rotation from another estimate to this one at a time, rad, body axes.

        It stands for the correction of an estimator that tells none.
        The rate between both estimates is the mean of theirs: with that of the earlier one alone a
        body that turns about two axes seems to turn by 1e-5 rad more in 5 s, and always to the same
        side.
        """
        mean_rate = 0.5 * (before.rate_body + self.rate_body)
        expected = turned_at_rate(before.quaternion_gcrf, mean_rate, self.time - before.time)
        first, second = (
            turned_at_rate(quaternion, self.rate_body, time - self.time)
            for quaternion in (expected, self.quaternion_gcrf)
        )
        turn: FloatArray = rotation_vector(multiply(conjugate(first), second))
        return turn
