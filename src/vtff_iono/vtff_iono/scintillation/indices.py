"""Scintillation indices of every signal, one set for each window (`ScintillationSettings.window`).

S4 is the standard deviation over the mean of the intensity. Receivers of the OEM6 kind do not log
intensity; their C/N0, converted from dB-Hz to a linear ratio, replaces it when it is logged at the
full rate without smoothing. (In dB-Hz the ratio of deviation and mean would be a tenth of S4.)

- `s4_pseudo`: standard deviation over mean of linear C/N0, as in paper 000;
- `s4`: S4 after division by a straight line, so that a change of antenna gain does not count;
- `s4_corrected`: S4 without the part that thermal noise makes in samples of this length.

Sigma-phi is the standard deviation of the carrier phase above a cut-off frequency. Motion and slow
changes of the clocks are removed by a polynomial and a high-pass filter, fast changes of the
receiver clock by the median of all signals. The cut-off is part of the result; its default depends
on the motion of the receiver, see `default_phase_cutoff_hz`.
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
from vtff_gnss.signals import carrier_wavelength, signal_number
from vtff_iono.geometry.mapping import LOWEST_ORBIT
from vtff_iono.links.windows import Columns, WindowBuffer

__all__ = [
    "GROUND_PHASE_CUTOFF_HZ",
    "ORBIT_PHASE_CUTOFF_HZ",
    "ScintillationMonitor",
    "ScintillationSettings",
    "ScintillationWindow",
    "default_phase_cutoff_hz",
    "linear_power",
    "noise_s4",
    "phase_deviation",
    "pseudo_s4",
    "s4_index",
]

GROUND_PHASE_CUTOFF_HZ = 0.1
"""Hz; cut-off of sigma-phi on the ground, as scintillation receivers have it (Van Dierendonck,
Klobuchar and Hua 1993). Irregularities drift at about 100 m/s there: the cut-off is 1 km."""

ORBIT_PHASE_CUTOFF_HZ = 1.0
"""Hz; cut-off of sigma-phi in low orbit. A receiver at 7.5 km/s crosses 7.5 km in its period; the
cut-off of the ground would be 75 km, which contains the layer itself besides irregularities."""

_COLUMNS = (
    "system",
    "prn",
    "band",
    "attribute",
    "glonass_channel",
    "cn0_dbhz",
    "carrier_phase_cycles",
    "flags",
)
_POLYNOMIAL_DEGREE = 5
# Both passes of the high-pass filter make the sixth order that ground receivers have.
_ORDER_OF_A_PASS = 3
# The median of fewer signals than this would contain too much of the scintillation itself.
_FEWEST_FOR_MEDIAN = 4
# Smallest ratio of sample rate and cut-off.
_LOWEST_OVERSAMPLING = 4.0
# Epochs are evenly spaced if the longest step is less than this many times the shortest.
_LARGEST_STEP_RATIO = 1.5
# The line that is divided out of the intensity is never below this fraction of its mean.
_LOWEST_TREND = 0.1


def default_phase_cutoff_hz(altitude: float) -> float:
    """Return the cut-off of sigma-phi for a receiver at an altitude (m), Hz.

    The node, whose receivers are in orbit, and `vtff tec`, whose receivers may be stations, both
    follow this rule.
    """
    return GROUND_PHASE_CUTOFF_HZ if altitude < LOWEST_ORBIT else ORBIT_PHASE_CUTOFF_HZ


@dataclass(frozen=True)
class ScintillationSettings:
    """Settings of the computation of indices.

    Parameters
    ----------
    window : float
        Length of the windows, s.
    phase_cutoff_hz : float
        Cut-off of sigma-phi (-3 dB), Hz; see `default_phase_cutoff_hz`.
    coverage_minimum : float
        Fraction of the samples of a window that a signal must have.
    """

    window: float = 60.0
    phase_cutoff_hz: float = ORBIT_PHASE_CUTOFF_HZ
    coverage_minimum: float = 0.8


@dataclass(frozen=True, eq=False)
class ScintillationWindow:
    """Indices of all signals in one window; arrays of shape (m,).

    Parameters
    ----------
    time : int
        End of the window, GPS time in ns since 1980-01-06.
    sample_rate_hz : float
        Rate of the observations used.
    phase_cutoff_hz : float
        Cut-off of sigma-phi.
    system, prn, band, attribute : ndarray of uint8
        Signals, in this order.
    s4, s4_corrected, s4_pseudo : ndarray
        S4 indices; NaN where the signal was not observed for long enough.
    sigma_phi : ndarray
        Sigma-phi, rad; NaN where the phase was not continuous or the rate is too low for the
        cut-off.
    cn0_dbhz : ndarray
        C/N0 of the mean power.
    elevation, azimuth : ndarray
        Direction of the satellite at the middle sample of the signal, rad.
    samples : ndarray of int64
        Number of samples of the signal.
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
    """Return S4 of intensities (..., n) at even intervals, in any unit, without a linear trend."""
    power = np.asarray(power, dtype=float)
    count = power.shape[-1]
    abscissa = np.linspace(-1.0, 1.0, count)
    slope = (power * abscissa).sum(axis=-1, keepdims=True) / (abscissa**2).sum()
    mean = power.mean(axis=-1, keepdims=True)
    # A deep and long fade at one end could take the line below zero.
    trend = np.maximum(mean + slope * abscissa, _LOWEST_TREND * mean)
    return pseudo_s4(power / trend)


def noise_s4(cn0_dbhz: npt.ArrayLike, sample_length: npt.ArrayLike) -> FloatArray:
    """Return the S4 that thermal noise makes in samples of a length (s), at a C/N0 in dB-Hz.

    References
    ----------
    Van Dierendonck, Klobuchar and Hua (1993), ION GPS-93, eq. for 50 Hz,
    S4_N^2 = 100/(C/N0) (1 + 500/(19 C/N0)). For any sample length T its two terms are 2/(T C/N0)
    and 10/(19 T C/N0).
    """
    ratio = 1.0 / (np.asarray(sample_length) * linear_power(cn0_dbhz))
    return np.asarray(np.sqrt(2.0 * ratio * (1.0 + 10.0 / 19.0 * ratio)))


def phase_deviation(phase: npt.ArrayLike, sample_rate_hz: float, cutoff_hz: float) -> FloatArray:
    """Return phases (..., n) above a cut-off frequency, in the unit of the input.

    A polynomial of degree 5 removes the motion; the sixth-order high-pass filter runs forward and
    backward, so that it adds no delay.

    Raises
    ------
    ValueError
        If there are less than 13 samples, which the filter needs at its ends.
    """
    values = np.asarray(phase, dtype=float)
    # The cut-off is 3 dB after both passes: each is 1.5 dB down there.
    ratio = (np.sqrt(2.0) - 1.0) ** (1.0 / (2.0 * _ORDER_OF_A_PASS))
    abscissa = np.linspace(-1.0, 1.0, values.shape[-1])
    basis, _ = np.linalg.qr(np.polynomial.legendre.legvander(abscissa, _POLYNOMIAL_DEGREE))
    # The first sample is subtracted first: a phase of 1e8 cycles would cost digits.
    values = values - values[..., :1]
    values = values - (values @ basis) @ basis.T
    sections = signal.butter(
        _ORDER_OF_A_PASS, cutoff_hz * ratio, "highpass", fs=sample_rate_hz, output="sos"
    )
    return np.asarray(signal.sosfiltfilt(sections, values, axis=-1))


class ScintillationMonitor:
    """Scintillation of one receiver, epoch by epoch or many epochs at once.

    Parameters
    ----------
    settings : ScintillationSettings
        How indices are computed.
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
        """Add observations and yield the windows that they end.

        Parameters
        ----------
        time : ndarray of int64, shape (n,)
            GPS time of every observation, ns since 1980-01-06, not decreasing.
        columns : mapping of str to ndarray, shape (n,)
            Columns of `vtff_gnss.observations.OBSERVATION_COLUMNS`.
        elevation, azimuth : array_like, shape (n,)
            Direction of the satellite of every observation, rad; NaN where unknown.
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
        """Return the indices of the signals in a window that ends at a time, ns."""
        time = window["time"]  # not decreasing
        epochs = time[np.diff(time, prepend=time[:1] - 1) != 0]
        interval = float(np.median(np.diff(epochs))) if len(epochs) > 1 else np.inf
        rate = NANOSECONDS_PER_SECOND / interval
        signals = _rows_by_signal(window)
        fewest_samples = max(2.0, self._settings.coverage_minimum * self._settings.window * rate)
        power = linear_power(window["cn0_dbhz"])
        counts = np.array([len(rows) for rows in signals], dtype=np.int64)
        s4, s4_pseudo = np.full(len(signals), np.nan), np.full(len(signals), np.nan)
        mean_power = np.empty(len(signals))
        # Signals with equal numbers of samples, as a rule nearly all, are computed together.
        for count in np.unique(counts).tolist():
            chosen = np.flatnonzero(counts == count)
            of_signals = power[np.array([signals[number] for number in chosen.tolist()])]
            mean_power[chosen] = of_signals.mean(axis=-1)
            if count >= fewest_samples:
                s4[chosen] = s4_index(of_signals)
                s4_pseudo[chosen] = pseudo_s4(of_signals)
        cn0_dbhz = 10.0 * np.log10(mean_power)
        noise = (
            noise_s4(cn0_dbhz, 1.0 / rate) if np.isfinite(interval) else np.full_like(s4, np.nan)
        )
        first = np.array([rows[0] for rows in signals], dtype=np.intp)
        middle = np.array([rows[len(rows) // 2] for rows in signals], dtype=np.intp)
        return ScintillationWindow(
            time=end,
            sample_rate_hz=rate,
            phase_cutoff_hz=self._settings.phase_cutoff_hz,
            system=window["system"][first],
            prn=window["prn"][first],
            band=window["band"][first],
            attribute=window["attribute"][first],
            s4=s4,
            s4_corrected=np.sqrt(np.maximum(s4**2 - noise**2, 0.0)),
            s4_pseudo=s4_pseudo,
            sigma_phi=self._sigma_phi(window, signals, epochs, rate),
            cn0_dbhz=cn0_dbhz,
            elevation=window["elevation"][middle],
            azimuth=window["azimuth"][middle],
            samples=counts,
        )

    def _sigma_phi(
        self,
        window: Columns,
        signals: list[npt.NDArray[np.intp]],
        epochs: npt.NDArray[np.int64],
        rate: float,
    ) -> FloatArray:
        """Return sigma-phi of the signals that have a phase at all epochs; NaN for the others.

        `signals` are the rows of each signal.
        """
        sigma_phi = np.full(len(signals), np.nan)
        cutoff = self._settings.phase_cutoff_hz
        steps = np.diff(epochs)
        is_even = len(steps) > 0 and steps.max() < _LARGEST_STEP_RATIO * steps.min()
        is_covered = len(epochs) >= self._settings.coverage_minimum * self._settings.window * rate
        if not (is_even and is_covered and rate >= _LOWEST_OVERSAMPLING * cutoff):
            return sigma_phi
        flags = window["flags"].astype(np.int64)
        has_phase = (flags & FLAG_PHASE_VALID) != 0
        lost_lock = (flags & FLAG_LOCK_LOST) != 0
        continuous = [
            number
            for number, rows in enumerate(signals)
            if len(rows) == len(epochs) and has_phase[rows].all() and not lost_lock[rows[1:]].any()
        ]
        if not continuous:
            return sigma_phi
        rows = np.array([signals[number] for number in continuous])
        first = rows[:, 0]
        wavelength = carrier_wavelength(
            window["system"][first], window["band"][first], window["glonass_channel"][first]
        )[:, np.newaxis]
        ranges = window["carrier_phase_cycles"][rows] * wavelength
        deviation = phase_deviation(ranges, rate, cutoff)
        if len(continuous) >= _FEWEST_FOR_MEDIAN:
            # The median that knows NaN takes ten times as long.
            has_all = bool(np.isfinite(deviation).all())
            median = np.median(deviation, axis=0) if has_all else np.nanmedian(deviation, axis=0)
            deviation = deviation - median
        sigma_phi[continuous] = (deviation * (2.0 * np.pi / wavelength)).std(axis=-1)
        return sigma_phi


def _rows_by_signal(window: Columns) -> list[npt.NDArray[np.intp]]:
    """Return the rows of each signal in order of time; signals are ordered."""
    number = signal_number(window["system"], window["prn"], window["band"], window["attribute"])
    rows = np.argsort(number, kind="stable")
    parts = np.split(rows, np.flatnonzero(np.diff(number[rows])) + 1)
    return [part for part in parts if len(part)]
