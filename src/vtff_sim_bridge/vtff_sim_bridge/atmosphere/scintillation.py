"""Amplitude and phase scintillation: the Cornell model as a frozen pattern along the track.

The complex gain of a link is a constant direct part plus a scattered part (Rice amplitudes),

    z(u) = (1 - S4^2)^(1/4) + (1 - (1 - S4^2)^(1/2))^(1/2) xi(u),    E|z|^2 = 1,

where xi is complex Gaussian noise of unit variance through a second-order Butterworth low pass.
The model is that of Humphreys et al. (2009); with m = 1 / S4^2 and K their Rice parameter, the two
factors are those of K / (1 + K) and 1 / (1 + K). Power that fluctuates with S4 <= 1 has the scaled
variance S4^2, and the autocorrelation of xi is 1/e at the decorrelation time.

xi is not a function of time but of a coordinate u along the track, in seconds of flight. Two
spacecraft that pass the same place one after the other see the same fades with that delay, as if
the plasma did not change in between. Any value of xi can be asked for in any order: the noise is
drawn in blocks of u, each from its own seed, and filtered with a finite impulse response. What
comes out does not depend on how a run is cut into calls.

All frequencies of a satellite share xi and differ by their S4, so that fades are coherent.
Neglected: refractive phase (add it by the density profile), the widening of the decorrelation time
with the square root of frequency (13 % from L1 to L2). A pattern that changes between two
spacecraft is the sum of a common and an independent one (`vtff_sim_bridge.gnss.propagation`).

References
----------
Humphreys, Psiaki, Hinks, O'Hanlon, Kintner (2009), Simulating ionosphere-induced scintillation for
testing GPS receiver phase tracking loops, IEEE J. Sel. Topics Signal Process. 3(4), 707-715.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray, cross, norm
from vtff_gnss.constants import FREQUENCY_L1

__all__ = [
    "AlongTrackAxis",
    "ScintillationField",
    "s4_at_frequency",
    "scintillation_gain",
    "tapered_s4",
]

ComplexArray = npt.NDArray[np.complex128]

BUTTERWORTH_DECORRELATION = 1.23964643681047
"""beta_0 of Humphreys et al.: root of exp(-b) (cos b + sin b) = 1/e."""

_POINTS_PER_DECORRELATION_TIME = 64
# The impulse response has then fallen to exp(-16).
_RESPONSE_DECORRELATION_TIMES = 13
_BLOCK_POINTS = 1024
_STORED_BLOCKS = 512


def scintillation_gain(fluctuation: npt.ArrayLike, s4: npt.ArrayLike) -> ComplexArray:
    """Return the complex gain of a signal, mean power 1.

    Parameters
    ----------
    fluctuation : array_like of complex
        Scattered part xi of unit variance, from `ScintillationField`.
    s4 : array_like
        Scintillation index, 0 to 1; broadcast with `fluctuation`.

    Returns
    -------
    ndarray of complex
        Factors whose magnitude multiplies the amplitude and whose argument (rad) is added to the
        carrier phase.

    Raises
    ------
    ValueError
        If an index lies outside 0 to 1, where there is no Rice distribution.
    """
    index = np.asarray(s4, dtype=float)
    if not ((index >= 0.0) & (index <= 1.0)).all():
        raise ValueError("s4: must be within 0 and 1")
    direct_power = np.sqrt(1.0 - index * index)
    gain: ComplexArray = np.sqrt(direct_power) + np.sqrt(1.0 - direct_power) * np.asarray(
        fluctuation
    )
    return gain


def s4_at_frequency(s4_l1: npt.ArrayLike, frequency: npt.ArrayLike) -> FloatArray:
    """Return S4 at a frequency (Hz) from that on L1: proportional to f^-1.5, at most 1.

    The exponent is that of weak scatter by a phase screen with spectral index 4 (Fremouw et al.
    1978, Radio Sci. 13, 167).
    """
    scaled = np.asarray(s4_l1) * (FREQUENCY_L1 / np.asarray(frequency)) ** 1.5
    return np.asarray(np.minimum(scaled, 1.0))


def tapered_s4(s4: float, path_length: npt.ArrayLike, taper_length: float) -> FloatArray:
    """Return the S4 of rays of which a length lies in the region, without a jump at its edge.

    Parameters
    ----------
    s4 : float
        Index inside the region.
    path_length : array_like
        Length of the rays inside, m.
    taper_length : float
        Length from which on the full index holds, m. A jump of S4 would be a jump of carrier phase.
    """
    fraction = np.minimum(np.asarray(path_length, dtype=float) / taper_length, 1.0)
    return np.asarray(s4 * fraction * fraction * (3.0 - 2.0 * fraction))


class AlongTrackAxis:
    """The coordinate u along a track, fixed to the Earth.

    It is the angle of a position about the normal of the track, divided by the angular rate of the
    reference state: near it u advances by one second each second, and the decorrelation time is
    that of the signal. A spacecraft on a similar track reads at its own place, whenever it passes.

    Parameters
    ----------
    state_itrf : array_like, shape (6,)
        Position (m) and Earth-fixed velocity (m/s) of a spacecraft near the region.

    Raises
    ------
    ValueError
        If position and velocity are parallel.
    """

    def __init__(self, state_itrf: npt.ArrayLike) -> None:
        state = np.asarray(state_itrf, dtype=float)
        angular_momentum = cross(state[:3], state[3:])
        if not norm(angular_momentum) > 0.0:
            raise ValueError("state_itrf: position and velocity do not span a plane")
        radius = norm(state[:3])
        self._radial = state[:3] / radius
        self._along = cross(angular_momentum / norm(angular_momentum), self._radial)
        self._rate = norm(angular_momentum) / radius**2

    def coordinate(self, position_itrf: npt.ArrayLike) -> FloatArray:
        """Return u (s) of positions (..., 3) in ITRF, zero at the reference, shape (...)."""
        position = np.asarray(position_itrf, dtype=float)
        angle = np.arctan2(position @ self._along, position @ self._radial)
        return np.asarray(angle / self._rate)


class ScintillationField:
    """Scattered parts xi(u) of all satellites seen through one region.

    Parameters
    ----------
    decorrelation_time : float
        Decorrelation time tau0 of the complex gain, s (from 0.087 s on at 20 Hz, else
        more than 1 % of its power is aliased).
    seed : sequence of int
        Non-negative integers that tell this field from others, for example run and region.

    Raises
    ------
    ValueError
        If the decorrelation time is not positive or a seed is negative.
    """

    def __init__(self, decorrelation_time: float, seed: Sequence[int]) -> None:
        if not 0.0 < decorrelation_time < math.inf:
            raise ValueError(f"decorrelation_time: must be positive, got {decorrelation_time}")
        if any(number < 0 for number in seed):
            raise ValueError(f"seed: must not be negative, got {list(seed)}")
        self._step = decorrelation_time / _POINTS_PER_DECORRELATION_TIME
        self._seed = [int(number) for number in seed]
        response = _butterworth_response()
        self._transform_points = len(response) + _BLOCK_POINTS
        self._response_transform = np.fft.fft(response, self._transform_points)
        self._first_valid = len(response) - 1
        self._blocks = np.empty((_STORED_BLOCKS, _BLOCK_POINTS + 1), dtype=complex)
        self._rows: dict[tuple[int, int], int] = {}

    def fluctuation(self, stream: npt.ArrayLike, coordinate: npt.ArrayLike) -> ComplexArray:
        """Return xi of streams at coordinates.

        Parameters
        ----------
        stream : array_like of int
            Number of the realisation, 0 to 2^31 - 1: that of the satellite where receivers share
            the pattern, or one made of receiver and satellite where they do not.
        coordinate : array_like
            u along the track, s (or time for a receiver at rest); broadcast with `stream`.

        Returns
        -------
        ndarray of complex
            Values of zero mean and unit variance, continuous in u.

        Raises
        ------
        ValueError
            If a stream number is out of range or a coordinate is not finite.
        """
        numbers, places = np.broadcast_arrays(
            np.asarray(stream, dtype=np.int64), np.asarray(coordinate, dtype=float)
        )
        if places.size == 0:
            return np.zeros(places.shape, dtype=complex)
        if numbers.min() < 0 or numbers.max() >= 1 << 31:
            raise ValueError("stream: must be within 0 and 2^31 - 1")
        if not np.isfinite(places).all():
            raise ValueError("coordinate: must be finite")
        return self._interpolate(numbers.ravel(), places.ravel() / self._step).reshape(places.shape)

    def _interpolate(self, stream: npt.NDArray[np.int64], points: FloatArray) -> ComplexArray:
        """Return xi, shape (n,), at places counted in grid points."""
        floor = np.floor(points)
        block, index = np.divmod(floor.astype(np.int64), _BLOCK_POINTS)
        keys, inverse = np.unique((stream << 32) + (block + (1 << 31)), return_inverse=True)
        if len(keys) > _STORED_BLOCKS:
            half = len(points) // 2
            return np.concatenate(
                (
                    self._interpolate(stream[:half], points[:half]),
                    self._interpolate(stream[half:], points[half:]),
                )
            )
        pairs = [(key >> 32, (key & 0xFFFFFFFF) - (1 << 31)) for key in keys.tolist()]
        row = np.array(self._rows_of(pairs))[inverse]
        fraction = points - floor
        left, right = self._blocks[row, index], self._blocks[row, index + 1]
        values: ComplexArray = left + fraction * (right - left)
        return values

    def _rows_of(self, pairs: list[tuple[int, int]]) -> list[int]:
        """Return the rows in which the blocks (stream, number) are stored, made where missing."""
        missing = [pair for pair in pairs if pair not in self._rows]
        if len(self._rows) + len(missing) > _STORED_BLOCKS:
            wanted = set(pairs)
            self._rows = {pair: row for pair, row in self._rows.items() if pair in wanted}
        if missing:
            free = sorted(set(range(_STORED_BLOCKS)) - set(self._rows.values()))
            for pair, row in zip(missing, free, strict=False):
                self._blocks[row] = self._made_block(*pair)
                self._rows[pair] = row
        return [self._rows[pair] for pair in pairs]

    def _made_block(self, stream: int, number: int) -> ComplexArray:
        """Return the filtered points of a block and the first one of the next, shape (B + 1,)."""
        noise = np.concatenate(
            (
                self._noise(stream, number - 1)[-self._first_valid :],
                self._noise(stream, number),
                self._noise(stream, number + 1)[:1],
            )
        )
        transform = np.fft.fft(noise, self._transform_points) * self._response_transform
        filtered: ComplexArray = np.fft.ifft(transform)[self._first_valid :]
        return filtered

    def _noise(self, stream: int, number: int) -> ComplexArray:
        """Return the white noise of a block, unit variance, shape (B,)."""
        # Seeds are not negative: blocks ... -1, 0, 1 ... become 1, 0, 2 ...
        folded = 2 * number if number >= 0 else -2 * number - 1
        generator = np.random.default_rng([*self._seed, stream, folded])
        parts = generator.standard_normal((_BLOCK_POINTS, 2)) * math.sqrt(0.5)
        noise: ComplexArray = parts[:, 0] + 1j * parts[:, 1]
        return noise


def _butterworth_response() -> FloatArray:
    """Return the impulse response of the low pass on the grid of a field, of unit energy.

    exp(-a t) sin(a t) has the power spectrum 1 / (1 + (f / f_c)^4) with a = sqrt(2) pi f_c and the
    autocorrelation exp(-a t) (cos a t + sin a t), which is 1/e at t = beta_0 / a.
    """
    points = np.arange(_RESPONSE_DECORRELATION_TIMES * _POINTS_PER_DECORRELATION_TIME)
    argument = BUTTERWORTH_DECORRELATION / _POINTS_PER_DECORRELATION_TIME * points
    response = np.exp(-argument) * np.sin(argument)
    unit: FloatArray = response / math.sqrt(float(response @ response))
    return unit
