"""Use that a controller may make of a navigated state, judged by its covariance.

An outage of measurements leaves a prediction. Its age says nothing about it: over a minute of
coast it is good to millimetres, over a minute of thrust that errs by 5 % to tens of metres. Its
covariance says which. So a state is tracked while its sigma is small against the distance to the
chief, so that an error of that size is no collision, and small in itself.

Beyond these bounds to do nothing is not safe: a deputy that coasts towards the chief passes it.
To remove the relative velocity is: on a prediction without bias, however poor, that leaves a
smaller velocity on average (see `significant_velocity`). What remains is an unknown drift of one
sigma, which over a long outage leads to the chief as well; so the deputy is left receding by two
(see `unsafe_velocity`).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray, is_finite, norm

__all__ = ["sigma_reason", "significant_velocity", "unsafe_velocity", "usable_covariance"]

SAFE_SIGMAS = 2.0
"""A deputy that is known poorly recedes from the chief by so many sigma of its velocity."""


def usable_covariance(values: npt.ArrayLike) -> FloatArray:
    """Return a covariance of a relative state, shape (6, 6).

    Raises
    ------
    ValueError
        If it has another shape, is not finite, or has a negative variance.
    """
    try:
        covariance = np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError("covariance: not numeric") from None
    if covariance.shape != (6, 6):
        raise ValueError(f"covariance: shape (6, 6) expected, got {covariance.shape}")
    if not is_finite(covariance):
        raise ValueError("covariance: not finite")
    if min(covariance.diagonal().tolist()) < 0.0:
        raise ValueError("covariance: a negative variance")
    return covariance


def sigma_reason(
    relative_state_rtn: FloatArray,
    covariance_rtn: FloatArray,
    maximum_sigma: float,
    maximum_sigma_ratio: float,
) -> str:
    """Judge whether a state is good enough to steer by.

    Parameters
    ----------
    relative_state_rtn
        Relative state, m and m/s, shape (6,).
    covariance_rtn
        Its covariance, shape (6, 6).
    maximum_sigma
        Largest sigma of the position in its worst direction, m.
    maximum_sigma_ratio
        Largest ratio of that sigma to the distance of the deputy from the chief.

    Returns
    -------
    str
        Empty if the state may be tracked, else one line that says why not.
    """
    separation = norm(relative_state_rtn[:3])
    worst = np.linalg.eigvalsh(covariance_rtn[:3, :3])[-1]
    sigma = float(np.sqrt(max(worst, 0.0)))
    if sigma > maximum_sigma:
        return f"sigma of the position is {sigma:.3g} m, more than {maximum_sigma:g} m"
    if sigma > maximum_sigma_ratio * separation:
        return (
            f"sigma of the position is {sigma:.3g} m, more than {maximum_sigma_ratio:g} of the "
            f"distance of {separation:.3g} m"
        )
    return ""


def significant_velocity(velocity_rtn: FloatArray, covariance_rtn: FloatArray) -> FloatArray:
    """Return the part of a relative velocity that stands out of its own uncertainty, m/s.

    The length is shortened by one sigma in the direction of the velocity, to zero if nothing is
    left. Given an honest estimate v with covariance P, a deputy that removes a part f v is left
    with the mean square velocity (1 - f)^2 v^2 + trace P, which is less than that of coasting for
    every f between 0 and 1. The last sigma costs fuel and hardly makes it smaller.

    Parameters
    ----------
    velocity_rtn
        m/s, shape (3,).
    covariance_rtn
        Covariance of the relative state, shape (6, 6).
    """
    speed = norm(velocity_rtn)
    if speed == 0.0:
        return velocity_rtn
    direction = velocity_rtn / speed
    variance = float(direction @ covariance_rtn[3:, 3:] @ direction)
    sigma = math.sqrt(max(variance, 0.0))
    return max(0.0, 1.0 - sigma / speed) * velocity_rtn


def unsafe_velocity(relative_state_rtn: FloatArray, covariance_rtn: FloatArray) -> FloatArray:
    """Return what a poorly known deputy has too much of relative velocity, m/s, shape (3,).

    Across the line of sight that is the velocity that stands out of its sigma; along it, the
    difference from a recession of `SAFE_SIGMAS` sigma. As the sigma of the position comes near to
    the distance from the chief, nobody knows on which side it is, and the recession goes to zero.

    Parameters
    ----------
    relative_state_rtn
        Relative state, m and m/s, shape (6,).
    covariance_rtn
        Its covariance, shape (6, 6).
    """
    separation = norm(relative_state_rtn[:3])
    worst = float(np.linalg.eigvalsh(covariance_rtn[:3, :3])[-1])
    certainty = 1.0 - math.sqrt(max(worst, 0.0)) / separation if separation > 0.0 else 0.0
    if certainty <= 0.0:
        return significant_velocity(relative_state_rtn[3:], covariance_rtn)
    sight = relative_state_rtn[:3] / separation
    along = float(sight @ relative_state_rtn[3:])
    across = relative_state_rtn[3:] - along * sight
    sigma = math.sqrt(max(float(sight @ covariance_rtn[3:, 3:] @ sight), 0.0))
    recession = SAFE_SIGMAS * certainty * sigma
    return (along - recession) * sight + significant_velocity(across, covariance_rtn)
