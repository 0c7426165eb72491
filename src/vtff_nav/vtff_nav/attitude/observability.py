"""What the samples so far tell of the dipole and what they do not.

With the wheel running, the axis of the wheel is weak: a torque about the others turns the spin axis
slowly, and a dipole along the wheel is told from a wrong momentum only by small differences.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtff_dynamics.vectors import FloatArray

__all__ = ["DipoleObservability", "dipole_observability"]

_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class DipoleObservability:
    """How well the dipole is known.

    Attributes
    ----------
    sigma
        Standard deviation of the dipole on each axis, A m2, shape (3,).
    weakest_direction
        Unit vector in the body along which it is known worst, shape (3,).
    gain
        Initial over present sigma of each axis, shape (3,): 1 where nothing was learnt.
    reason
        Which axes are worse than the bound, one line; empty if none is.
    """

    sigma: FloatArray
    weakest_direction: FloatArray
    gain: FloatArray
    reason: str = ""


def dipole_observability(
    covariance: FloatArray, initial_sigma: float, bound: float = 5e-3
) -> DipoleObservability:
    """Return how well the dipole is known.

    Parameters
    ----------
    covariance : ndarray, shape (3, 3)
        Covariance of the dipole, (A m2)2.
    initial_sigma : float
        Sigma of each axis at the start, A m2.
    bound : float
        Sigma above which an axis is named, A m2.
    """
    sigma = np.sqrt(np.diag(covariance))
    _, vectors = np.linalg.eigh(covariance)
    weak = [
        f"{axis} {1e3 * value:.1f} mA m2"
        for axis, value in zip(_AXES, sigma, strict=True)
        if value > bound
    ]
    direction = vectors[:, -1]
    largest = int(np.argmax(np.abs(direction)))
    return DipoleObservability(
        sigma,
        direction * np.sign(direction[largest]),
        initial_sigma / sigma,
        f"dipole weakly observed: sigma {', '.join(weak)}" if weak else "",
    )
