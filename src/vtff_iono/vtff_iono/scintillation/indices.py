"""Scintillation indices of every signal, one set for each window (a minute, as a rule).

S4 is the standard deviation over the mean of the intensity. Receivers of the OEM6 kind do not log
intensity; their C/N0, turned from dB-Hz to a linear ratio, stands in for it when it is logged at
the full rate without smoothing. (In dB-Hz the ratio of deviation and mean would be a tenth of S4.)

- `s4_pseudo`: standard deviation over mean of linear C/N0, as in paper 000;
- `s4`: the same after division by a straight line, so that a change of antenna gain does not count;
- `s4_corrected`: S4 less the part that thermal noise of samples of this length makes.

Sigma-phi is the standard deviation of the carrier phase above a cut-off frequency. Motion, and
slow changes of the clocks, are removed by a polynomial and a high-pass filter, fast ones of the
receiver clock by the median of all signals. On the ground the cut-off is 0.1 Hz by custom; at
7.5 km/s that is 75 km, so that a higher one is right in orbit. It is part of the result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import signal

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import FLAG_LOCK_LOST, FLAG_PHASE_VALID
from vtff_gnss.signals import carrier_wavelength
from vtff_iono.links.windows import Columns, WindowBuffer

__all__ = [
    "ScintillationMonitor",
    "ScintillationSettings",
    "ScintillationWindow",
    "linear_power",
    "noise_s4",
    "phase_deviation",
    "pseudo_s4",
    "s4_index",
]

_COLUMNS = (
    *("system", "prn", "band", "attribute", "glonass_channel"),
    *("cn0_dbhz", "carrier_phase_cycles", "flags"),
)
# Forward and backward filtering doubles the order: sixth order, as ground receivers have it.
_HALF_ORDER = 3
_POLYNOMIAL_DEGREE = 5
_FEWEST_FOR_MEDIAN = 4
_LOWEST_OVERSAMPLING = 4.0


@dataclass(frozen=True)
class ScintillationSettings:
    """How indices are computed.

    Parameters
    ----------
    window : float
        Length of the windows, s.
    phase_cutoff_hz : float
        Cut-off of sigma-phi, Hz (-3 dB).
    coverage_minimum : float
        Part of the samples of a window that a signal must have.
    """

    window: float = 60.0
    phase_cutoff_hz: float = 0.1
    coverage_minimum: float = 0.8


@dataclass(frozen=True, eq=False)
class ScintillationWindow:
    """Indices of all signals in one window; arrays of shape (m,).

    Parameters
    ----------
    time : int
        End of the window, GPS time in ns since 1980-01-06.
    sample_rate_hz : float
        Of the observations used.
    phase_cutoff_hz : float
        Of sigma-phi.
    system, prn, band, attribute : ndarray of uint8
        Signals, ordered.
    s4, s4_corrected, s4_pseudo : ndarray
        NaN where the signal was not there for long enough.
    sigma_phi : ndarray
        rad; NaN where the phase was not continuous or the rate is too low for the cut-off.
    cn0_dbhz : ndarray
        Of the mean power.
    elevation, azimuth : ndarray
        rad, at the middle sample of the signal.
    samples : ndarray of int64
    """

    time: int
    sample_rate_hz: float
    phase_cutoff_hz: float
    system: npt.NDArray[np.uint8]
    prn: npt.NDArray[np.uint8]
    band: npt.NDArray[np.uint8]
    attribute: npt.NDArray[np.uint8]
    s4: FloatArray
    s4_corrected: FloatArray
    s4_pseudo: FloatArray
    sigma_phi: FloatArray
    cn0_dbhz: FloatArray
    elevation: FloatArray
    azimuth: FloatArray
    samples: npt.NDArray[np.int64]


def linear_power(cn0_dbhz: npt.ArrayLike) -> FloatArray:
    """Return C/N0 as a ratio in Hz from dB-Hz."""
    return np.asarray(10.0 ** (0.1 * np.asarray(cn0_dbhz, dtype=float)))


def pseudo_s4(power: npt.ArrayLike, axis: int = -1) -> FloatArray:
    """Return standard deviation over mean of linear C/N0 (Hz) along an axis."""
    power = np.asarray(power, dtype=float)
    return np.asarray(power.std(axis=axis) / power.mean(axis=axis))


def s4_index(power: npt.ArrayLike) -> FloatArray:
    """Return S4 of intensities (..., n) at even intervals, in any unit, a straight line removed."""
    power = np.asarray(power, dtype=float)
    count = power.shape[-1]
    place = np.linspace(-1.0, 1.0, count)
    slope = (power * place).sum(axis=-1, keepdims=True) / (place**2).sum()
    trend = power.mean(axis=-1, keepdims=True) + slope * place
    # A deep and long fade at one end could take the line below zero.
    trend = np.maximum(trend, 0.1 * power.mean(axis=-1, keepdims=True))
    return pseudo_s4(power / trend)


def noise_s4(cn0_dbhz: npt.ArrayLike, sample_length: float) -> FloatArray:
    """Return the S4 that thermal noise makes in samples of a length (s).

    References
    ----------
    Van Dierendonck, Klobuchar and Hua (1993), ION GPS-93, eq. for 50 Hz,
    S4_N^2 = 100/(C/N0) (1 + 500/(19 C/N0)), with its two numbers written for any sample length T:
    2/(T C/N0) and 10/(19 T C/N0).
    """
    ratio = 1.0 / (sample_length * linear_power(cn0_dbhz))
    return np.asarray(np.sqrt(2.0 * ratio * (1.0 + 10.0 / 19.0 * ratio)))


def phase_deviation(phase: npt.ArrayLike, sample_rate_hz: float, cutoff_hz: float) -> FloatArray:
    """Return phases (..., n) above a cut-off frequency, in the unit of the input.

    A polynomial of degree 5 takes out the motion; the sixth-order high-pass filter runs forward
    and backward, so that nothing has to settle.
    """
    phase = np.asarray(phase, dtype=float)
    # The cut-off is 3 dB after both passes: each is 1.5 dB down there.
    ratio = (np.sqrt(2.0) - 1.0) ** (1.0 / (2.0 * _HALF_ORDER))
    sections = signal.butter(
        _HALF_ORDER, cutoff_hz * ratio, "highpass", fs=sample_rate_hz, output="sos"
    )
    place = np.linspace(-1.0, 1.0, phase.shape[-1])
    basis, _ = np.linalg.qr(np.polynomial.legendre.legvander(place, _POLYNOMIAL_DEGREE))
    # First the first sample: a phase of 1e8 cycles would cost digits.
    phase = phase - phase[..., :1]
    phase = phase - (phase @ basis) @ basis.T
    return np.asarray(signal.sosfiltfilt(sections, phase, axis=-1))


class ScintillationMonitor:
    """Scintillation of one receiver, epoch by epoch or many epochs at once.

    Parameters
    ----------
    settings : ScintillationSettings
    """

    def __init__(self, settings: ScintillationSettings = ScintillationSettings()) -> None:  # noqa: B008 - frozen
        self._settings = settings
        self._buffer = WindowBuffer(settings.window)

    def update(
        self,
        time: npt.NDArray[np.int64],
        columns: Mapping[str, npt.NDArray],  # type: ignore[type-arg]
        elevation: npt.ArrayLike,
        azimuth: npt.ArrayLike,
    ) -> Iterator[ScintillationWindow]:
        """Take observations in and yield the windows that they end.

        Parameters
        ----------
        time : ndarray of int64, shape (n,)
            GPS time of every observation, ns since 1980-01-06, not decreasing.
        columns : mapping of str to ndarray, shape (n,)
            Columns of `vtff_gnss.observations.OBSERVATION_COLUMNS`.
        elevation, azimuth : array_like, shape (n,)
            rad; NaN where unknown.
        """
        kept = {name: columns[name] for name in _COLUMNS}
        kept["elevation"] = np.asarray(elevation, dtype=float)
        kept["azimuth"] = np.asarray(azimuth, dtype=float)
        for end, window in self._buffer.update(time, kept):
            yield self._indices(end, window)

    def flush(self) -> Iterator[ScintillationWindow]:
        """Yield the last window, which may be short."""
        for end, window in self._buffer.flush():
            yield self._indices(end, window)

    def _indices(self, end: int, window: Columns) -> ScintillationWindow:
        time = window["time"]
        epochs = np.unique(time)
        interval = float(np.median(np.diff(epochs))) if len(epochs) > 1 else np.inf
        rate = NANOSECONDS_PER_SECOND / interval
        key = (
            window["system"].astype(np.int64) << 24
            | window["prn"].astype(np.int64) << 16
            | window["band"].astype(np.int64) << 8
            | window["attribute"]
        )
        order = np.argsort(key, kind="stable")
        starts = np.flatnonzero(np.diff(key[order], prepend=-1))
        groups = np.split(order, starts[1:])
        expected = self._settings.window * rate
        power = linear_power(window["cn0_dbhz"])
        table = np.full((6, len(groups)), np.nan)
        for number, rows in enumerate(groups):
            own = power[rows]
            table[3, number] = 10.0 * np.log10(own.mean())
            middle = rows[len(rows) // 2]
            table[4:, number] = window["elevation"][middle], window["azimuth"][middle]
            if len(rows) >= max(2.0, self._settings.coverage_minimum * expected):
                table[0, number] = s4_index(own)
                table[2, number] = pseudo_s4(own)
        noise = noise_s4(table[3], 1.0 / rate) if np.isfinite(interval) else table[3]
        table[1] = np.sqrt(np.maximum(table[0] ** 2 - noise**2, 0.0))
        first = np.array([rows[0] for rows in groups], dtype=np.intp)
        return ScintillationWindow(
            time=end,
            sample_rate_hz=rate,
            phase_cutoff_hz=self._settings.phase_cutoff_hz,
            system=window["system"][first],
            prn=window["prn"][first],
            band=window["band"][first],
            attribute=window["attribute"][first],
            s4=table[0],
            s4_corrected=table[1],
            s4_pseudo=table[2],
            sigma_phi=self._sigma_phi(window, groups, epochs, rate),
            cn0_dbhz=table[3],
            elevation=table[4],
            azimuth=table[5],
            samples=np.array([len(rows) for rows in groups], dtype=np.int64),
        )

    def _sigma_phi(
        self,
        window: Columns,
        groups: list[npt.NDArray[np.intp]],
        epochs: npt.NDArray[np.int64],
        rate: float,
    ) -> FloatArray:
        """Return sigma-phi of the signals whose phase is there at all epochs; NaN of others."""
        result = np.full(len(groups), np.nan)
        cutoff = self._settings.phase_cutoff_hz
        steps = np.diff(epochs)
        even = len(steps) > 0 and steps.max() < 1.5 * steps.min()
        enough = len(epochs) >= self._settings.coverage_minimum * self._settings.window * rate
        if not (even and enough and rate >= _LOWEST_OVERSAMPLING * cutoff):
            return result
        flags = window["flags"].astype(np.int64)
        usable = (flags & FLAG_PHASE_VALID) != 0
        slipped = (flags & FLAG_LOCK_LOST) != 0
        whole = [
            number
            for number, rows in enumerate(groups)
            if len(rows) == len(epochs) and usable[rows].all() and not slipped[rows[1:]].any()
        ]
        if not whole:
            return result
        rows = np.array([groups[number] for number in whole])
        one = rows[:, 0]
        wavelength = carrier_wavelength(
            window["system"][one], window["band"][one], window["glonass_channel"][one]
        )[:, np.newaxis]
        ranges = window["carrier_phase_cycles"][rows] * wavelength
        deviation = phase_deviation(ranges, rate, cutoff)
        if len(whole) >= _FEWEST_FOR_MEDIAN:
            deviation = deviation - np.nanmedian(deviation, axis=0)
        result[whole] = (deviation * (2.0 * np.pi / wavelength)).std(axis=-1)
        return result
