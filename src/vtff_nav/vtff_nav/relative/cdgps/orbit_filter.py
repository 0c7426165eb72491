"""Absolute motion of one receiver from its own observations, aided by its dynamics.

There is no ionosphere model. With two frequencies the ionosphere-free combinations of code and
phase are used, with one frequency GRAPHIC, the mean of code and phase (Yunck 1993), in which the
ionospheric delay cancels. The ambiguities of the phases are real numbers.

Each satellite has a range error: that of its broadcast orbit and clock, and the bias of its codes.
It is a state of code and phase alike, so that neither averages it out (Montenbruck and Ramos-Bosch
2008, GPS Solutions 12:187, have it in the ambiguities). Its sigma is estimated.
"""

from __future__ import annotations

import functools
import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import GM_EARTH, SPEED_OF_LIGHT
from vtff_dynamics.frames.earth import state_itrf_to_gcrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray, norm
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.orbits.satellite_table import SatelliteTable
from vtff_nav.relative.cdgps.carrier_book import CarrierBook, CarrierLabel
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.omitted_accelerations import omitted_share
from vtff_nav.relative.cdgps.state import GaussianState, Innovation, Label
from vtff_nav.relative.common.columns import are_all, is_any, with_columns
from vtff_nav.relative.common.dynamics import DYNAMIC_STATES
from vtff_nav.relative.common.measurements import Geometry, SignalTable
from vtff_nav.relative.common.orbit_single_point import (
    Combinations,
    SinglePoint,
    form_combinations,
    solve_single_point,
    troposphere_delay,
)
from vtff_nav.relative.kernels.combinations import mean_of_combinations
from vtff_nav.relative.kernels.differences import find_worst_measurement
from vtff_nav.relative.kernels.orbit import orbit_measurements, predict_codes
from vtff_nav.relative.noise.acceleration import AccelerationMonitor

__all__ = [
    "CHIEF_KINDS",
    "CHIEF_MOTION",
    "RELATIVE_MOTION",
    "AbsoluteFilter",
    "mean_of_receivers",
]

RELATIVE_MOTION: list[Label] = [("motion", index) for index in range(DYNAMIC_STATES)]
"""Labels of position, velocity and empirical acceleration of the deputy less those of the chief."""

CHIEF_MOTION: list[Label] = [("chief", index) for index in range(DYNAMIC_STATES)]
"""Labels of position, velocity (navigation axes) and empirical acceleration of the chief."""

CHIEF_KINDS = ("chief", "chief_ambiguity", "range_error")
"""Kinds of all members of the state of the chief."""

_LONGEST_ARC_GAP = 5.0
_UNKNOWN_AMBIGUITY_SIGMA = 30.0
# Sigma of the delay of a code on one frequency in low orbit or on the ground, m.
_SINGLE_FREQUENCY_DELAY_SIGMA = 5.0
_RESTART_EPOCHS = 5
_DETECTION_PASSES = 5
# The sigma of range errors follows its estimate in steps of this factor; not below the last, m.
_SIGMA_STEP, _SMALLEST_RANGE_SIGMA = 1.1, 0.05
_SIGMA_ITERATIONS = 3
# Range errors in view that tell of their sigma; the degrees of freedom that the stated sigma stands
# for; and the factor of likelihood that tells there are only biases.
_FEWEST_RANGE_ERRORS = 6
# They hardly change: their sigma is learnt at so many first updates, then at one of each cycle.
_UPDATES_OF_LEARNING, _LEARNING_CYCLE = 60, 10
_STATED_FREEDOM, _QUIET_EVIDENCE = 10.0, 500.0
# Sigmas by which range errors are larger than biases of codes where there are broadcast errors.
_SIGNIFICANT_SIGMAS = 2.0
# What the ionosphere-free combination of L1 and L2 makes of an error of both phases.
_COMBINATION_FACTOR = 3.0
# Sigmas by which a phase of the deputy may differ from that of the chief.
_LARGEST_DIFFERENCE = 5.0
# Sigmas added to position and velocity when the motion was not as predicted, m and m/s.
_UNPREDICTED_MOTION_SIGMAS = (10.0, 1.0)

_NO_PHASES, _NO_SLIPS = np.zeros(0, dtype=bool), np.zeros(0)


class AbsoluteFilter:
    """Position, velocity and clock of the chief.

    Parameters
    ----------
    configuration : CdgpsConfiguration
    """

    def __init__(self, configuration: CdgpsConfiguration) -> None:
        self._configuration = configuration
        self._is_orbital = configuration.chief_motion == "orbital"
        self._mask = math.radians(configuration.elevation_mask_deg)
        self.reset()

    def reset(self) -> None:
        """Forget every estimate."""
        self.state: GaussianState | None = None
        self.clock = 0.0
        self._last_point: SinglePoint | None = None
        self._carriers = CarrierBook()
        self._failures = self._updates = 0
        self._range_sigma = self._configuration.ephemeris_sigma
        # Whether range errors are biases of codes alone.
        self._is_quiet = False
        # What offsets of satellites add to the logarithm of the likelihood of that.
        self._offset_evidence = 0.0
        # Degrees of freedom of that sigma, squared.
        self._freedom = _STATED_FREEDOM
        self.acceleration = AccelerationMonitor(self._configuration.noise_chief)

    @property
    def broadcast_sigma(self) -> float:
        """Sigma of the errors of broadcast orbits and clocks in a range, m, as estimated.

        It is what range errors exceed the biases of codes by, which no message tells either, if
        they do so by more than the sigma of biases is uncertain.
        """
        bias = self._configuration.code_bias_sigma
        excess = self._range_sigma**2 - bias**2
        is_significant = excess > _SIGNIFICANT_SIGMAS * math.sqrt(2.0 / self._freedom) * bias**2
        return math.sqrt(excess) if is_significant else 0.0

    @property
    def mean(self) -> FloatArray:
        """Position, velocity (navigation axes) and empirical acceleration, shape (9,)."""
        assert self.state is not None
        return self.state.mean[self.motion]

    @property
    def covariance(self) -> FloatArray:
        """Covariance of position and velocity (navigation axes), shape (6, 6)."""
        assert self.state is not None
        return self.state.covariance[self.motion, self.motion][:6, :6]

    @property
    def motion(self) -> slice:
        """Columns of position, velocity and empirical acceleration."""
        assert self.state is not None
        first = self.state.index(CHIEF_MOTION[0])
        return slice(first, first + DYNAMIC_STATES)

    def part_from_relative(self) -> None:
        """Have a state of its own again, that of the chief out of one that holds others too."""
        assert self.state is not None
        self.state = self.state.part(*CHIEF_KINDS)

    def start(
        self, time: GpsTime, tag: GpsTime, signals: SignalTable, table: SatelliteTable
    ) -> bool:
        """Start from the codes of one epoch, or of two epochs without Doppler; return whether.

        Parameters
        ----------
        time : GpsTime
            Epoch of the first state.
        tag : GpsTime
            Time tag of the observations.
        signals : SignalTable
        table : SatelliteTable
        """
        configuration = self._configuration
        measured = form_combinations(signals, table)
        point = solve_single_point(measured, table, tag, self._mask, configuration.has_troposphere)
        if point is None:
            return False
        last, self._last_point = self._last_point, point
        is_dual = bool(np.median(measured.second_band) > 0)
        bias = configuration.ephemeris_sigma if is_dual else 2.0 * _SINGLE_FREQUENCY_DELAY_SIGMA
        covariance = np.zeros((DYNAMIC_STATES, DYNAMIC_STATES))
        covariance[:3, :3] = 4.0 * point.covariance + bias**2 * np.eye(3)
        self.acceleration = AccelerationMonitor(configuration.noise_chief)
        covariance[6:, 6:] = configuration.noise_chief.empirical_sigma**2 * np.eye(3)
        mean = np.zeros(DYNAMIC_STATES)
        received = tag - point.clock / SPEED_OF_LIGHT
        if self._is_orbital:
            state = self._first_orbital_state(received, point, last, covariance)
            if state is None:
                return False
            mean[:6] = state
            mean[:3] += (time - received) * state[3:]
        else:
            mean[:3] = point.position_itrf
            if configuration.chief_motion == "kinematic":
                covariance[3:6, 3:6] = 100.0 * np.eye(3)
            if configuration.position_chief_itrf is not None:
                mean[:3] = configuration.position_chief_itrf
                covariance[:3, :3] = 1e-8 * np.eye(3)
        self.clock = point.clock / SPEED_OF_LIGHT
        self.state = GaussianState(CHIEF_MOTION, mean, covariance)
        self._carriers = CarrierBook()
        self._failures = 0
        return True

    @staticmethod
    def _first_orbital_state(
        time: GpsTime, point: SinglePoint, last: SinglePoint | None, covariance: FloatArray
    ) -> FloatArray | None:
        """Return position and velocity in GCRF; set the covariance of the velocity.

        Without Doppler the velocity comes from the positions of two epochs; None if the last
        position is missing or too old.
        """
        if np.isfinite(point.velocity_itrf).all():
            covariance[3:6, 3:6] = point.velocity_sigma**2 * np.eye(3)
            return state_itrf_to_gcrf(
                time, np.concatenate((point.position_itrf, point.velocity_itrf))
            )
        if last is None or not 0.0 < point.time - last.time < 30.0:
            return None
        zero = np.zeros(3)
        time_before = last.time - last.clock / SPEED_OF_LIGHT
        duration = time - time_before
        now = state_itrf_to_gcrf(time, np.concatenate((point.position_itrf, zero)))[:3]
        before = state_itrf_to_gcrf(time_before, np.concatenate((last.position_itrf, zero)))[:3]
        gravity = -GM_EARTH * now / float(now @ now) ** 1.5
        velocity = (now - before) / duration + 0.5 * duration * gravity
        covariance[3:6, 3:6] = 2.0 * covariance[:3, :3] / duration**2
        return np.concatenate((now, velocity))

    def trust_forces(self) -> None:
        """Have no larger unmodelled acceleration than the force model leaves out in this orbit.

        Without this the sigma of `CdgpsConfiguration.noise_chief` holds until measurements show
        less, as for motion that is simulated with less gravity than the filter knows.
        """
        state, noise = self.state, self._configuration.noise_chief
        assert state is not None
        factor = omitted_share(self._configuration, norm(self.mean[:3]))
        last = self.acceleration.factor
        if factor < last:
            sigma, last_sigma = (f * noise.empirical_sigma for f in (factor, last))
            state.reweigh(CHIEF_MOTION[6:], last_sigma**2, sigma**2)
            self.acceleration = AccelerationMonitor(noise, factor)

    def code_error(self, epoch: ObservationEpoch | None, state_itrf: FloatArray) -> FloatArray:
        """Return the error of the position from codes of a surveyed chief, m, shape (3,).

        It is known at the epoch of the start only, and zero otherwise.
        """
        point = self._last_point
        is_surveyed = self._configuration.position_chief_itrf is not None
        if not is_surveyed or epoch is None or point is None or point.time != epoch.time:
            return np.zeros(3)
        return point.position_itrf - state_itrf[:3]

    def predict(
        self, mean: FloatArray, transition: FloatArray, noise: FloatArray, interval: float
    ) -> None:
        """Propagate the state by an interval, s; see `GaussianState.predict_block`."""
        state = self.state
        assert state is not None
        if self._is_orbital:
            motion = self.motion
            self.acceleration.learn(
                state.mean[motion], state.covariance[motion, motion], 0.0, interval
            )
        state.predict_block(self.motion.start, mean, transition, noise)
        # Only broadcast errors change: Gauss-Markov processes, far shorter than their time.
        drift = 2.0 * self.broadcast_sigma**2 / self._configuration.ephemeris_time * interval
        if drift > 0.0:
            for label in self._range_errors:
                state.add_noise(label, drift)

    def update(
        self,
        time: GpsTime,
        signals: SignalTable,
        table: SatelliteTable,
        seen: Geometry,
        signals_deputy: SignalTable | None = None,
        slow_phase_sigma: float = math.inf,
        scatter_sigma: float = 0.0,
    ) -> None:
        """Update the state with the observations of an epoch.

        Parameters
        ----------
        time : GpsTime
        signals : SignalTable
        table : SatelliteTable
        seen : Geometry
            Geometry for the present states and clocks.
        signals_deputy : SignalTable, optional
            Given where the position of the deputy relative to the chief is known far better than
            codes tell: its codes are then further ones of the chief. So are its carrier ranges, if
            the ambiguities of the differences have been taken off them; the others are NaN.
        slow_phase_sigma : float
            Sigma of slow errors of the phases of a receiver, m. No more than
            `CdgpsConfiguration.ephemeris_phase_sigma` is taken for them in the combination.
        scatter_sigma : float
            Sigma of the scatter of the phases of a receiver where most of the sky scintillates, m;
            0 elsewhere. Their jumps are then no motion that was not predicted.
        """
        state = self.state
        assert state is not None
        measured = form_combinations(signals, table)
        if signals_deputy is None:
            shares = np.zeros((2, len(measured)))
        else:
            deputy = form_combinations(signals_deputy, table)
            measured, shares = mean_of_receivers(measured, deputy, seen)
        slow_phase_sigma = min(
            self._configuration.ephemeris_phase_sigma, _COMBINATION_FACTOR * slow_phase_sigma
        )
        phase_sigma = np.hypot(measured.phase_sigma, slow_phase_sigma)
        if scatter_sigma > 0.0:
            phase_sigma = np.hypot(phase_sigma, _COMBINATION_FACTOR * scatter_sigma)
        measured = with_columns(measured, phase_sigma=phase_sigma)
        rows = seen.columns(measured.satellite)
        clock = SPEED_OF_LIGHT * self.clock
        predicted, elevation = predict_codes(rows, seen.range, seen.clock, seen.elevation, clock)
        is_high = elevation > self._mask
        if not are_all(is_high):
            measured, rows = measured.select(is_high), rows[is_high]
            shares = shares.compress(is_high, axis=1)
            predicted, elevation = predicted[is_high], elevation[is_high]
        if not len(measured):
            return
        if self._configuration.has_troposphere:
            predicted = predicted + troposphere_delay(self.mean[:3], elevation)
        self._follow_ambiguities(time, measured, predicted)
        may_doubt_motion = self._configuration.chief_motion != "static" and not scatter_sigma
        covariance_before: FloatArray | None = None
        for _ in range(_DETECTION_PASSES):
            innovation = self._innovation(measured, rows, shares, seen, predicted)
            self._leave_out_faults(innovation)
            first_phase, slipped = len(innovation.values) - len(measured), []
            if not innovation.are_all_used:
                slipped = np.flatnonzero(~innovation.is_used[first_phase:]).tolist()
            if covariance_before is not None and 4 * len(slipped) > len(measured):
                # Motion explains them no better: phases of most satellites scintillate.
                state.covariance, covariance_before = covariance_before, None
                continue
            covariance_before = None
            if not slipped:
                break
            if may_doubt_motion and 2 * len(slipped) > len(measured):
                # So many phases do not slip at once: the motion was not as predicted.
                may_doubt_motion, covariance_before = False, state.covariance.copy()
                for axis in range(6):
                    sigma = _UNPREDICTED_MOTION_SIGMAS[axis // 3]
                    state.add_noise(CHIEF_MOTION[axis], sigma**2)
                continue
            labels = self._carriers.columns(measured, state).labels
            for row in slipped:
                state.remove([labels[row]])
                self._carriers.forget([labels[row]])
            self._follow_ambiguities(time, measured, predicted)
        # Phases that do not fit begin anew and fit then: codes show a state that is wrong.
        is_code_used = innovation.is_used[: len(innovation.values) - len(measured)]
        is_bad = 2 * np.count_nonzero(~is_code_used) > len(is_code_used)
        self._failures = self._failures + 1 if is_bad else 0
        state.update(innovation)
        nuisance = innovation.nuisance_gain @ innovation.values
        self.clock += float(nuisance[0]) / SPEED_OF_LIGHT
        self._learn_range_sigma()
        if self._failures >= _RESTART_EPOCHS:
            self.reset()

    def _leave_out_faults(self, innovation: Innovation) -> None:
        """Leave the worst measurement out until none is a fault."""
        while innovation.degrees_of_freedom > 0:
            residual, variance = innovation.leave_one_out
            worst = find_worst_measurement(
                residual,
                variance,
                innovation.noise,
                _NO_PHASES,
                _NO_SLIPS,
                self._configuration.fault_sigmas,
            )
            if worst < 0 or math.isnan(residual[worst]):
                break
            innovation.leave_out(worst)

    @property
    def _range_errors(self) -> list[Label]:
        """Labels of the range errors in the state."""
        assert self.state is not None
        return self.state.labels_of("range_error")

    def _learn_range_sigma(self) -> None:
        """Adapt the a priori sigma of range errors to their estimates (MacKay 1992).

        A few satellites tell little of a sigma, so that the stated one counts with them or, where
        the errors are too small for broadcast errors, that of the biases of the codes. They are too
        small where the likelihood of such biases is larger by a factor of `_QUIET_EVIDENCE`: with
        stated errors that happens to no more than its inverse of all flights, at any of their
        epochs (Ville 1939).
        """
        state = self.state
        assert state is not None
        labels = self._range_errors
        self._updates += 1
        if len(labels) < _FEWEST_RANGE_ERRORS or (
            self._updates > _UPDATES_OF_LEARNING and self._updates % _LEARNING_CYCLE
        ):
            return
        columns = [state.index(label) for label in labels]
        last = self._range_sigma**2
        weight = np.linalg.inv(state.covariance[np.ix_(columns, columns)])
        told, axes = np.linalg.eigh(weight - np.eye(len(columns)) / last)
        told = told.clip(0.0)
        score = axes.T @ (weight @ state.mean[columns])
        evidence = self._quiet_evidence()
        self._is_quiet = evidence > (0.0 if self._is_quiet else math.log(_QUIET_EVIDENCE))
        stated, biases = self._configuration.ephemeris_sigma, self._configuration.code_bias_sigma
        expected, variance = biases if self._is_quiet else stated, last
        for _ in range(_SIGMA_ITERATIONS):
            gain = variance / (1.0 + variance * told)
            freedom, square = float(gain @ told), float(np.sum((gain * score) ** 2))
            variance = (square + _STATED_FREEDOM * expected**2) / (freedom + _STATED_FREEDOM)
        self._freedom = freedom + _STATED_FREEDOM
        sigma = max(math.sqrt(variance), _SMALLEST_RANGE_SIGMA)
        if not 1.0 / _SIGMA_STEP < sigma / self._range_sigma < _SIGMA_STEP:
            state.reweigh(labels, last, sigma**2)
            self._range_sigma = sigma

    def _quiet_evidence(self) -> float:
        """Return the log likelihood of biases of codes alone less that of stated broadcast errors.

        Errors of broadcast orbits also move satellites across their rays. Where these offsets are
        members of the state, differences of phases with integers tell of them at once: over 225 km
        2 m change a phase by 2 cm. When they have left, what they told counts as far as it decides.
        """
        state, ranges, offset_sigma = self.state, self._range_errors, self.broadcast_sigma
        assert state is not None
        stated, biases = self._configuration.ephemeris_sigma, self._configuration.code_bias_sigma
        # Prior sigmas of ranges and of offsets: as they are, without and with broadcast errors.
        sigmas = ((self._range_sigma, offset_sigma), (biases, 0.0), (stated, stated))

        def evidence(offsets: list[Label]) -> float:
            counts = (len(ranges), len(offsets))
            last, quiet, loud = (np.repeat(np.square(pair), counts) for pair in sigmas)
            both = state.log_likelihoods([*ranges, *offsets], last, np.array([quiet, loud]))
            return float(both[0] - both[1])

        of_ranges = evidence([])
        offsets = state.labels_of("satellite_offset")
        if not offsets or offset_sigma == 0.0:
            return of_ranges + self._offset_evidence
        of_all = evidence(offsets)
        self._offset_evidence = min(of_all - of_ranges, math.log(_QUIET_EVIDENCE))
        return of_all

    def _follow_ambiguities(
        self, time: GpsTime, measured: Combinations, predicted: FloatArray
    ) -> None:
        """Have the ambiguities of an epoch in the state, new ones where carriers have slipped.

        Ambiguities that were not seen for long leave the state.
        """
        state, carriers = self.state, self._carriers
        assert state is not None
        columns = carriers.columns(measured, state)
        is_broken = carriers.find_breaks(time, measured, columns)
        if not columns.are_members or is_any(is_broken):
            self._start_ambiguities(columns.labels, is_broken, measured, predicted)
        carriers.record(time, measured, columns)
        if len(carriers) > len(measured):
            old = carriers.find_old(time, _LONGEST_ARC_GAP)
            if old:
                state.remove(old)
                carriers.forget(old)
                # The range error of a satellite lasts as long as its ambiguities.
                present = carriers.satellites
                state.remove([label for label in self._range_errors if label[1] not in present])

    def _start_ambiguities(
        self,
        labels: list[CarrierLabel],
        is_broken: npt.NDArray[np.bool_],
        measured: Combinations,
        predicted: FloatArray,
    ) -> None:
        """Add ambiguities, and range errors, that are no members; start broken ones anew."""
        state = self.state
        assert state is not None
        residual = measured.phase - predicted
        for row, label in enumerate(labels):
            _, satellite, band = label
            if band and ("range_error", satellite) not in state:
                state.add(("range_error", satellite), 0.0, self._range_sigma**2)
            if is_broken[row]:
                state.remove([label])
            if label in state:
                continue
            if band:
                state.add(label, float(residual[row]), _UNKNOWN_AMBIGUITY_SIGMA**2)
            else:
                # Phase less code, whose errors are the ionospheric delay and the code noise.
                mean = float(measured.phase[row] - measured.code[row])
                sigma = math.hypot(_SINGLE_FREQUENCY_DELAY_SIGMA, measured.code_sigma[row])
                state.add(label, mean, sigma**2)

    def _innovation(
        self,
        measured: Combinations,
        rows: npt.NDArray[np.intp],
        shares: FloatArray,
        seen: Geometry,
        predicted: FloatArray,
    ) -> Innovation:
        """Return the innovation of codes, then phases.

        Codes are used of satellites with two frequencies only. `shares` are those of the deputy in
        codes and phases, see `mean_of_receivers`.
        """
        state = self.state
        assert state is not None
        columns = self._carriers.columns(measured, state)
        design, values, variances, nuisance = orbit_measurements(
            state.mean,
            self.motion.start,
            state.find(RELATIVE_MOTION[0]),
            columns.ambiguities,
            columns.range_errors,
            columns.code_rows,
            rows,
            shares,
            seen.direction,
            seen.range_rate,
            np.array((measured.code, measured.phase)) - predicted,
            np.array((measured.code_sigma, measured.phase_sigma)),
            measured.system,
            columns.systems,
        )
        return state.innovation(design, values, variances, nuisance)


def mean_of_receivers(
    chief: Combinations, deputy: Combinations, seen: Geometry
) -> tuple[Combinations, FloatArray]:
    """Return the measurements of the chief with the means of both receivers, and their shares.

    What the measurements of the deputy are off by, less the mean over all satellites (its clock),
    is that of further measurements of the chief. Satellites that have not two carriers at both stay
    as they are.

    Parameters
    ----------
    chief, deputy : Combinations
        Phases of the deputy have the ambiguities of the chief's; they are NaN where these are not
        known.
    seen : Geometry

    Returns
    -------
    Combinations
        The satellites are those of `chief`.
    ndarray, shape (2, n)
        Shares of the deputy in the codes and phases of n satellites.
    """
    of_chief, of_deputy = _pair_satellites(
        chief.satellite.tobytes(),
        chief.second_band.tobytes(),
        deputy.satellite.tobytes(),
        deputy.second_band.tobytes(),
    )
    if not len(of_chief):
        return chief, np.zeros((2, len(chief)))
    numbers, shares = mean_of_combinations(
        of_chief,
        of_deputy,
        seen.columns(chief.satellite),
        seen.range,
        seen.clock,
        chief.is_lock_lost,
        chief.code,
        chief.code_sigma,
        chief.phase,
        chief.phase_sigma,
        deputy.code,
        deputy.code_sigma,
        deputy.phase,
        deputy.phase_sigma,
        _LARGEST_DIFFERENCE,
    )
    code, code_sigma, phase, phase_sigma = numbers
    mean = with_columns(
        chief, code=code, code_sigma=code_sigma, phase=phase, phase_sigma=phase_sigma
    )
    return mean, shares


@functools.lru_cache(maxsize=16)
def _pair_satellites(
    chief: bytes, bands_chief: bytes, deputy: bytes, bands_deputy: bytes
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the rows of the satellites with the same two carriers at both receivers.

    The columns are those of satellites and second bands, which stay the same for minutes.
    """
    _, of_chief, of_deputy = np.intersect1d(
        np.frombuffer(chief, dtype=np.int64),
        np.frombuffer(deputy, dtype=np.int64),
        assume_unique=True,
        return_indices=True,
    )
    band = np.frombuffer(bands_chief, dtype=np.int64)[of_chief]
    is_dual = (band > 0) & (band == np.frombuffer(bands_deputy, dtype=np.int64)[of_deputy])
    return of_chief[is_dual], of_deputy[is_dual]
