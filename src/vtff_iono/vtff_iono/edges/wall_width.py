"""The width of a wall, by the densities between the spacecraft and by the contents of each."""

from __future__ import annotations

import math

import numpy as np

__all__ = ["combine_widths"]

# m; the widest wall, and the step of the widths that are tried.
_WIDEST, _STEP = 40e3, 20.0


def combine_widths(
    by_densities: float,
    sigma_by_densities: float,
    by_contents: float,
    sigma_by_contents: float,
    square_sigma_by_contents: float,
) -> tuple[float, float]:
    """Return the width of a wall and its sigma, m: mean and scatter of all that are not negative.

    Densities rest on levels, which integers give; contents on slopes, mostly those of the mean of
    both spacecraft. Their errors are taken as independent
    (correlation 0.2 in drawn bubbles, benchmarks/README.md). Where they disagree by more than their
    sigmas, both count as so much less sure (Birge 1932, Physical Review 40:207).

    Parameters
    ----------
    by_densities, sigma_by_densities : float
        m; NaN if densities do not tell it.
    by_contents, sigma_by_contents : float
        m.
    square_sigma_by_contents : float
        Sigma of the square of the width, m^2: what contents are linear in.
    """
    width = np.arange(0.0, _WIDEST + _STEP, _STEP)
    misfit = ((width**2 - by_contents**2) / square_sigma_by_contents) ** 2
    if math.isfinite(by_densities + sigma_by_densities):
        misfit += ((width - by_densities) / sigma_by_densities) ** 2
        apart = abs(by_densities - by_contents)
        misfit /= max(1.0, apart / math.hypot(sigma_by_densities, sigma_by_contents)) ** 2
    weight = np.exp(-0.5 * (misfit - misfit.min()))
    weight /= weight.sum()
    mean = float(weight @ width)
    return mean, math.sqrt(float(weight @ (width - mean) ** 2) + _STEP**2 / 12.0)
