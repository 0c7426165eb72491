"""The state of the deputy relative to the chief: measurements, faults and integers of an epoch."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray, norm
from vtff_gnss.constants import (
    ELECTRONS_PER_TECU,
    FLAG_HALF_CYCLE_ADDED,
    FLAG_LOCK_LOST,
)
from vtff_gnss.signals import SignalKey, signal_from_number
from vtff_nav.relative.cdgps.ambiguity_arcs import ArcBook
from vtff_nav.relative.cdgps.ambiguity_fixing import FixAttempt, fix_ambiguities
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.measurement_faults import FaultSearch, reject_faults
from vtff_nav.relative.cdgps.model import (
    PLASMA_KINDS,
    Sky,
    code_biases,
    measurement_innovation,
    phase_waves,
)
from vtff_nav.relative.cdgps.orbit_filter import CHIEF_KINDS, CHIEF_MOTION, RELATIVE_MOTION
from vtff_nav.relative.cdgps.phase_jumps import PhaseChanges, PhaseJumpDetector
from vtff_nav.relative.cdgps.phase_scatter import PhaseScatter, SlipRate, epochs_to_average
from vtff_nav.relative.cdgps.state import GaussianState, Innovation, Label
from vtff_nav.relative.common.columns import are_all, is_any, make_table, with_columns
from vtff_nav.relative.common.dynamics import DYNAMIC_STATES, MotionNoise, Prediction
from vtff_nav.relative.common.measurements import SignalTable, SingleDifferences, upper_median
from vtff_nav.relative.common.solution import (
    SOLUTION_CODE,
    SOLUTION_FIXED,
    SOLUTION_FLOAT,
    LaserMeasurement,
)
from vtff_nav.relative.kernels.gaussian import linear_motion
from vtff_nav.relative.kernels.noise import common_unknowns
from vtff_nav.relative.kernels.sky import DENSITY_UNIT
from vtff_nav.relative.noise.acceleration import AccelerationMonitor
from vtff_nav.relative.noise.components import SlowError
from vtff_nav.relative.noise.monitor import EpochResiduals, NoiseMonitor, NoisePrior
from vtff_nav.relative.noise.plasma_waves import PlasmaWaves

__all__ = ["RelativeFilter", "Update"]

# Sigmas of unknown states: far above the values that occur, and far below a loss of digits.
_UNKNOWN_AMBIGUITY_SIGMA = 10.0
_UNKNOWN_CODE_BIAS_SIGMA = 20.0

_PLASMA, _MOTION = "plasma", "motion"
# Sigmas added to position and velocity when the motion was not as predicted, m and m/s.
_UNPREDICTED_MOTION_SIGMAS = (10.0, 1.0)
# Satellites without scintillation that must be there before motion in orbit is doubted: two more
# than the unknowns of a position and a clock.
_FEWEST_WITNESSES_OF_MOTION = 6
_DETECTION_PASSES = 6
# The noise is learnt at so many first epochs, then at two consecutive ones of each cycle: it
# changes slowly.
_EPOCHS_OF_LEARNING, _LEARNING_CYCLE = 120, 5
# Variance below which an attitude is exact, rad2: 0.06 um at a lever arm of 0.6 m.
_LEAST_ATTITUDE_VARIANCE = 1e-14
# Sigmas beyond which an attitude is another one than that before it, as after a new start.
_ANOTHER_ATTITUDE = 5.0
# Limits of the white error of the thrust relative to its magnitude, the gain with which it follows
# the corrections, the largest of these as a multiple of their variance, and the change of velocity
# below which they say little of it, m/s.
_THRUST_SIGMAS = (5e-4, 0.1)
_THRUST_GAIN = 0.2
_LARGEST_CORRECTION = 6.0
_VELOCITY_NOISE = 5e-4
# The sigmas of slow errors and gradients in the state follow their estimates in steps of this
# factor. The number of quiet gradients that are counted with those of the shells, their step, and
# the number of sigmas that are weighed before there are integers.
_SIGMA_STEP = 1.25
_QUIET_GRADIENTS, _GRADIENT_STEP, _GRADIENT_MODELS = 4, 1.1, 8
# Errors of satellites' positions become states where they change a single difference by more than
# this, m.
_SMALLEST_RAY_ERROR = 1e-4
# A slow error that is not there, m.
_NEGLIGIBLE_SLOW_SIGMA = 5e-5
# Factor of the sigma of unmodelled accelerations of the difference that half an orbit of small ones
# may leave. Drag on the day side is three times that of the night side at 550 km, and more.
_SMALLEST_ACCELERATION_FACTOR = 0.3
# Power at low frequencies of phases without slow errors, m2 s; and the largest factor by which
# the covariance is raised where they turn out to be larger.
_WHITE_PHASE_POWER = 2e-6
_LARGEST_DOUBT = 25.0
# Kinds of members that codes, the orbit of the chief or a laser have told of, not the phases.
_KINDS_WITHOUT_PHASES = (*CHIEF_KINDS, "code_bias", "laser_latency")
_GLOBAL_FAILURES = 2
# With one more where nothing but the satellites tells of the motion, so that they check each other.
_FEWEST_FIXED_SATELLITES = 4
# After phases have contradicted each other, nothing is fixed at so many epochs.
_EPOCHS_OF_DOUBT = 30
# In scatter the errors of a single phase are far from normal. An ambiguity is then fixed only after
# so many epochs, and when the sigma of their mean is below this, cycles.
_FEWEST_EPOCHS_IN_SCATTER = 3
_AVERAGED_CYCLES = 0.05
# So many epochs count as one where most of the sky scintillates: fluctuations of strong
# scintillation last longer than an epoch.
_CORRELATED_EPOCHS = 3

_NO_COLUMNS = np.zeros(0, dtype=np.int64)
_DEPUTY = 1
"""Receiver of the deputy in labels; 0 is that of the chief."""


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
        rms = math.sqrt(float(normalised @ normalised) / innovation.used_count)
        return rms, innovation.squared_norm, innovation.degrees_of_freedom


@dataclass(frozen=True, eq=False)
class _MemberColumns:
    """Columns of a state.

    Parameters
    ----------
    labels_mark : object
        `GaussianState.labels_mark` of the state.
    contents, gradients : ndarray of int64
        Contents of shells, each before its gradients, and these.
    changed : ndarray of int64
        Members that motion changes: its own, and the contents.
    walking : ndarray of int64
        Biases that walk.
    has_waves, has_chief : bool
        Whether waves of the plasma, and the orbit of the chief, are members.
    """

    labels_mark: object
    contents: npt.NDArray[np.int64]
    gradients: npt.NDArray[np.int64]
    changed: npt.NDArray[np.int64]
    walking: npt.NDArray[np.int64]
    has_waves: bool
    has_chief: bool


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
        self._layer_sigmas = configuration.layer_sigmas
        self.state = GaussianState(RELATIVE_MOTION, mean, covariance)
        self.arcs = ArcBook()
        self.scatter = PhaseScatter(is_orbital=configuration.dynamics == "orbital")
        self._slips = SlipRate()
        self.jumps = PhaseJumpDetector(
            is_static=configuration.dynamics == "static",
            is_orbital=configuration.dynamics == "orbital",
        )
        prior = NoisePrior(
            configuration.slow_phase_sigma,
            configuration.slow_code_sigma,
            configuration.slow_error_time,
        )
        self.noise = NoiseMonitor(prior, configuration.slow_error_memory)
        self._slow_phase = self.noise.phase.slow
        self._satellite_offset = SlowError(0.0, configuration.ephemeris_time)
        self._gradient_sigma = configuration.plasma_gradient_sigma_tecu_per_deg
        self._waves = PlasmaWaves(
            configuration.plasma_wave_sigma_tecu,
            configuration.plasma_wave_length,
            configuration.plasma_wave_time,
        )
        self.thrust_sigma = configuration.thrust_relative_sigma
        self.acceleration = _monitor_accelerations(configuration.noise_relative)
        self._velocity_change = 0.0
        self._ground_rate_deg = 0.0
        self.clock = clock
        self.attempt = FixAttempt((), 0.0, 0.0, "")
        self._code_reference: tuple[int, int, int] | None = None
        self._global_failures = 0
        self._epochs_without_fix = 0
        # Signals whose phases have jumped, by no whole number of cycles as far as can be told.
        self._without_integers: set[SignalKey] = set()
        self._epochs, self._elapsed = 0, 0.0
        if configuration.has_plasma:
            for layer, sigma in enumerate(configuration.layer_sigmas):
                self.state.add(("plasma", layer), 0.0, (sigma / DENSITY_UNIT) ** 2)
            for shell in range(len(configuration.plasma_shell_heights)):
                for label in _shell_members(shell):
                    self.state.add(label, 0.0, self._plasma_sigma(label) ** 2)
        if configuration.has_troposphere:
            self.state.add(("troposphere",), 0.0, 1.0)
        if configuration.antennas is not None:
            for label, variance in configuration.antennas.offset_variances().items():
                self.state.add(label, 0.0, variance)
        self._attitude_variances: dict[Label, float] = {}
        self._known_columns: _MemberColumns | None = None
        self._known_decay: tuple[tuple[object, ...], tuple[FloatArray, ...]] | None = None

    def expect_accelerations(self, noise: MotionNoise) -> None:
        """Have unmodelled accelerations with another a priori noise."""
        distance = norm(self.state.mean[:3])
        last, self.acceleration = self.acceleration, _monitor_accelerations(noise)
        variances = self.acceleration.sigma(distance) ** 2
        variances_before = last.sigma(distance) ** 2
        for label, before, now in zip(
            RELATIVE_MOTION[6:], variances_before.tolist(), variances.tolist(), strict=True
        ):
            if before > 0.0 and now > 0.0:
                self.state.reweigh([label], before, now)

    def expect_attitude_errors(
        self, variances: Mapping[Label, float], turns: Mapping[Label, float]
    ) -> None:
        """Have errors of estimated attitudes in the state.

        Parameters
        ----------
        variances : mapping of label to float
            rad2, see `AntennaPair.attitude_variances`.
        turns : mapping of label to float
            By how much measurements have turned an attitude since the one before it, rad, see
            `AntennaPair.attitude_turns`. An attitude whose turn is not given, or by far too large
            for its sigmas, has an error of its own.

        Notes
        -----
        The error of the newer attitude is less by the turn. Its estimator expects it to be zero, as
        it expected that of the one before: the old expectation is taken back and the new one is
        told. So an error that navigation knows well follows the turns; one of which it knows no
        more than the estimator stays at zero, and the position follows the attitude. Were turns
        taken off alone, those that undo the drift of the attitude between them would sum up. That
        the variance is smaller is information, that it is larger is noise.
        """
        for label, given in variances.items():
            variance = max(given, _LEAST_ATTITUDE_VARIANCE)
            last = self._attitude_variances.get(label)
            if last is None:
                self.state.add(label, 0.0, variance)
            elif not abs(turns.get(label, math.inf)) < _ANOTHER_ATTITUDE * math.hypot(
                math.sqrt(last), math.sqrt(variance)
            ):
                self.state.renew(label, variance)
            else:
                column, turn = self.state.index(label), turns[label]
                self.state.mean[column] -= turn
                self.state.mean += self.state.covariance[:, column] * (turn / last)
                self.state.reweigh([label], last, variance)
            self._attitude_variances[label] = variance

    def predict(
        self,
        predicted: Prediction,
        interval: float,
        chief_motion_deg: FloatArray,
        rotation_body_to_rtn: FloatArray | None = None,
    ) -> None:
        """Propagate the state.

        Parameters
        ----------
        predicted : Prediction
        interval : float
            s.
        chief_motion_deg : ndarray, shape (2,)
            Motion of the chief over ground, to north and to east, geocentric angles.
        rotation_body_to_rtn : ndarray, shape (3, 3), optional
            From the body axes of the deputy to the axes of its thrust, where the error of its
            attitude turns the thrust.
        """
        state, configuration = self.state, self.configuration
        # The first error is the scale: what it changes is the velocity gained by the thrust.
        self._velocity_change = norm(predicted.thrust_coupling[3:6, 0])
        thrust: list[Label] = []
        if self._velocity_change > 0.0:
            sigmas = configuration.thrust_sigmas
            thrust = [("thrust", error) for error in range(len(sigmas))]
            for label, sigma in zip(thrust, sigmas, strict=True):
                if label not in state:
                    state.add(label, 0.0, sigma**2)
        self._ground_rate_deg = math.hypot(*chief_motion_deg) / interval
        turn_columns, turn_coupling = _NO_COLUMNS, predicted.thrust_coupling
        if thrust and rotation_body_to_rtn is not None:
            attitude: list[Label] = [("attitude_error", _DEPUTY, axis) for axis in range(3)]
            if attitude[0] in state:
                turn_columns = np.array([state.index(label) for label in attitude], dtype=np.int64)
                turn_coupling = predicted.thrust_coupling[:, 1:] @ rotation_body_to_rtn
        members = self._member_columns()
        coefficients = linear_motion(
            len(state),
            predicted.transition_relative,
            state.column_numbers("thrust") if thrust else _NO_COLUMNS,
            predicted.thrust_coupling,
            turn_columns,
            turn_coupling,
            members.contents,
            chief_motion_deg,
        )
        # The motion is not linear: its mean is the predicted one, but for errors of the thrust.
        predicted_change = predicted.relative - (
            predicted.transition_relative @ state.mean[:DYNAMIC_STATES]
        )
        state.transform(members.changed, coefficients)
        state.mean[:DYNAMIC_STATES] += predicted_change
        state.covariance[:DYNAMIC_STATES, :DYNAMIC_STATES] += predicted.noise_relative
        state.predict_gauss_markov(*self._decay(interval))

    def _member_columns(self) -> _MemberColumns:
        """Return the columns of members by what they are; the same object while the labels stay."""
        state, known = self.state, self._known_columns
        if known is not None and known.labels_mark is state.labels_mark:
            return known
        shells = state.column_numbers("plasma_shell")
        contents = shells[::3].copy()
        self._known_columns = _MemberColumns(
            labels_mark=state.labels_mark,
            contents=contents,
            gradients=np.array([c for c in shells if c not in contents], dtype=np.int64),
            changed=np.concatenate((np.arange(DYNAMIC_STATES), contents)),
            walking=state.column_numbers("code_bias", "phase_bias"),
            has_waves=bool(state.columns("plasma_wave")),
            has_chief=CHIEF_MOTION[0] in state,
        )
        return self._known_columns

    def _decay(self, interval: float) -> tuple[FloatArray, ...]:
        """Return decay, steady variance and growth of all members over an interval, s.

        See `GaussianState.predict_gauss_markov`. They are the same objects while nothing that they
        depend on has changed.
        """
        state, configuration, members = self.state, self.configuration, self._member_columns()
        key = (
            members,
            interval,
            self._slow_phase,
            self._satellite_offset,
            self._gradient_sigma,
            self._waves.sigma_tecu(norm(state.mean[:3])) if members.has_waves else None,
            self._ground_rate_deg if members.has_chief else None,
            tuple(self._attitude_variances.values()),
        )
        if self._known_decay is not None and self._known_decay[0] == key:
            return self._known_decay[1]
        decay, steady, growth = np.ones(len(state)), np.zeros(len(state)), np.zeros(len(state))
        processes = [
            (state.column_numbers(kind), process)
            for kind, process in self._process_of_kind().items()
            if state.columns(kind)
        ]
        if len(members.gradients):
            gradient = SlowError(self._gradient_sigma, configuration.plasma_gradient_time)
            processes.append((members.gradients, gradient))
        for index in state.columns("attitude_error", "troposphere", "plasma"):
            single = self._process_of(state.labels[index])
            assert single is not None
            decay[index] = math.exp(-interval / single.correlation_time)
            steady[index] = single.sigma**2
        for columns, process in processes:
            decay[columns] = math.exp(-interval / process.correlation_time)
            steady[columns] = process.sigma**2
        growth[members.walking] = configuration.receiver_bias_walk**2 * interval
        if len(members.contents):
            power = 2.0 * self._plasma_sigma(state.labels[members.contents.item(0)]) ** 2
            growth[members.contents] = power / configuration.electron_density_time * interval
        self._known_decay = key, (decay, steady, growth)
        return decay, steady, growth

    def _process_of_kind(self) -> dict[str, SlowError]:
        """Return the Gauss-Markov processes of kinds whose members are all alike."""
        waves = self._waves.sigma_tecu(norm(self.state.mean[:3]))
        return {
            "phase_error": self._slow_phase,
            "satellite_offset": self._satellite_offset,
            "plasma_wave": SlowError(waves, self.configuration.plasma_wave_time),
        }

    def _process_of(self, label: Label) -> SlowError | None:
        """Return the Gauss-Markov process of a member that has its own; None without one."""
        configuration = self.configuration
        if label[0] == "attitude_error":
            sigma = math.sqrt(self._attitude_variances[label])
            return SlowError(sigma, configuration.attitude_time)
        if label[0] == "troposphere":
            return SlowError(1.0, configuration.troposphere_time)
        if label[0] == "plasma":
            return SlowError(self._plasma_sigma(label), self._layer_time(label[1]))
        # The content of a shell follows the gradient, and has no mean to return to.
        if label[0] == "plasma_shell" and label[-1] != "content":
            return SlowError(self._plasma_sigma(label), configuration.plasma_gradient_time)
        return None

    def _layer_time(self, layer: int) -> float:
        """Return the correlation time of the density of a layer, s.

        Over tens of kilometres phases show how large the gradients along the track are, by which
        the content of a layer changes. The random walk of a content along such gradients has the
        spectral density 2 (gradient rate)^2 T, a content with a correlation time 2 sigma^2 / time.
        """
        configuration = self.configuration
        rate = self._gradient_sigma * self._ground_rate_deg  # TECU/s
        shortest = configuration.electron_density_time
        if CHIEF_MOTION[0] not in self.state or not rate > 0.0:
            return shortest
        if not configuration.plasma_shell_heights:  # nothing tells of gradients
            return shortest
        thickness, sigma = configuration.plasma_layers[layer], configuration.layer_sigmas[layer]
        content = sigma * thickness / ELECTRONS_PER_TECU
        return max(shortest, (content / rate) ** 2 / configuration.plasma_gradient_time)

    def _plasma_sigma(self, label: Label) -> float:
        """Return the a priori sigma of a member of the plasma, in its unit."""
        configuration = self.configuration
        if label[0] == "plasma":
            return self._layer_sigmas[label[1]] / DENSITY_UNIT
        if label[-1] == "content":
            return configuration.plasma_shell_sigma_tecu
        return self._gradient_sigma

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
        received, stated = measured, self.noise.weigh(time, interval, measured)
        measured = self.scatter.add_excess(stated)
        if self._without_integers:
            self._without_integers.intersection_update(measured.keys)
        for key, reason in self.arcs.find_breaks(time, measured, interval).items():
            self._end_arc(key)
            self._without_integers.discard(key)
            if reason == "not seen any more":
                state.remove([("phase_error", key)])
            else:
                excluded[key] = reason
        kept = self._search_jumps(interval, measured, sky, excluded, degraded)
        if len(kept) < len(measured):
            received, stated = received.select(kept), stated.select(kept)
            measured, sky = measured.select(kept), sky.select(kept)
        if laser is not None and ("laser_latency",) not in state:
            state.add(("laser_latency",), 0.0, self.configuration.laser_latency_sigma**2)
        clock = SPEED_OF_LIGHT * self.clock
        self._start_arcs(time, measured, sky)
        self._doubt_scattered(measured, interval)
        variance_before = measured.phase_variance
        innovation = self._reject_faults(
            time, interval, measured, sky, clock, laser, excluded, degraded
        )
        measured = _with_phase_noise(measured, innovation)
        is_phase_fault = measured.phase_variance > variance_before
        missing_variances = self.scatter.learn(time, stated, innovation, is_phase_fault)
        self._learn_waves(measured, innovation, interval)
        before = state.trace(3)
        position = state.mean[:3].copy()
        changes = self._phase_changes(measured, sky)
        change = state.update(innovation)
        self._learn_thrust_noise(change[:3], before - state.trace(3))
        for key, variance in missing_variances.items():
            if self.arcs[key].integer is None:
                state.add_noise(("ambiguity", key), variance)
        nuisance = innovation.nuisance_gain @ innovation.values
        self.clock = (clock + float(nuisance[0])) / SPEED_OF_LIGHT
        self.arcs.record(time, measured)
        self._epochs += 1
        self._elapsed += interval
        if self._epochs < _EPOCHS_OF_LEARNING or self._epochs % _LEARNING_CYCLE < 2:
            self._learn_noise(time, interval, received, sky, clock, innovation)
        if self.configuration.dynamics == "orbital" and not self.scatter.is_common:
            self._learn_processes(measured, interval)
        update = Update(measured, sky, innovation, excluded, degraded)
        update.has_failed = self._has_failed(innovation)
        self._epochs_without_fix = max(self._epochs_without_fix - 1, 0)
        if not update.has_failed and self._epochs_without_fix == 0:
            update.fixed = self._fix(time, measured, sky, innovation)
        is_used = innovation.is_used[len(measured) : 2 * len(measured)]
        self.jumps.record(changes, changes.direction @ (state.mean[:3] - position), is_used)
        return update

    def expect_satellite_offsets(
        self, sigma: float, satellites: Set[tuple[int, int]], ranges: FloatArray
    ) -> None:
        """Have errors of the positions of satellites across their rays in the state.

        Parameters
        ----------
        sigma : float
            m.
        satellites : set of (int, int)
            In view.
        ranges : ndarray
            Distances of the satellites from the antennas, m.
        """
        state, last = self.state, self._satellite_offset
        labels = state.labels_of("satellite_offset")
        if not labels and sigma == 0.0:
            return
        distance = float(np.mean(ranges))
        state.remove([label for label in labels if label[1] not in satellites])
        if sigma * norm(state.mean[:3]) < _SMALLEST_RAY_ERROR * distance:
            # Without offsets all phases so far tell more of the motion.
            if present := [label for label in labels if label in state]:
                smallest = _SMALLEST_RAY_ERROR * distance / norm(state.mean[:3])
                state.reweigh(present, last.sigma**2, smallest**2)
                state.remove(present)
            return
        if last.sigma != sigma:
            self._satellite_offset = SlowError(sigma, last.correlation_time)
            present = [label for label in labels if label in state]
            if present:
                state.reweigh(present, last.sigma**2, sigma**2)
        for satellite in sorted(satellites):
            if ("satellite_offset", satellite) not in state:
                state.add(("satellite_offset", satellite), 0.0, sigma**2)

    def expect_plasma_waves(self, satellites: Set[tuple[int, int]]) -> None:
        """Have the content of waves in the rays of satellites in the state, where it tells."""
        state, distance = self.state, norm(self.state.mean[:3])
        is_orbital = self.configuration.dynamics == "orbital"
        if not (is_orbital and self.configuration.has_plasma and self._waves.are_felt(distance)):
            if not state.columns("plasma_wave"):
                return
            satellites = frozenset()
        present = [satellite for _, satellite in state.labels_of("plasma_wave")]
        state.remove([("plasma_wave", s) for s in present if s not in satellites])
        for satellite in sorted(satellites - set(present)):
            state.add(("plasma_wave", satellite), 0.0, self._waves.sigma_tecu(distance) ** 2)

    def without_ambiguities(self, signals: SignalTable) -> SignalTable:
        """Return signals of the deputy with the ambiguities of the chief's carrier ranges.

        Carrier ranges are NaN where the integer of the difference is not known, or not any more.
        """
        carrier_range = np.full(len(signals), np.nan)
        flags, lock_times = signals.flags.tolist(), signals.lock_time.tolist()
        for row, number in enumerate(signals.signal.tolist()):
            key = signal_from_number(number)
            if key not in self.arcs or (flags[row] & FLAG_LOCK_LOST):
                continue
            arc = self.arcs[key]
            half_cycles = 2 * bool(flags[row] & FLAG_HALF_CYCLE_ADDED)
            is_same = self.arcs.is_continued_by(key, lock_times[row], half_cycles)
            if arc.integer is not None and is_same:
                cycles = arc.integer + arc.offset_cycles
                carrier_range[row] = signals.carrier_range[row] - cycles * signals.wavelength[row]
        return with_columns(signals, carrier_range=carrier_range)

    def _phase_changes(self, measured: SingleDifferences, sky: Sky) -> PhaseChanges:
        variance = measured.phase_variance
        if self.scatter.has_excess:
            variance = variance + self.scatter.variances(measured)
        return make_table(
            PhaseChanges,
            keys=measured.keys,
            residual=measured.phase - sky.predicted,
            variance=variance,
            direction=sky.direction,
            clock_rate=sky.clock_rate,
            clock=self.clock,
        )

    def _search_jumps(
        self,
        interval: float,
        measured: SingleDifferences,
        sky: Sky,
        excluded: dict[SignalKey, str],
        degraded: list[str],
    ) -> npt.NDArray[np.intp]:
        """Put out satellites whose phases have jumped; return the rows that are used.

        Where it cannot be told which phases have jumped, all integers end: they would be kept
        with a position that may be wrong.
        """
        self.jumps.forget(excluded)
        found = self.jumps.search(self._phase_changes(measured, sky), interval)
        is_orbital = self.configuration.dynamics == "orbital"
        if found.is_unexplained and not is_orbital:
            degraded.append("phases have jumped, and it cannot be told which")
            self._epochs_without_fix = _EPOCHS_OF_DOUBT
            for key in measured.keys:
                excluded[key] = "phases contradict each other"
                self._end_arc(key)
        out = self.jumps.excluded(measured.keys.satellites)
        if not out:
            return np.arange(len(measured))
        kept = [row for row, key in enumerate(measured.keys) if key.satellite not in out]
        is_kept_enough = len({measured.keys[row].satellite for row in kept}) >= self._fewest_fixed
        for key in measured.keys:
            if key.satellite not in out:
                continue
            if is_kept_enough and not is_orbital:
                self._without_integers.add(key)
            if is_kept_enough or key.satellite in found.satellites:
                excluded[key] = "phases of the satellite have jumped"
                self._end_arc(key)
        if is_kept_enough:
            return np.array(kept, dtype=np.intp)
        if out:
            # Their changes still tell the motion, but not the integers of phases that have jumped.
            self._epochs_without_fix = max(self._epochs_without_fix, 2)
        return np.arange(len(measured))

    def _start_arcs(self, time: GpsTime, measured: SingleDifferences, sky: Sky) -> None:
        """Add arcs and states for signals without an arc."""
        state = self.state
        if are_all(self.arcs.are_open(measured.keys)):
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
            mean = measured.phase.item(row) - wavelength * arc.offset_cycles - expected_phase
            state.add(("ambiguity", key), mean, _UNKNOWN_AMBIGUITY_SIGMA**2)
            if self._slow_phase.sigma > 0.0 and ("phase_error", key) not in state:
                state.add(("phase_error", key), 0.0, self._slow_phase.sigma**2)

    def _end_arc(self, key: SignalKey) -> None:
        """End an arc; remove its ambiguity, and the bias of its group without other integers."""
        state = self.state
        had_integer = key in self.arcs and self.arcs[key].integer is not None
        self.arcs.end(key)
        state.remove([("ambiguity", key)])
        if had_integer and key.group not in self.arcs.fixed_groups():
            state.remove([("phase_bias", key.group)])

    def _doubt_scattered(self, measured: SingleDifferences, interval: float) -> None:
        """Have ambiguities walk whose phases slip unseen: their integers are not known any more."""
        rate = self._slips.rate
        if rate == 0.0 or self.configuration.dynamics != "orbital":
            return
        state = self.state
        wavelength = measured.wavelength.tolist()
        for row in np.flatnonzero(self.scatter.is_scattered(measured)).tolist():
            key = measured.keys[row]
            arc = self.arcs[key]
            if arc.integer is not None:
                offset = wavelength[row] * arc.integer
                state.add_copy(("ambiguity", key), ("phase_bias", key.group), offset)
                arc.integer = arc.fixed_since = None
                if key.group not in self.arcs.fixed_groups():
                    state.remove([("phase_bias", key.group)])
            state.add_noise(("ambiguity", key), rate * interval * wavelength[row] ** 2)

    def _learn_noise(
        self,
        time: GpsTime,
        interval: float,
        received: SingleDifferences,
        sky: Sky,
        clock: float,
        innovation: Innovation,
    ) -> None:
        """Learn from the residuals of an epoch how noisy codes and phases are.

        `received` has the variances that the receivers state; the sky is that of `clock`, m.
        """
        count = len(received)
        signals = received.keys
        arcs = self.arcs.columns(signals, self.state)
        is_scattered = self.scatter.is_scattered(received)
        if 2 * np.count_nonzero(is_scattered) > count:
            is_scattered[:] = False
        used = innovation.is_used
        labels = self.state.labels_of(*PLASMA_KINDS)
        sigmas = [self._plasma_sigma(label) for label in labels]
        plasma = -sky.plasma_delay[:, : len(labels)] * np.array(sigmas)
        satellites = [satellite for _, satellite in self.state.labels_of("plasma_wave")]
        if satellites:
            waves = self._waves.sigma_tecu(norm(self.state.mean[:3]))
            plasma = np.hstack((plasma, waves * phase_waves(received, sky, satellites)))
        predicted = sky.predicted + clock
        if self.configuration.has_troposphere:
            predicted = predicted + sky.troposphere * self.state.value(("troposphere",))
        self.noise.learn(
            time,
            interval,
            EpochResiduals(
                measured=received,
                predicted=predicted,
                integer_cycles=arcs.integer_cycles,
                is_phase_continued=self.arcs.epochs(signals) > 1,
                common=common_unknowns(
                    sky.direction, sky.clock_rate, signals.group_rows, len(signals.groups)
                ),
                plasma=plasma,
                is_code_sample=used[:count],
                is_phase_sample=used[count : 2 * count] & ~is_scattered,
            ),
        )
        self._follow_slow_phase(self.noise.phase.slow)
        if self.configuration.has_plasma and self.configuration.plasma_shell_heights:
            self._learn_gradients()

    def _learn_processes(self, measured: SingleDifferences, interval: float) -> None:
        """Learn from the state how large accelerations and waves of the plasma are in orbit."""
        state = self.state
        distance = norm(state.mean[:3])
        self.acceleration.learn(state.mean, state.covariance, distance, interval)
        waves = self._quiet_waves(measured)
        # Ambiguities that are not known yet take up waves.
        if waves and self.arcs.has_integers():
            variances = np.diagonal(state.covariance)[waves]
            self._waves.learn(state.mean[waves], variances, distance, interval)

    def _quiet_waves(self, measured: SingleDifferences) -> list[int]:
        """Return the columns of waves in rays that do not scintillate, which is no wave."""
        state = self.state
        if not state.columns("plasma_wave"):
            return []
        is_scattered = self.scatter.is_scattered(measured).tolist()
        out = set(itertools.compress(measured.keys.satellites, is_scattered))
        return [
            state.index(label) for label in state.labels_of("plasma_wave") if label[1] not in out
        ]

    def _learn_waves(
        self, measured: SingleDifferences, innovation: Innovation, interval: float
    ) -> None:
        """Learn from an innovation how large the waves of the plasma are."""
        if columns := self._quiet_waves(measured):
            design = innovation.design[:, columns]
            weighted = innovation.weight @ design
            self._waves.learn_changes(
                innovation.values @ weighted,
                np.einsum("ij,ij->j", design, weighted),
                norm(self.state.mean[:3]),
                interval,
            )

    def _learn_thrust_noise(self, change: FloatArray, expected: float) -> None:
        """Adapt the white error of the thrust to the corrections of the position while it acts.

        A correction (m) has the variance that the update takes off the position, `expected` (m2),
        if the process noise is right (covariance matching: Mehra 1970). The logarithm of the
        variance follows their ratio step by step (Robbins and Monro 1951).
        """
        if self._velocity_change == 0.0 or not expected > 0.0 or self.scatter.is_common:
            return
        gained = (self.thrust_sigma * self._velocity_change) ** 2
        share = gained / (gained + _VELOCITY_NOISE**2)
        ratio = min(float(change @ change) / expected, _LARGEST_CORRECTION)
        sigma = self.thrust_sigma * math.exp(0.5 * _THRUST_GAIN * share * (ratio - 1.0))
        # Thrust that is given as better known than the least sigma is believed so.
        least = min(_THRUST_SIGMAS[0], self.configuration.thrust_relative_sigma)
        self.thrust_sigma = min(max(sigma, least), _THRUST_SIGMAS[1])

    def _follow_slow_phase(self, slow: SlowError) -> None:
        """Give the slow errors of the phases in the state another sigma and correlation time."""
        state, last = self.state, self._slow_phase
        if slow.sigma == 0.0 and last.sigma == 0.0:
            return
        labels = state.labels_of("phase_error")
        ratio = slow.sigma / last.sigma if last.sigma > 0.0 else math.inf
        if 1.0 / _SIGMA_STEP < ratio < _SIGMA_STEP:
            self._slow_phase = SlowError(last.sigma, slow.correlation_time)
            return
        if ratio < 1.0:
            self._slow_phase = slow
            sigma = max(slow.sigma, _NEGLIGIBLE_SLOW_SIGMA)
            state.reweigh(labels, last.sigma**2, sigma**2)
            if slow.sigma == 0.0:
                state.remove(labels)
            return
        self._doubt(last, slow)
        self._slow_phase = slow
        if last.sigma > 0.0:
            state.reweigh(labels, last.sigma**2, slow.sigma**2)
        for key in self.arcs.arcs:
            if ("phase_error", key) not in state:
                state.add(("phase_error", key), 0.0, slow.sigma**2)

    def _learn_gradients(self) -> None:
        """Adapt the a priori sigma of the horizontal gradients of the plasma to their estimates.

        Expectation maximisation (Dempster, Laird and Rubin 1977): the expected squares of the
        gradients, and those of so many quiet ones, give the variance. Without integers they are
        known too little for that: the variance is then the mean of those between quiet and stated,
        weighed by their likelihoods (multiple models: Magill 1965), over tens of kilometres, where
        gradients tell in changes of phases.
        """
        state, quiet = self.state, self.configuration.plasma_quiet_gradient_tecu_per_deg
        stated = self.configuration.plasma_gradient_sigma_tecu_per_deg
        columns = self._member_columns().gradients
        labels = [state.labels[column] for column in columns.tolist()]
        if self.arcs.has_integers():
            squares = state.mean[columns] ** 2 + state.covariance.diagonal()[columns]
            total = float(squares.sum()) + _QUIET_GRADIENTS * quiet**2
            sigma = math.sqrt(total / (len(labels) + _QUIET_GRADIENTS))
        elif CHIEF_MOTION[0] in state and 0.0 < quiet < stated:
            models = np.geomspace(quiet, stated, _GRADIENT_MODELS) ** 2
            ones = np.ones(len(labels))
            likelihood = state.log_likelihoods(
                labels, self._gradient_sigma**2 * ones, np.outer(models, ones)
            )
            weight = np.exp(likelihood - likelihood.max())
            sigma = math.sqrt(float(weight @ models) / float(weight.sum()))
        else:
            return
        if not 1.0 / _GRADIENT_STEP < sigma / self._gradient_sigma < _GRADIENT_STEP:
            state.reweigh(labels, self._gradient_sigma**2, sigma**2)
            self._gradient_sigma = sigma

    def _doubt(self, last: SlowError, slow: SlowError) -> None:
        """Raise the covariance of what was estimated from phases with larger slow errors.

        The information that phases gave is divided by the ratio of the powers that errors have in
        means over the time since the start: early, slow errors are not longer than it. What is
        known otherwise counts as before: the prior of each process, and what codes tell of their
        biases and of the chief. So no member is raised beyond what was known without the phases,
        and what moves an antenna, such as an error of its lever arm, keeps its share in the
        position.
        """

        def power(error: SlowError) -> float:
            spans = max(self._elapsed, 1.0) / error.correlation_time
            mean_square = 2.0 / spans * (1.0 + math.expm1(-spans) / spans) * error.sigma**2
            return _WHITE_PHASE_POWER + max(self._elapsed, 1.0) * mean_square

        factor = min(power(slow) / power(last), _LARGEST_DOUBT)
        if factor <= 1.0:
            return
        state = self.state
        kept = [c for c in state.columns(*_KINDS_WITHOUT_PHASES) if state.covariance[c, c] > 0.0]
        priors = {
            column: variance
            for column, label in enumerate(state.labels)
            if state.covariance[column, column] > 0.0
            and (variance := self._prior_variance(label)) is not None
        }
        columns = [*priors, *kept]
        prior = np.zeros((len(columns), len(columns)))
        prior[range(len(priors)), range(len(priors))] = list(priors.values())
        prior[len(priors) :, len(priors) :] = state.covariance[np.ix_(kept, kept)]
        state.doubt(factor, columns, prior)

    def _prior_variance(self, label: Label) -> float | None:
        """Return the variance of a member without measurements; None where there is no prior."""
        configuration, kind = self.configuration, label[0]
        if kind == "motion" and label[1] >= DYNAMIC_STATES - 3:
            sigma = self.acceleration.sigma(norm(self.state.mean[:3]))
            return sigma.item(label[1] - (DYNAMIC_STATES - 3)) ** 2
        if kind == "thrust":
            return configuration.thrust_sigmas[label[1]] ** 2
        if kind == "antenna_offset" and configuration.antennas is not None:
            return configuration.antennas.offset_variances()[label]
        if kind == "plasma_shell":
            return self._plasma_sigma(label) ** 2
        process = self._process_of_kind().get(kind) or self._process_of(label)
        return None if process is None else process.sigma**2

    def _reject_faults(
        self,
        time: GpsTime,
        interval: float,
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
        slips_in_scatter = 0
        for _ in range(_DETECTION_PASSES):
            if result.innovation.are_all_used:
                break
            is_used = result.innovation.is_used
            slipped = np.flatnonzero(~is_used[count : 2 * count]).tolist()
            for row in slipped:
                key = measured.keys[row]
                excluded[key] = "cycle slip"
                self._end_arc(key)
                slips_in_scatter += bool(is_scattered[row])
            if not slipped:
                break
            self._start_arcs(time, measured, sky)
            # Faulty phases of the last pass are left out, so that the search ends.
            result = search()
        innovation = result.innovation
        if is_any(is_scattered):
            phases = slice(count, 2 * count)
            shows_slip = innovation.leave_one_out[1][phases] < 2.0 * innovation.noise[phases]
            visible = int(np.count_nonzero(is_scattered & shows_slip)) + slips_in_scatter
            self._slips.count(slips_in_scatter, visible, interval)
        if innovation.are_all_used:
            return innovation
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
        if most satellites are faulty without it, and not most with it; in orbit, if one at most is,
        which may have slipped.

        Phases in scintillation have outliers by themselves: they are no witnesses. Of few other
        satellites motion and clock explain whatever they say, so that in orbit, where motion is
        predicted well, scintillation of all the sky would be taken for motion. While anything
        scintillates, faulty ones may have begun to: they must be as many themselves.
        """
        without_cause = search()
        is_likely = not self._is_unlikely(without_cause.innovation)
        if is_likely and not without_cause.faulty_phases:
            return without_cause
        is_quiet = ~self.scatter.is_scattered(measured)
        faulty = without_cause.count_satellites(measured, is_quiet)
        if faulty < 2 and is_likely:
            return without_cause
        witnesses = len(set(measured.satellite[is_quiet].tolist()))
        is_scintillating = not is_quiet.all()
        state, is_orbital = self.state, self.configuration.dynamics == "orbital"
        for cause, variances in self._common_causes():
            is_motion = cause == _MOTION
            told_by = faulty if faulty and is_scintillating else witnesses
            if is_motion and is_orbital and told_by < _FEWEST_WITNESSES_OF_MOTION:
                continue
            covariance = state.covariance.copy()
            for label, variance in variances.items():
                state.add_noise(label, variance)
            with_cause = search()
            is_likely = not self._is_unlikely(with_cause.innovation)
            explains_all = not with_cause.faulty_phases and is_likely
            left = with_cause.count_satellites(measured, is_quiet)
            explains_most = 2 * faulty > witnesses >= 2 * left and not (is_orbital and left > 1)
            if explains_all or (explains_most and is_motion):
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
        return innovation.probability < self.configuration.global_probability

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
        arcs = self.arcs.columns(measured.keys, state)
        if arcs.has_integers_only:
            return set()
        may_be_fixed = is_used & measured.is_parity_known & ~arcs.has_integer
        candidates = [
            arcs.arcs[row]
            for row in np.flatnonzero(may_be_fixed).tolist()
            if arcs.arcs[row].key not in self._without_integers and self._is_averaged(measured, row)
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

    def _is_averaged(self, measured: SingleDifferences, row: int) -> bool:
        """Return whether any scatter of the phase of a float ambiguity is averaged out."""
        if self.scatter.variance(measured.keys[row]) == 0.0:
            return True
        epochs = epochs_to_average(
            float(measured.phase_variance[row]), float(measured.wavelength[row]), _AVERAGED_CYCLES
        )
        if self.scatter.is_common:
            epochs *= _CORRELATED_EPOCHS
        return self.arcs.epochs(measured.keys).item(row) >= max(epochs, _FEWEST_EPOCHS_IN_SCATTER)

    @property
    def _fewest_fixed(self) -> int:
        """Fewest satellites with integers of a fixed solution."""
        return _FEWEST_FIXED_SATELLITES + (self.configuration.dynamics == "kinematic")

    def classify(self, update: Update) -> tuple[int, int, int]:
        """Return the kind of solution, the number of satellites used, and that of integers."""
        measured, innovation = update.measured, update.innovation
        count, satellites = len(measured), len(measured.keys.distinct_satellites)
        arcs = self.arcs.columns(measured.keys, self.state)
        if innovation.are_all_used and arcs.has_integers_only and satellites >= self._fewest_fixed:
            return SOLUTION_FIXED, satellites, count
        code_used = innovation.is_used[:count]
        phase_used = innovation.is_used[count : 2 * count]
        is_used = code_used | phase_used
        if not are_all(is_used):
            satellites = len(set(measured.satellite[is_used].tolist()))
        has_integer = phase_used & arcs.has_integer
        used, integers = int(np.count_nonzero(phase_used)), int(np.count_nonzero(has_integer))
        # Most integers are lost and refused: those that are left cannot be trusted either.
        has_collapsed = 2 * integers < used and bool(self.attempt.reason)
        with_integer = set(itertools.compress(measured.keys.satellites, has_integer.tolist()))
        if len(with_integer) >= self._fewest_fixed and not has_collapsed:
            return SOLUTION_FIXED, satellites, integers
        return (SOLUTION_FLOAT if used else SOLUTION_CODE), satellites, integers

    def local_density(self) -> tuple[float, float]:
        """Return the electron density at the chief and its sigma, 1/m3; NaN without plasma."""
        state = self.state
        layers = state.columns("plasma")
        if not layers:
            return math.nan, math.nan
        span = state.span("plasma")
        if isinstance(span, slice):
            # A copy, so that the sum has the order of numbers that follow each other.
            variance = float(state.covariance[span, span].copy().sum())
        else:
            variance = float(state.covariance[np.ix_(layers, layers)].sum())
        total = float(state.mean[span].sum())
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


def _monitor_accelerations(noise: MotionNoise) -> AccelerationMonitor:
    """Return the monitor of the accelerations of the difference."""
    return AccelerationMonitor(noise, smallest_factor=_SMALLEST_ACCELERATION_FACTOR)


def _shell_members(shell: int) -> list[Label]:
    """Return the members of a shell: content above the chief, gradients to north and to east."""
    return [("plasma_shell", shell, name) for name in ("content", "north", "east")]


def _with_phase_noise(measured: SingleDifferences, innovation: Innovation) -> SingleDifferences:
    """Return single differences with the variances of the phases in an innovation."""
    count = len(measured)
    return with_columns(measured, phase_variance=innovation.noise[count : 2 * count].copy())
