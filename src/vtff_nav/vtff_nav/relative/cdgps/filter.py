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
from vtff_nav.relative.cdgps.measurement_faults import FaultSearch, reject_faults
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

# Sigmas of unknown states: far above the values that occur, and far below a loss of digits.
_UNKNOWN_AMBIGUITY_SIGMA = 10.0
_UNKNOWN_CODE_BIAS_SIGMA = 20.0

_PLASMA, _MOTION = "plasma", "motion"
# Sigmas added to position and velocity when the motion was not as predicted, m and m/s.
_UNPREDICTED_MOTION_SIGMAS = (10.0, 1.0)
_DETECTION_PASSES = 6
_GLOBAL_FAILURES = 2
_FEWEST_FIXED_SATELLITES = 4
# In scatter the errors of a single phase are far from normal. An ambiguity is then fixed only after
# so many epochs, and when the sigma of their mean is below this, cycles.
_FEWEST_EPOCHS_IN_SCATTER = 3
_AVERAGED_CYCLES = 0.05


@dataclass(eq=False)
class Update:
    """Result of the measurement update of an epoch.

    Parameters
    ----------
    measured : SingleDifferences
        Single differences with the variances with which they were used.
    sky : Sky
    innovation : Innovation
        Innovation with which the state was updated.
    excluded : dict of SignalKey to str
        Signals whose code was left out or whose arc has ended, and why.
    degraded : list of str
        Sentences for people on what was not as predicted.
    fixed : set of SignalKey
        Signals whose integer was fixed at this epoch.
    has_failed : bool
        Whether the innovations are too large as a whole, so that the state cannot be trusted.
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
        """RMS of the normalised innovations, their normalised square, its degrees of freedom."""
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
        if configuration.antennas is not None:
            for label, variance in configuration.antennas.offset_variances().items():
                self.state.add(label, 0.0, variance)

    def predict(self, predicted: Prediction, interval: float) -> None:
        """Propagate the state by `interval` seconds; `predicted` is the motion."""
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
        """Update the state with the single differences of an epoch, and fix ambiguities.

        Parameters
        ----------
        time : GpsTime
        interval : float
            Time since the last epoch, s.
        measured : SingleDifferences
        sky : Sky
            Sky for the present states and `clock`.
        laser : LaserMeasurement or None
        """
        state = self.state
        excluded: dict[SignalKey, str] = {}
        degraded: list[str] = []
        stated, measured = measured, self.scatter.add_excess(measured)
        for key, reason in self.arcs.find_breaks(time, measured, interval).items():
            self._end_arc(key)
            if reason != "not seen any more":
                excluded[key] = reason
        if laser is not None and ("laser_latency",) not in state:
            state.add(("laser_latency",), 0.0, self.configuration.laser_latency_sigma**2)
        clock = SPEED_OF_LIGHT * self.clock
        self._start_arcs(time, measured, sky)
        variance_before = measured.phase_variance
        innovation = self._reject_faults(time, measured, sky, clock, laser, excluded, degraded)
        measured = _with_phase_noise(measured, innovation)
        is_phase_fault = measured.phase_variance > variance_before
        missing_variances = self.scatter.learn(time, stated, innovation, is_phase_fault)
        state.update(innovation)
        for key, variance in missing_variances.items():
            if self.arcs[key].integer is None:
                state.add_noise(("ambiguity", key), variance)
        nuisance = innovation.nuisance_gain @ innovation.values
        self.clock = (clock + float(nuisance[0])) / SPEED_OF_LIGHT
        self.arcs.record(time, measured)
        update = Update(measured, sky, innovation, excluded, degraded)
        update.has_failed = self._has_failed(innovation)
        if not update.has_failed:
            update.fixed = self._fix(time, measured, sky, innovation)
        return update

    def _start_arcs(self, time: GpsTime, measured: SingleDifferences, sky: Sky) -> None:
        """Add arcs and states for signals without an arc."""
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
            expected_phase = float(sky.predicted[row] + clock)
            arc = self.arcs.start(time, measured, row, expected_phase)
            wavelength = float(measured.wavelength[row])
            mean = arc.phase - wavelength * arc.offset_cycles - expected_phase
            state.add(("ambiguity", key), mean, _UNKNOWN_AMBIGUITY_SIGMA**2)

    def _end_arc(self, key: SignalKey) -> None:
        """End an arc; remove its ambiguity, and the bias of its group without other integers."""
        state = self.state
        had_integer = key in self.arcs and self.arcs[key].integer is not None
        self.arcs.end(key)
        state.remove([("ambiguity", key)])
        if had_integer and key.group not in self.arcs.fixed_groups():
            state.remove([("phase_bias", key.group)])

    def _reject_faults(
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

        A faulty phase begins a new arc: at worst its ambiguity is fixed anew. If the phases of
        several satellites are faulty, a common cause is tried first.
        """
        is_scattered = self.scatter.is_scattered(measured)
        limit = self.configuration.fault_sigmas

        def search() -> FaultSearch:
            innovation = measurement_innovation(self.state, self.arcs, measured, sky, clock, laser)
            return reject_faults(innovation, measured, is_scattered, limit)

        result = self._explain_faults(search, measured, degraded)
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
            self._start_arcs(time, measured, sky)
            # Faulty phases of the last pass are left out, so that the search ends.
            result = search()
        innovation = result.innovation
        for row in np.flatnonzero(~innovation.is_used[:count]).tolist():
            excluded.setdefault(measured.keys[row], "code outlier")
        if not innovation.is_used[2 * count :].all():
            degraded.append("laser range left out")
        return innovation

    def _explain_faults(
        self, search: Callable[[], FaultSearch], measured: SingleDifferences, degraded: list[str]
    ) -> FaultSearch:
        """Search for faults; add the noise of a common cause to the state if that explains them.

        Faults at several satellites, or innovations that are too large as a whole, may come from
        plasma that changes faster than its model, as at the edge of a bubble, or from motion that
        was not predicted. A cause is believed if no fault is left with it. Motion is also believed
        if most satellites are faulty without it, and not most with it.
        """
        without_cause = search()
        state, satellites = self.state, len(np.unique(measured.satellite))
        faulty = without_cause.count_satellites(measured)
        if faulty < 2 and not self._is_unlikely(without_cause.innovation):
            return without_cause
        for cause, variances in self._common_causes():
            covariance = state.covariance.copy()
            for label, variance in variances.items():
                state.add_noise(label, variance)
            with_cause = search()
            is_likely = not self._is_unlikely(with_cause.innovation)
            explains_all = not with_cause.faulty_phases and is_likely
            explains_most = 2 * faulty > satellites >= 2 * with_cause.count_satellites(measured)
            if explains_all or (explains_most and cause == _MOTION):
                degraded.append(f"the {cause} was not as predicted")
                return with_cause
            state.covariance = covariance
        return without_cause

    def _common_causes(self) -> list[tuple[str, dict[Label, float]]]:
        """Return the names of common causes, and the variances that each adds to the state."""
        configuration = self.configuration
        causes: list[tuple[str, dict[Label, float]]] = []
        if configuration.has_plasma:
            sigmas = [sigma / DENSITY_UNIT for sigma in configuration.layer_sigmas]
            layers = enumerate(sigmas)
            causes.append((_PLASMA, {("plasma", layer): sigma**2 for layer, sigma in layers}))
        if configuration.dynamics != "static":
            position_sigma, velocity_sigma = _UNPREDICTED_MOTION_SIGMAS
            sigmas = [position_sigma] * 3 + [velocity_sigma] * 3
            axes = enumerate(sigmas)
            causes.append((_MOTION, {("motion", axis): sigma**2 for axis, sigma in axes}))
        return causes

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
        """Fix the ambiguities that are certain; return the signals fixed at this epoch."""
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
            success_rate=configuration.success_rate,
            failure_rate=configuration.failure_rate,
            smallest_ratio=configuration.smallest_ratio,
            scattered={key for key in measured.keys if self.scatter.variance(key) > 0.0},
        )
        return set(self.attempt.fixed)

    def _is_averaged(self, key: SignalKey, measured: SingleDifferences, row: int) -> bool:
        """Return whether an ambiguity is float, and any scatter of its phase averaged out."""
        arc = self.arcs[key]
        if arc.integer is not None:
            return False
        if self.scatter.variance(key) == 0.0:
            return True
        epochs = epochs_to_average(
            float(measured.phase_variance[row]), float(measured.wavelength[row]), _AVERAGED_CYCLES
        )
        return arc.epochs >= max(epochs, _FEWEST_EPOCHS_IN_SCATTER)

    def classify(self, update: Update) -> tuple[int, int, int]:
        """Return the kind of solution, the number of satellites used, and that of integers."""
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
        """Return the electron density at the chief and its sigma, 1/m3; NaN without plasma."""
        state = self.state
        layers = [index for index, label in enumerate(state.labels) if label[0] == "plasma"]
        if not layers:
            return math.nan, math.nan
        variance = float(state.covariance[np.ix_(layers, layers)].sum())
        total = float(state.mean[layers].sum())
        return DENSITY_UNIT * total, DENSITY_UNIT * math.sqrt(variance)

    def laser(self, measured: LaserMeasurement | None) -> tuple[float, float, float]:
        """Return latency (s), its sigma, and measured less predicted range (m); NaN without."""
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
    """Return single differences with the variances of the phases in an innovation."""
    count = len(measured)
    return replace(measured, phase_variance=innovation.noise[count : 2 * count].copy())
