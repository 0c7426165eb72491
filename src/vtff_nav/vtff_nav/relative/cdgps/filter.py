"""The state of the deputy relative to the chief: measurements, faults and integers of an epoch."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import gammaincc

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps.ambiguity_arcs import ArcBook
from vtff_nav.relative.cdgps.ambiguity_fixing import FixAttempt, fix_ambiguities
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.measurement_faults import Judged, without_faults
from vtff_nav.relative.cdgps.model import (
    DENSITY_UNIT,
    Sky,
    code_biases,
    measurement_innovation,
)
from vtff_nav.relative.cdgps.phase_scatter import PhaseScatter, epochs_to_average
from vtff_nav.relative.cdgps.state import GaussianState, Innovation, Label
from vtff_nav.relative.common.dynamics import DYNAMIC_STATES, Prediction
from vtff_nav.relative.common.measurements import SingleDifferences, upper_median
from vtff_nav.relative.common.solution import (
    SOLUTION_CODE,
    SOLUTION_FIXED,
    SOLUTION_FLOAT,
    LaserMeasurement,
)

__all__ = ["RelativeFilter", "Update"]

# Start values of what is not known at all; far above what happens, far below lost digits.
_UNKNOWN_AMBIGUITY_SIGMA = 10.0
_UNKNOWN_CODE_BIAS_SIGMA = 20.0

_PLASMA, _MOTION = "plasma", "motion"
# Sigmas added to the motion when it is not what was predicted: m, m/s.
_SURPRISE_SIGMAS = (10.0, 1.0)
_DETECTION_PASSES = 6
_GLOBAL_FAILURES = 2
_FEWEST_FIXED_SATELLITES = 4
# In scatter an ambiguity is decided when so many epochs agree and their mean is as good as this: in
# a fade the error of a single phase is far from normal.
_FEWEST_EPOCHS_IN_SCATTER = 3
_AVERAGED_CYCLES = 0.05


@dataclass(eq=False)
class Update:
    """What the measurements of an epoch have brought.

    Parameters
    ----------
    measured : SingleDifferences
    sky : Sky
    innovation : Innovation
        As used.
    excluded : dict of SignalKey to str
        Signals whose code or integer was not used further, and why.
    degraded : list of str
    fixed : set of SignalKey
        Signals whose integer was decided.
    has_failed : bool
        The innovations are too large as a whole: nothing of the state can be trusted.
    """

    measured: SingleDifferences
    sky: Sky
    innovation: Innovation
    excluded: dict[SignalKey, str]
    degraded: list[str]
    fixed: set[SignalKey] = field(default_factory=set)
    has_failed: bool = False

    @property
    def statistics(self) -> tuple[float, float, int]:
        """Normalised RMS of the innovations, their normalised square, its degrees of freedom."""
        innovation = self.innovation
        if innovation.degrees_of_freedom <= 0:
            return 0.0, 0.0, 0
        normalised = innovation.normalised
        count = np.count_nonzero(innovation.is_used)
        rms = math.sqrt(float(normalised @ normalised) / count)
        return rms, innovation.squared_norm, innovation.degrees_of_freedom


class RelativeFilter:
    """Gaussian state of the difference, the arcs of its phases and their integers.

    Parameters
    ----------
    configuration : CdgpsConfiguration
    mean : ndarray, shape (9,)
        Position, velocity and empirical acceleration, deputy less chief.
    covariance : ndarray, shape (9, 9)
    clock : float
        Receiver clock of the deputy less that of the chief, s.
    """

    def __init__(
        self,
        configuration: CdgpsConfiguration,
        mean: FloatArray,
        covariance: FloatArray,
        clock: float,
    ) -> None:
        self.configuration = configuration
        labels = [("motion", index) for index in range(DYNAMIC_STATES)]
        self.state = GaussianState(labels, mean, covariance)
        self.arcs = ArcBook()
        self.scatter = PhaseScatter()
        self.clock = clock
        self.attempt = FixAttempt((), 0.0, 0.0, "")
        self._code_reference: tuple[int, int, int] | None = None
        self._global_failures = 0
        if configuration.has_plasma:
            for layer, sigma in enumerate(configuration.layer_sigmas):
                self.state.add(("plasma", layer), 0.0, (sigma / DENSITY_UNIT) ** 2)

    def predict(self, predicted: Prediction, interval: float) -> None:
        """Go on by `interval` seconds with a motion that has been propagated."""
        state, configuration = self.state, self.configuration
        state.predict_leading(
            predicted.relative, predicted.transition_relative, predicted.noise_relative
        )
        if configuration.has_plasma:
            decay = math.exp(-interval / configuration.electron_density_time)
            for layer, sigma in enumerate(configuration.layer_sigmas):
                variance = (sigma / DENSITY_UNIT) ** 2
                state.predict_gauss_markov(("plasma", layer), decay, variance)
        walk = configuration.receiver_bias_walk**2 * interval
        for label in state.labels:
            if label[0] in ("code_bias", "phase_bias"):
                state.add_noise(label, walk)

    def update(
        self,
        time: GpsTime,
        interval: float,
        measured: SingleDifferences,
        sky: Sky,
        laser: LaserMeasurement | None,
    ) -> Update:
        """Use the single differences of an epoch.

        Parameters
        ----------
        time : GpsTime
        interval : float
            s since the epoch before.
        measured : SingleDifferences
        sky : Sky
            Seen for the present states and `clock`.
        laser : LaserMeasurement or None
        """
        state = self.state
        excluded: dict[SignalKey, str] = {}
        degraded: list[str] = []
        stated, measured = measured, self.scatter.with_scatter(measured)
        for key, reason in self.arcs.broken(time, measured, interval).items():
            self._end_arc(key)
            if reason != "not seen any more":
                excluded[key] = reason
        if laser is not None and ("laser_latency",) not in state:
            state.add(("laser_latency",), 0.0, self.configuration.laser_latency_sigma**2)
        clock = SPEED_OF_LIGHT * self.clock
        self._begin_arcs(time, measured, sky)
        before = measured.phase_variance
        innovation = self._without_faults(time, measured, sky, clock, laser, excluded, degraded)
        measured = _with_phase_noise(measured, innovation)
        risen = self.scatter.learn(time, stated, innovation, measured.phase_variance > before)
        state.update(innovation)
        for key, variance in risen.items():
            if self.arcs[key].integer is None:
                state.add_noise(("ambiguity", key), variance)
        nuisance = innovation.nuisance_gain @ innovation.values
        self.clock = (clock + float(nuisance[0])) / SPEED_OF_LIGHT
        self.arcs.keep(time, measured)
        update = Update(measured, sky, innovation, excluded, degraded)
        update.has_failed = self._has_failed(innovation)
        if not update.has_failed:
            update.fixed = self._fix(time, measured, sky, innovation)
        return update

    def _begin_arcs(self, time: GpsTime, measured: SingleDifferences, sky: Sky) -> None:
        """Add arcs and states for signals that have none."""
        state = self.state
        if all(key in self.arcs for key in measured.keys):
            return
        clock = upper_median(measured.code - sky.predicted - code_biases(state, measured))
        for row, key in enumerate(measured.keys):
            if key in self.arcs:
                continue
            if self._code_reference is None:
                self._code_reference = key.group
            label = ("code_bias", key.group)
            if key.group != self._code_reference and label not in state:
                state.add(label, 0.0, _UNKNOWN_CODE_BIAS_SIGMA**2)
            expected = float(sky.predicted[row] + clock)
            arc = self.arcs.start(time, measured, row, expected)
            wavelength = float(measured.wavelength[row])
            mean = arc.phase - wavelength * arc.offset_cycles - expected
            state.add(("ambiguity", key), mean, _UNKNOWN_AMBIGUITY_SIGMA**2)

    def _end_arc(self, key: SignalKey) -> None:
        """Forget an arc, its state, and the bias of its signal if no integer rests on it."""
        state = self.state
        had_integer = key in self.arcs and self.arcs[key].integer is not None
        self.arcs.end(key)
        state.remove([("ambiguity", key)])
        if had_integer and key.group not in self.arcs.fixed_groups():
            state.remove([("phase_bias", key.group)])

    def _without_faults(
        self,
        time: GpsTime,
        measured: SingleDifferences,
        sky: Sky,
        clock: float,
        laser: LaserMeasurement | None,
        excluded: dict[SignalKey, str],
        degraded: list[str],
    ) -> Innovation:
        """Return the innovation without faulty measurements.

        A phase that does not fit begins a new arc: at worst its ambiguity is decided anew. If those
        of several satellites do not fit, a common cause is looked for first.
        """
        scattered = self.scatter.scattered(measured)
        limit = self.configuration.fault_sigmas

        def judged() -> Judged:
            innovation = measurement_innovation(self.state, self.arcs, measured, sky, clock, laser)
            return without_faults(innovation, measured, scattered, limit)

        result = self._with_common_cause(judged, measured, degraded)
        count = len(measured)
        for _ in range(_DETECTION_PASSES):
            is_used = result.innovation.is_used
            slipped = np.flatnonzero(~is_used[count : 2 * count]).tolist()
            for row in slipped:
                key = measured.keys[row]
                excluded[key] = "cycle slip"
                self._end_arc(key)
            if not slipped:
                break
            self._begin_arcs(time, measured, sky)
            # What does not fit in the last pass is left out, so that this ends.
            result = judged()
        innovation = result.innovation
        for row in np.flatnonzero(~innovation.is_used[:count]).tolist():
            excluded.setdefault(measured.keys[row], "code outlier")
        if not innovation.is_used[2 * count :].all():
            degraded.append("laser range left out")
        return innovation

    def _with_common_cause(
        self, judged: Callable[[], Judged], measured: SingleDifferences, degraded: list[str]
    ) -> Judged:
        """Return the judged innovation; a surprise that explains it is added to the state.

        What does not fit at several satellites, or as a whole, may be plasma that has changed
        faster than its density should, as at the edge of a bubble, or motion that is not what was
        predicted. A cause is believed if it explains all; unknown motion also if most satellites
        do not fit without it, and few with it.
        """
        first = judged()
        state, satellites = self.state, len(np.unique(measured.satellite))
        odd = first.satellites(measured)
        if odd < 2 and not self._is_unlikely(first.innovation):
            return first
        for cause, variances in self._surprises():
            covariance = state.covariance.copy()
            for label, variance in variances.items():
                state.add_noise(label, variance)
            second = judged()
            explains_all = not second.odd and not self._is_unlikely(second.innovation)
            explains_most = 2 * odd > satellites >= 2 * second.satellites(measured)
            if explains_all or (explains_most and cause == _MOTION):
                degraded.append(f"the {cause} was not as predicted")
                return second
            state.covariance = covariance
        return first

    def _surprises(self) -> list[tuple[str, dict[Label, float]]]:
        """Return what may change at all satellites at once, and the variances it then has."""
        configuration, surprises = self.configuration, []
        if configuration.has_plasma:
            sigmas = np.array(configuration.layer_sigmas) / DENSITY_UNIT
            plasma = {("plasma", layer): s**2 for layer, s in enumerate(sigmas.tolist())}
            surprises.append((_PLASMA, plasma))
        if configuration.dynamics != "static":
            motion = {("motion", axis): _SURPRISE_SIGMAS[axis // 3] ** 2 for axis in range(6)}
            surprises.append((_MOTION, motion))
        return surprises

    def _has_failed(self, innovation: Innovation) -> bool:
        """Return whether the innovations of consecutive epochs are too large as a whole."""
        self._global_failures = self._global_failures + 1 if self._is_unlikely(innovation) else 0
        return self._global_failures >= _GLOBAL_FAILURES

    def _is_unlikely(self, innovation: Innovation) -> bool:
        """Return whether the innovations of an epoch are too large as a whole."""
        freedom = innovation.degrees_of_freedom
        if freedom <= 0:
            return False
        probability = float(gammaincc(0.5 * freedom, 0.5 * max(innovation.squared_norm, 0.0)))
        return probability < self.configuration.global_probability

    def _fix(
        self,
        time: GpsTime,
        measured: SingleDifferences,
        sky: Sky,
        innovation: Innovation,
    ) -> set[SignalKey]:
        """Make integers of what is certain; return the signals fixed at this epoch."""
        state, configuration = self.state, self.configuration
        count = len(measured)
        is_used = innovation.is_used[count : 2 * count]
        candidates = [
            self.arcs[key]
            for row, key in enumerate(measured.keys)
            if is_used[row]
            and measured.is_parity_known[row]
            and self._is_averaged(key, measured, row)
        ]
        if not candidates:
            return set()
        wavelength = dict(zip(measured.keys, measured.wavelength.tolist(), strict=True))
        elevation = dict(zip(measured.keys, sky.elevation.tolist(), strict=True))
        self.attempt = fix_ambiguities(
            state,
            time,
            candidates,
            wavelength,
            elevation,
            configuration.success_rate,
            configuration.failure_rate,
            configuration.smallest_ratio,
            {key for key in measured.keys if self.scatter.variance(key) > 0.0},
        )
        return set(self.attempt.fixed)

    def _is_averaged(self, key: SignalKey, measured: SingleDifferences, row: int) -> bool:
        """Return whether the ambiguity is still to be decided, and its scatter averaged out."""
        arc = self.arcs[key]
        if arc.integer is not None:
            return False
        if self.scatter.variance(key) == 0.0:
            return True
        needed = epochs_to_average(
            float(measured.phase_variance[row]), float(measured.wavelength[row]), _AVERAGED_CYCLES
        )
        return arc.epochs >= max(needed, _FEWEST_EPOCHS_IN_SCATTER)

    def kind(self, update: Update) -> tuple[int, int, int]:
        """Return the kind of solution, the satellites used and the integers it rests on."""
        measured, innovation = update.measured, update.innovation
        count = len(measured)
        code_used = innovation.is_used[:count]
        phase_used = innovation.is_used[count : 2 * count]
        satellites = len(np.unique(measured.satellite[code_used | phase_used]))
        used = [key for key, is_used in zip(measured.keys, phase_used, strict=True) if is_used]
        with_integer = [key for key in used if self.arcs[key].integer is not None]
        if len({key.satellite for key in with_integer}) >= _FEWEST_FIXED_SATELLITES:
            return SOLUTION_FIXED, satellites, len(with_integer)
        return (SOLUTION_FLOAT if used else SOLUTION_CODE), satellites, len(with_integer)

    def local_density(self) -> tuple[float, float]:
        """Return the electron density at the chief and its sigma, 1/m3; NaN if not estimated."""
        state = self.state
        layers = [place for place, label in enumerate(state.labels) if label[0] == "plasma"]
        if not layers:
            return math.nan, math.nan
        variance = float(state.covariance[np.ix_(layers, layers)].sum())
        total = float(state.mean[layers].sum())
        return DENSITY_UNIT * total, DENSITY_UNIT * math.sqrt(variance)

    def laser(self, measured: LaserMeasurement | None) -> tuple[float, float, float]:
        """Return latency (s), its sigma and the range less that of the state (m); NaN without."""
        label = ("laser_latency",)
        if label not in self.state:
            return math.nan, math.nan, math.nan
        latency, sigma = self.state.value(label), self.state.sigma(label)
        if measured is None:
            return latency, sigma, math.nan
        position, velocity = self.state.mean[:3], self.state.mean[3:6]
        distance = float(np.linalg.norm(position))
        rate = float(position @ velocity) / distance
        return latency, sigma, measured.range - distance - latency * rate


def _with_phase_noise(measured: SingleDifferences, innovation: Innovation) -> SingleDifferences:
    """Return single differences with the variances with which their phases are used."""
    count = len(measured)
    return replace(measured, phase_variance=innovation.noise[count : 2 * count].copy())
