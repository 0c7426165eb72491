"""Levelled slant contents from which receiver biases are estimated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray

__all__ = ["DECIMALS_TECU", "BiasSamples", "ReceiverBiasError"]

DECIMALS_TECU = 3
"""Decimals of biases and levels, TECU.

Further decimals depend on the number of threads of linear algebra, and reprocessing a recording
must give the bytes that were published.
"""


class ReceiverBiasError(ValueError):
    """The samples do not determine a receiver bias."""


@dataclass(frozen=True, eq=False)
class BiasSamples:
    """Levelled slant contents of one receiver; arrays of shape (n,).

    Parameters
    ----------
    time : ndarray
        Time, s; equal for all satellites of an epoch.
    group : ndarray of int
        Number of the receiver bias that a sample contains, 0 to m - 1; each pair of signals has
        its own bias.
    stec_tecu, stec_sigma_tecu : ndarray
        Slant content and its sigma, TECU: satellite biases removed, the receiver bias included.
    elevation : ndarray
        Elevation of the satellite, rad.
    direction_itrf : ndarray, shape (n, 3)
        Unit vectors to the satellites.
    position_receiver_itrf : ndarray, shape (n, 3)
        Positions of the receiver, m.
    arc : ndarray of int, optional
        Number of the arc. Samples of an arc share one level, whose error is `stec_sigma_tecu`;
        without arcs these errors are taken as independent from epoch to epoch.
    link : ndarray of int, optional
        Number of the link. Samples of a link share one satellite bias.
    satellite_sigma_tecu : ndarray, optional
        Contribution of the satellite bias to `stec_sigma_tecu`, TECU; zero where not given.
    wind_up_tecu : ndarray, optional
        Content that the wind-up of the phases since the arc began looks like, TECU
        (`vtff_iono.geometry.wind_up`); it is not removed. Zero where not given.
    """

    time: FloatArray
    group: npt.NDArray[np.int64]
    stec_tecu: FloatArray
    stec_sigma_tecu: FloatArray
    elevation: FloatArray
    direction_itrf: FloatArray
    position_receiver_itrf: FloatArray
    arc: npt.NDArray[np.int64] | None = None
    link: npt.NDArray[np.int64] | None = None
    satellite_sigma_tecu: FloatArray | None = None
    wind_up_tecu: FloatArray | None = None

    def select(self, rows: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> BiasSamples:
        """Return the samples of a mask or of indices, in their order."""
        columns = {name: column for name, column in vars(self).items() if column is not None}
        return BiasSamples(**{name: column[rows] for name, column in columns.items()})
