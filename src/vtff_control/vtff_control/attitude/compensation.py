"""Cancelling a residual dipole by biased pulses (Steyn and Hashida 2001, equations 6 and 14)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_control.attitude.torquers import TorquerLimits
from vtff_dynamics.checks import check_vector
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "PAPER_COMPENSATION_FINAL",
    "PAPER_COMPENSATION_FIRST",
    "Compensation",
    "check_compensation",
    "compensate_dipole",
]

PAPER_COMPENSATION_FIRST = (-0.041, -0.015, 0.1)
"""Moment of the torquers in equation 6, A m2."""

PAPER_COMPENSATION_FINAL = (-0.034, -0.036, 0.1)
"""Moment against the dipole of equation 14, A m2; z is what 4 s in 5 s give (paper: 0.1)."""


@dataclass(frozen=True)
class Compensation:
    """Biased pulses against a dipole.

    Attributes
    ----------
    moment
        Mean moment of the pulses, A m2, shape (3,).
    residual
        What is left of the dipole, A m2, shape (3,).
    reason
        Which axes the torquers cannot cancel, one line; empty if they cancel all.
    """

    moment: FloatArray
    residual: FloatArray
    reason: str = ""


def check_compensation(name: str, value: npt.ArrayLike, limits: TorquerLimits) -> FloatArray:
    """Return a given compensation as an array of shape (3,), A m2.

    Raises
    ------
    ValueError
        If it is not three finite numbers, or an axis is beyond what the pulses give.
    """
    moment = check_vector(name, value, 3, "A m2")
    largest = limits.largest_mean_moment
    if np.abs(moment).max() > largest * (1.0 + 1e-9):
        raise ValueError(
            f"{name}: the torquers give at most {largest:.4g} A m2 on each axis "
            f"({limits.moment:g} A m2 for {limits.most_steps * limits.pulse_step:g} s in "
            f"{limits.period:g} s); got {moment.tolist()}"
        )
    return moment


def compensate_dipole(dipole: FloatArray, limits: TorquerLimits) -> Compensation:
    """Return the pulses that cancel a dipole, axis by axis, as far as they reach."""
    largest = limits.largest_mean_moment
    moment = np.clip(-dipole, -largest, largest)
    residual = dipole + moment
    beyond = [
        f"{axis} {value:.3f} A m2"
        for axis, value, left in zip("xyz", dipole, residual, strict=True)
        if abs(left) > 1e-9
    ]
    reason = (
        f"dipole beyond the torquers ({largest:.4g} A m2): {', '.join(beyond)}" if beyond else ""
    )
    return Compensation(moment, residual, reason)
