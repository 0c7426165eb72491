"""Cycle slips of a phase lock loop by thermal noise and dynamics."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.special import i0e, ndtri

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.noise.random_streams import EPOCHS_PER_SECOND, Effect, NoiseField

__all__ = ["NoiseSlips", "slip_rate"]

# Below this probability in an epoch nothing is drawn: a slip in a year of a receiver.
_SMALLEST_PROBABILITY = 1e-12
# Where a static phase error is as large as this, the loop no longer follows, rad.
_LARGEST_STATIC_ERROR = 1.0


def slip_rate(
    cn0_dbhz: FloatArray,
    jerk: FloatArray,
    frequency: FloatArray,
    has_data: npt.NDArray[np.bool_],
    bandwidth_hz: float,
    integration_time: float,
) -> FloatArray:
    """Return the slips of a phase lock loop in a second, shape of the arguments.

    Parameters
    ----------
    cn0_dbhz : ndarray
    jerk : ndarray
        Third derivative of the range, m/s3.
    frequency : ndarray
        Frequency of the carrier, Hz.
    has_data : ndarray of bool
        Data symbols need a Costas loop: it doubles the phase, and slips by half a cycle.
    bandwidth_hz : float
        Noise bandwidth of the loop.
    integration_time : float
        Predetection, s.

    Notes
    -----
    A first-order loop with the signal-to-noise ratio rho, the inverse of the variance of its phase
    (Kaplan and Hegarty 2006, equation 5.6), slips every pi^2 rho I0(rho)^2 / (2 B) s (Viterbi 1966,
    Principles of Coherent Communication, section 4.2); with corrections that are left out, the
    form holds for loops of second and third order (Holmes and Raghavan 2009,
    doi:10.1109/AERO.2009.4839416). A static error theta tilts the potential that holds the phase:
    slips become cosh(pi rho sin(theta)) times as many (Kramers). In a third-order loop theta is
    2 pi jerk / (wavelength w0^3) with w0 = B / 0.7845 (Kaplan and Hegarty 2006, table 5.6).
    """
    ratio = 10.0 ** (0.1 * cn0_dbhz)
    squaring = 1.0 + 1.0 / (2.0 * integration_time * ratio)
    multiple = np.where(has_data, 2.0, 1.0)
    rho = ratio / (bandwidth_hz * squaring * multiple**2)
    natural_frequency = bandwidth_hz / 0.7845
    static = 2.0 * math.pi * frequency / SPEED_OF_LIGHT * np.abs(jerk) / natural_frequency**3
    theta = np.minimum(multiple * static, _LARGEST_STATIC_ERROR)
    # Logarithms, because I0 overflows for strong signals.
    exponent = math.pi * rho * np.sin(theta)
    log_cosh = exponent + np.log1p(np.exp(-2.0 * exponent)) - math.log(2.0)
    log_time = np.log(math.pi**2 * rho * i0e(rho) ** 2 / (2.0 * bandwidth_hz)) + 2.0 * rho
    return np.asarray(np.exp(np.minimum(log_cosh - log_time, math.log(EPOCHS_PER_SECOND))))


class NoiseSlips:
    """Slips of the links of one receiver, drawn by seed.

    Parameters
    ----------
    seed : int
        Seed of the run.
    addresses : sequence of tuple of int
        Address of each link in the random streams.
    """

    def __init__(self, seed: int, addresses: Sequence[tuple[int, ...]]) -> None:
        self._chance = NoiseField(seed, Effect.NOISE_SLIP, addresses)
        self._sign = NoiseField(seed, Effect.NOISE_SLIP_SIGN, addresses)

    def drawn(
        self,
        second: int,
        emitted: slice,
        rows: npt.NDArray[np.intp],
        rate: FloatArray,
        has_data: npt.NDArray[np.bool_],
    ) -> FloatArray:
        """Return by how many cycles links slip at the epochs of a second, shape (k, m).

        Parameters
        ----------
        second : int
        emitted : slice
            The k epochs.
        rows : ndarray of int, shape (m,)
            Links.
        rate : ndarray, shape (k, m)
            Slips in a second.
        has_data : ndarray of bool, shape (m,)
        """
        cycles = np.zeros(rate.shape)
        probability = -np.expm1(-rate / EPOCHS_PER_SECOND)
        links = np.flatnonzero((probability > _SMALLEST_PROBABILITY).any(axis=0))
        if links.size:
            chance = self._chance.second(second, rows[links])[emitted]
            sign = np.sign(self._sign.second(second, rows[links])[emitted])
            slips = chance < ndtri(probability[:, links])
            cycles[:, links] = slips * sign * np.where(has_data[links], 0.5, 1.0)
        return cycles
