"""Levelled slant contents that a receiver bias is estimated from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray

__all__ = ["BiasSamples", "ReceiverBiasError"]


class ReceiverBiasError(ValueError):
    """The samples cannot tell a bias."""


@dataclass(frozen=True, eq=False)
class BiasSamples:
    """Levelled slant contents of one receiver; arrays of shape (n,).

    Parameters
    ----------
    time : ndarray
        s; equal for satellites of one epoch.
    group : ndarray of int
        Which of the biases a sample has, 0 to m - 1: one for each pair of signals.
    stec_tecu, stec_sigma_tecu : ndarray
        Satellite biases removed, the receiver bias not.
    elevation : ndarray
        rad.
    direction_itrf : ndarray, shape (n, 3)
        Unit vectors to the satellites.
    position_receiver_itrf : ndarray, shape (n, 3)
        m.
    arc : ndarray of int, optional
        Samples of equal number share one level, whose error is `stec_sigma_tecu`; without it these
        errors are taken as independent from epoch to epoch.
    link : ndarray of int, optional
        Samples of equal number share one satellite bias.
    satellite_sigma_tecu : ndarray, optional
        The part of `stec_sigma_tecu` that is the satellite bias; zero where not given.
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

    def part(self, chosen: npt.NDArray[np.bool_]) -> BiasSamples:
        """Return the chosen samples."""
        columns = {name: column for name, column in vars(self).items() if column is not None}
        return BiasSamples(**{name: column[chosen] for name, column in columns.items()})
