"""Whether the satellites of a receiver agree with each other as their stated sigmas promise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray

__all__ = ["Disagreement", "satellite_disagreement"]

# The lowest elevation of the bias solution; below, mapping to the vertical is the larger error.
_LOWEST_ELEVATION = math.radians(20.0)
# A median of fewer satellites is near each of them, and says little.
_FEWEST_SATELLITES = 4
_FEWEST_EPOCHS = 5
# Epochs that are compared, evenly spaced: neighbouring ones tell the same.
_EPOCHS = 150
# Part of the vertical content by which the ionosphere itself differs between the satellites of an
# epoch. A station at the equatorial anomaly (BELE, 2024-01-10, biases of CAS) shows 8 %.
_GRADIENT = 0.1
# Five recordings with their biases have 0.1 to 0.8 of what is allowed, with the satellite biases
# left in (3 to 10 ns) 1.9 and 3.4.
_LARGEST_RATIO = 1.5


@dataclass(frozen=True)
class Disagreement:
    """How far the satellites of a receiver differ from each other.

    Attributes
    ----------
    rms_tecu
        Root mean square over the links of their mean deviation from the other satellites, in the
        slant content.
    stated_tecu
        The same of their stated sigmas.
    allowed_tecu
        Stated sigma and gradients of the ionosphere together.
    """

    rms_tecu: float
    stated_tecu: float
    allowed_tecu: float

    @property
    def is_beyond_sigma(self) -> bool:
        """Whether the deviations are larger than sigmas and gradients explain."""
        return self.rms_tecu > _LARGEST_RATIO * self.allowed_tecu

    def describe(self) -> str:
        """Return a sentence for the user."""
        return (
            f"the satellites disagree by {self.rms_tecu:.1f} TECU, stated is "
            f"{self.stated_tecu:.1f} TECU: biases of satellites are missing or wrong (--biases), "
            "and contents and receiver biases are off by more than their sigmas"
        )


def satellite_disagreement(
    time: npt.NDArray[np.int64],
    link: npt.NDArray[np.integer],
    elevation: FloatArray,
    stec_tecu: FloatArray,
    vtec_tecu: FloatArray,
    stec_sigma_tecu: FloatArray,
) -> Disagreement | None:
    """Compare each link with the median of the vertical contents of its epochs.

    A bias of a satellite stays for all its epochs, noise and gradients do less so: the deviation
    of a link is the mean over its epochs.

    Parameters
    ----------
    time, link
        Epoch and link of each good sample, shape (n,).
    elevation
        rad.
    stec_tecu, vtec_tecu, stec_sigma_tecu
        Slant content, the same mapped to the vertical, and the sigma of the slant content.

    Returns
    -------
    Disagreement or None
        None where fewer than four satellites are seen together.
    """
    usable = (elevation >= _LOWEST_ELEVATION) & np.isfinite(vtec_tecu) & (vtec_tecu != 0.0)
    usable &= np.isfinite(stec_tecu) & np.isfinite(stec_sigma_tecu)
    epochs, epoch = np.unique(time, return_inverse=True)
    usable &= epoch % max(1, len(epochs) // _EPOCHS) == 0
    vertical: list[float] = []
    deviations: dict[int, list[float]] = {}
    variances: dict[int, list[float]] = {}
    rows = np.flatnonzero(usable)
    rows = rows[np.argsort(epoch[rows], kind="stable")]
    for together in np.split(rows, np.flatnonzero(np.diff(epoch[rows])) + 1):
        if len(together) < _FEWEST_SATELLITES:
            continue
        median = float(np.median(vtec_tecu[together]))
        vertical.append(median)
        slant = (vtec_tecu[together] - median) * stec_tecu[together] / vtec_tecu[together]
        for number, deviation, row in zip(link[together].tolist(), slant, together, strict=True):
            deviations.setdefault(number, []).append(float(deviation))
            variances.setdefault(number, []).append(float(stec_sigma_tecu[row]) ** 2)
    kept = [number for number, values in deviations.items() if len(values) >= _FEWEST_EPOCHS]
    if len(kept) < _FEWEST_SATELLITES:
        return None
    rms = math.sqrt(np.mean([np.mean(deviations[number]) ** 2 for number in kept]))
    stated = math.sqrt(np.mean([np.mean(variances[number]) for number in kept]))
    allowed = math.hypot(stated, _GRADIENT * float(np.median(vertical)))
    return Disagreement(rms, stated, allowed)
