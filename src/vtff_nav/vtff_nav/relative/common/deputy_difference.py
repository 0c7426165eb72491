"""The state of one deputy relative to another, from the filters of both.

Each filter estimates its deputy less the chief, so that both use the observations of the chief's
receiver, and the chief's errors cancel in the difference. With equal and independent receivers half
of the variance of each filter is the chief's; the two states then correlate by one half, and the
difference is as good as either of them.

In single flights of minutes the errors, which are slow, correlate by anything from none to 0.9.
Over twenty flights (`benchmarks/bench_deputies.py`) they do by 0.3 to 0.7 on each axis, 0.5 in the
mean.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray

__all__ = ["CHIEF_SHARE", "difference_of_deputies"]

CHIEF_SHARE = 0.5
"""Part of the variance of a relative state that the receiver of the chief has, if all are equal."""


def difference_of_deputies(
    first: npt.ArrayLike,
    second: npt.ArrayLike,
    covariance_first: npt.ArrayLike,
    covariance_second: npt.ArrayLike,
    chief_share: float = CHIEF_SHARE,
) -> tuple[FloatArray, FloatArray]:
    """Return the second deputy less the first, and its covariance.

    The covariance of the two states is `chief_share` of the covariance of the better one, because
    what the chief contributes to both is the same: a deputy with a worse receiver adds nothing to
    it. With the mean of both instead, the difference to a receiver with twice the noise is stated
    a third too well. With `chief_share` 0 they are independent, which
    is the upper bound.

    Parameters
    ----------
    first, second : array_like, shape (..., n)
        States relative to the chief, in the same axes: position (m), or position and velocity.
    covariance_first, covariance_second : array_like, shape (..., n, n)
    chief_share : float
        From 0 to 0.5.

    Returns
    -------
    tuple of ndarray, shapes (..., n) and (..., n, n)

    Raises
    ------
    ValueError
        If the shapes do not fit, or the share is out of range.
    """
    states = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    covariances = (
        np.asarray(covariance_first, dtype=float),
        np.asarray(covariance_second, dtype=float),
    )
    shape = states[0].shape
    if states[1].shape != shape or any(c.shape != (*shape, shape[-1]) for c in covariances):
        raise ValueError("difference_of_deputies: states (..., n) and covariances (..., n, n)")
    if not 0.0 <= chief_share <= 0.5:
        raise ValueError(f"chief_share: 0 to 0.5 expected, got {chief_share}")
    traces = [np.trace(c, axis1=-2, axis2=-1)[..., np.newaxis, np.newaxis] for c in covariances]
    shared = chief_share * np.where(traces[0] <= traces[1], covariances[0], covariances[1])
    return states[1] - states[0], covariances[0] + covariances[1] - 2.0 * shared
