"""Probability that two spacecraft come closer than a radius.

Two measures, of which `vtff_control.safety.prediction` takes the larger. The *instantaneous* one is
the probability that a Gaussian relative position lies in the sphere at one moment; its largest
value over time is meaningful for slow motion, where two spacecraft of a formation stay near each
other for long. The *short encounter* one is that of a straight fly-by, integrated over the plane
across the relative velocity (Foster); it counts everything that happens within the fly-by.

References
----------
Foster and Estes (1992), A Parametric Analysis of Orbital Debris Collision Probability, NASA
JSC-25898; Chan (2008), Spacecraft Collision Probability, chapters 3 and 4.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from vtff_dynamics.vectors import FloatArray

__all__ = ["encounter_probability", "instantaneous_probability", "sigma_bound_probability"]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
_REACH = 7.0  # sigma beyond which a Gaussian is empty
_SMALLEST_SIGMA = 1e-6  # m


def sigma_bound_probability(sigmas: float) -> float:
    """Return the probability beyond a plane at so many sigma, which bounds that of any sphere."""
    return float(ndtr(-sigmas))


def instantaneous_probability(
    position: npt.ArrayLike, covariance: npt.ArrayLike, radius: float
) -> float:
    """Return the probability that a relative position lies within a sphere about zero.

    Parameters
    ----------
    position
        Expected relative position, m, shape (3,).
    covariance
        Its covariance, m2, shape (3, 3).
    radius
        m.
    """
    mean, sigma = _principal(np.asarray(position, dtype=float), covariance)
    # The density is integrated along the two wider axes, and in closed form along the third.
    first, first_weights = _line(mean[2], sigma[2], np.array(radius))
    second, second_weights = _line(mean[1], sigma[1], np.sqrt(radius**2 - first**2))
    half = np.sqrt(np.maximum(radius**2 - first[:, np.newaxis] ** 2 - second**2, 0.0))
    inner = ndtr((half - mean[0]) / sigma[0]) - ndtr((-half - mean[0]) / sigma[0])
    return float(first_weights @ (second_weights * inner).sum(axis=-1))


def encounter_probability(
    position: npt.ArrayLike, velocity: npt.ArrayLike, covariance: npt.ArrayLike, radius: float
) -> float:
    """Return the probability that a straight fly-by comes closer than a radius.

    Parameters
    ----------
    position, velocity
        Relative state at the closest approach, m and m/s, shapes (3,).
    covariance
        Covariance of the position there, m2, shape (3, 3).
    radius
        m.

    Raises
    ------
    ValueError
        If the velocity is zero: there is no fly-by.
    """
    direction = np.asarray(velocity, dtype=float)
    speed = float(np.linalg.norm(direction))
    if not speed > 0.0:
        raise ValueError("velocity: not zero expected")
    _, _, axes = np.linalg.svd(direction[np.newaxis] / speed)
    plane = axes[1:]
    projected = plane @ np.asarray(covariance, dtype=float) @ plane.T
    mean, sigma = _principal(plane @ np.asarray(position, dtype=float), projected)
    points, weights = _line(mean[1], sigma[1], np.array(radius))
    half = np.sqrt(np.maximum(radius**2 - points**2, 0.0))
    inner = ndtr((half - mean[0]) / sigma[0]) - ndtr((-half - mean[0]) / sigma[0])
    return float(weights @ inner)


def _principal(position: FloatArray, covariance: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the mean along the principal axes, and their sigmas, the smallest first."""
    variances, axes = np.linalg.eigh(np.asarray(covariance, dtype=float))
    sigma = np.sqrt(np.maximum(variances, _SMALLEST_SIGMA**2))
    return axes.T @ position, sigma


def _line(mean: float, sigma: float, half: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points and weights for a Gaussian density on [-half, half], shape (..., nodes)."""
    low = np.maximum(-half, mean - _REACH * sigma)
    high = np.minimum(half, mean + _REACH * sigma)
    width = 0.5 * np.maximum(high - low, 0.0)[..., np.newaxis]
    points = 0.5 * (high + low)[..., np.newaxis] + width * _NODES
    density = np.exp(-0.5 * ((points - mean) / sigma) ** 2) / (sigma * math.sqrt(2.0 * math.pi))
    inside = np.clip(points, -half[..., np.newaxis], half[..., np.newaxis])
    return inside, width * _WEIGHTS * density
