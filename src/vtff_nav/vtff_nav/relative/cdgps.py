"""Carrier-phase differential filter: the position of one receiver relative to another.

Single differences of code and phase on any mix of signals, relative motion by nonlinear
propagation of both spacecraft, integers fixed and held, faults found by innovation. Sources: Kroes
(2006), Precise relative positioning of formation flying spacecraft using GPS; Leung and
Montenbruck (2005), Real-time navigation of formation-flying spacecraft using GPS (JGCD 28, 2);
Teunissen (1995) for the integers.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincc

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames import state_itrf_to_gcrf
from vtff_dynamics.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.broadcast_orbit import EphemerisTable
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.ephemeris_selection import EphemerisStore
from vtff_gnss.observations import ObservationEpoch
from vtff_nav.relative.ambiguity_arcs import ArcBook
from vtff_nav.relative.ambiguity_fixing import FixAttempt, fix_ambiguities
from vtff_nav.relative.cdgps_configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps_model import (
    DENSITY_UNIT,
    Sky,
    code_biases,
    measurement_innovation,
    sky_of,
)
from vtff_nav.relative.cdgps_output import (
    ambiguity_table,
    differential_tec_table,
    relative_rtn,
)
from vtff_nav.relative.cdgps_state import GaussianState, Innovation
from vtff_nav.relative.dynamics import (
    DYNAMIC_STATES,
    OrbitalMotion,
    TerrestrialMotion,
    ThrustInterval,
)
from vtff_nav.relative.measurements import (
    Geometry,
    SignalKey,
    SignalReader,
    SignalTable,
    SingleDifferences,
    geometry,
    satellite_mask,
    satellite_rows,
    single_differences,
)
from vtff_nav.relative.orbit_filter import AbsoluteFilter, combinations, single_point
from vtff_nav.relative.solution import (
    SOLUTION_CODE,
    SOLUTION_FIXED,
    SOLUTION_FLOAT,
    SOLUTION_PREDICTED,
    AmbiguityTable,
    DifferentialTecTable,
    LaserMeasurement,
    RelativeSolution,
)

__all__ = ["CdgpsEstimator"]

# Start values of what is not known at all; far above what happens, far below lost digits.
_UNKNOWN_AMBIGUITY_SIGMA = 10.0
_UNKNOWN_CODE_BIAS_SIGMA = 20.0
_START_INFLATION = 25.0
_START_VELOCITY_SIGMA = 30.0

# The clocks used for the times of reception are set anew beyond this, s: below, their error is
# corrected exactly enough by the derivative of the range.
_CLOCK_TOLERANCE = 3e-7

# Sigmas added to the motion when it is not what was predicted: m, m/s.
_SURPRISE_SIGMAS = (10.0, 1.0)
_DETECTION_PASSES = 6
_GLOBAL_FAILURES = 2
_FEWEST_FIXED_SATELLITES = 4


class CdgpsEstimator:
    """Relative navigation filter; see `vtff_nav.relative.solution.RelativeEstimator`.

    Parameters
    ----------
    configuration : CdgpsConfiguration, optional
    ephemerides : iterable of BroadcastEphemeris, optional
    """

    def __init__(
        self,
        configuration: CdgpsConfiguration | None = None,
        ephemerides: Iterable[BroadcastEphemeris] = (),
    ) -> None:
        self.configuration = configuration or CdgpsConfiguration()
        self._motion = _motion(self.configuration)
        self._ephemerides = dict.fromkeys(ephemerides)
        self._store = EphemerisStore(self._ephemerides)
        self._has_new_ephemeris = False
        self._thrust: list[ThrustInterval] = []
        self._absolute = AbsoluteFilter(self.configuration)
        self._signal_reader = SignalReader(
            self.configuration.measurement_noise, self.configuration.bands
        )
        self._known: tuple[EphemerisTable, npt.NDArray[np.bool_]] | None = None
        self._subset: tuple[EphemerisTable, npt.NDArray[np.bool_], EphemerisTable] | None = None
        self.reset()

    def reset(self) -> None:
        """Forget every estimate; ephemerides are kept."""
        self._absolute.reset()
        self._time: GpsTime | None = None
        self._start_anew()
        self._last_update: GpsTime | None = None

    def _start_anew(self) -> None:
        """Forget the relative state."""
        self._state: GaussianState | None = None
        self._arcs = ArcBook()
        self._code_reference: tuple[int, int, int] | None = None
        self._clock = 0.0
        self._global_failures = 0
        self._attempt = FixAttempt((), 0.0, 0.0, "")

    def add_ephemeris(self, ephemeris: BroadcastEphemeris) -> None:
        """Take a broadcast ephemeris; repetitions cost nothing."""
        if ephemeris not in self._ephemerides:
            self._ephemerides[ephemeris] = None
            self._has_new_ephemeris = True

    def add_thrust(self, start: GpsTime, duration: float, acceleration_rtn: npt.ArrayLike) -> None:
        """Take the thrust of the deputy; see `RelativeEstimator.add_thrust`.

        Raises
        ------
        ValueError
            If the acceleration is not three finite numbers or the duration not positive.
        """
        acceleration = np.array(acceleration_rtn, dtype=float)
        if acceleration.shape != (3,) or not np.isfinite(acceleration).all():
            raise ValueError("acceleration_rtn: three finite numbers expected")
        if not duration > 0.0:
            raise ValueError("duration: more than 0 s expected")
        if acceleration.any():
            self._thrust.append(ThrustInterval(start, duration, acceleration))

    def process(
        self,
        time: GpsTime,
        chief: ObservationEpoch | None,
        deputy: ObservationEpoch | None,
        laser: LaserMeasurement | None = None,
    ) -> RelativeSolution:
        """Go on to an epoch and use what was measured there; see `RelativeEstimator.process`.

        Raises
        ------
        ValueError
            If `time` is not after the epoch before.
        """
        interval = 1.0 if self._time is None else time - self._time
        if not interval > 0.0:
            raise ValueError(f"time {time}: not after the epoch before, {self._time}")
        if self._has_new_ephemeris:
            self._store = EphemerisStore(self._ephemerides)
            self._has_new_ephemeris = False
        table = self._store.table(time)
        signals = [self._signals(epoch, table) for epoch in (chief, deputy)]
        if self._absolute.state is not None and self._time is not None:
            self._predict(self._time, interval)
        self._time = time
        if self._is_outdated(time):
            self.reset()
            self._time = time
        reasons = self._start(time, (chief, deputy), signals, table)
        if self._absolute.state is None or self._state is None:
            return RelativeSolution.none(time, tuple(reasons), self._age(time))
        return self._use(time, interval, (chief, deputy), signals, table, laser)

    def _is_outdated(self, time: GpsTime) -> bool:
        """Return whether the last measurement is too old to go on from."""
        last = self._last_update
        return last is not None and time - last > self.configuration.longest_prediction

    def _age(self, time: GpsTime) -> float:
        return 0.0 if self._last_update is None else time - self._last_update

    def _signals(self, epoch: ObservationEpoch | None, table: EphemerisTable) -> SignalTable | None:
        """Return the signals of a receiver whose satellites have an ephemeris."""
        if epoch is None:
            return None
        if self._known is None or self._known[0] is not table:
            self._known = (table, satellite_mask(satellite_rows(table)))
        signals = self._signal_reader.read(epoch, self._known[1])
        return signals if len(signals) else None

    def _table_of(self, table: EphemerisTable, signals: list[SignalTable | None]) -> EphemerisTable:
        """Return the rows of a table that are in view; the same object as long as they are."""
        satellites = np.concatenate([s.satellite for s in signals if s is not None])
        if self._subset is not None:
            whole, is_there, subset = self._subset
            if whole is table and is_there[satellites].all():
                return subset
        needed = np.unique(satellites)
        rows = np.searchsorted(satellite_rows(table), needed)
        subset = EphemerisTable([table.ephemerides[row] for row in rows.tolist()])
        self._subset = (table, satellite_mask(needed), subset)
        return subset

    def _start(
        self,
        time: GpsTime,
        epochs: tuple[ObservationEpoch | None, ObservationEpoch | None],
        signals: list[SignalTable | None],
        table: EphemerisTable,
    ) -> list[str]:
        """Begin with the chief and with the difference as far as they have not begun."""
        chief, deputy = epochs
        if self._absolute.state is None:
            self._start_anew()
            if chief is None or signals[0] is None:
                return ["no observations of the chief"]
            if not self._absolute.start(time, chief.time, signals[0], table):
                return ["the chief has no position: too few satellites or no velocity yet"]
        if self._state is not None:
            return []
        if deputy is None or signals[1] is None:
            return ["no observations of the deputy"]
        mask = math.radians(self.configuration.elevation_mask_deg)
        measured = combinations(signals[1], table)
        has_troposphere = self.configuration.has_troposphere
        point = single_point(measured, table, deputy.time, mask, has_troposphere)
        if point is None:
            return ["the deputy has no position: too few satellites"]
        received = deputy.time - point.clock / SPEED_OF_LIGHT
        state_itrf = self._motion.state_itrf(time, self._absolute.mean[:6])
        position = point.position_itrf + (time - received) * state_itrf[3:]
        # Where the chief's position is known better than by its codes, what is wrong with the
        # codes of both is taken off.
        position -= self._absolute.code_error(chief, state_itrf)
        mean = np.zeros(DYNAMIC_STATES)
        mean[:3] = self._motion.to_itrf(time).T @ (position - state_itrf[:3])
        covariance = np.zeros((DYNAMIC_STATES, DYNAMIC_STATES))
        covariance[:3, :3] = _START_INFLATION * (point.covariance + np.eye(3))
        covariance[:3, :3] += self._absolute.covariance[:3, :3]
        if self.configuration.dynamics != "static":
            covariance[3:6, 3:6] = _START_VELOCITY_SIGMA**2 * np.eye(3)
        if self.configuration.dynamics == "orbital":
            sigma = self.configuration.noise_relative.empirical_sigma
            covariance[6:, 6:] = sigma**2 * np.eye(3)
        labels = [("motion", index) for index in range(DYNAMIC_STATES)]
        self._state = GaussianState(labels, mean, covariance)
        self._clock = point.clock / SPEED_OF_LIGHT - self._absolute.clock
        if self.configuration.has_plasma:
            for layer, sigma in enumerate(self.configuration.layer_sigmas):
                self._state.add(("plasma", layer), 0.0, (sigma / DENSITY_UNIT) ** 2)
        return []

    def _predict(self, time: GpsTime, interval: float) -> None:
        """Propagate both filters from `time` on."""
        absolute, state, configuration = self._absolute, self._state, self.configuration
        relative = state.mean[:DYNAMIC_STATES] if state is not None else np.zeros(DYNAMIC_STATES)
        end = time + interval
        thrust = [t for t in self._thrust if t.start < end and t.end > time]
        self._thrust = [t for t in self._thrust if t.end > end]
        predicted = self._motion.predict(time, interval, absolute.mean, relative, thrust)
        absolute.predict(predicted.chief, predicted.transition_chief, predicted.noise_chief)
        if state is None:
            return
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

    def _use(
        self,
        time: GpsTime,
        interval: float,
        epochs: tuple[ObservationEpoch | None, ObservationEpoch | None],
        signals: list[SignalTable | None],
        table: EphemerisTable,
        laser: LaserMeasurement | None,
    ) -> RelativeSolution:
        """Update both filters with the observations of an epoch and return the solution."""
        degraded = [
            f"no observations of the {name}"
            for name, of_one in zip(("chief", "deputy"), signals, strict=True)
            if of_one is None
        ]
        seen, states = None, np.zeros((2, 6))
        if signals[0] is not None or signals[1] is not None:
            table = self._table_of(table, signals)
            states = self._states_itrf(time)
            seen = self._synchronised(time, epochs, signals, table, states)
        if seen is not None and signals[0] is not None:
            before = self._absolute.mean[:3].copy()
            self._absolute.update(time, signals[0], table, seen)
            if self._absolute.state is None:
                self._start_anew()
                return RelativeSolution.none(
                    time, ("the orbit of the chief has been given up",), self._age(time)
                )
            shift = seen.direction @ (self._absolute.mean[:3] - before)
            seen = dataclasses.replace(seen, range=seen.range - shift)
        if seen is None or signals[0] is None or signals[1] is None:
            return self._solution(time, None, None, None, degraded, {}, laser)
        measured = single_differences(signals[0], signals[1])
        rows = seen.rows(measured.satellite)
        mask = math.radians(self.configuration.elevation_mask_deg)
        measured = _taken(measured, np.flatnonzero(seen.elevation[0, rows] > mask))
        if not len(measured):
            degraded.append("no satellite in common view")
            return self._solution(time, None, None, None, degraded, {}, laser)
        sky = sky_of(measured, seen, states[:, :3], self.configuration)
        return self._update(time, interval, measured, sky, degraded, laser)

    def _states_itrf(self, time: GpsTime) -> FloatArray:
        """Return position and Earth-fixed velocity of both, shape (2, 6)."""
        assert self._state is not None
        chief = self._absolute.mean[:6]
        deputy = chief + self._state.mean[:6]
        return np.array([self._motion.state_itrf(time, state) for state in (chief, deputy)])

    def _synchronised(
        self,
        time: GpsTime,
        epochs: tuple[ObservationEpoch | None, ObservationEpoch | None],
        signals: list[SignalTable | None],
        table: EphemerisTable,
        states: FloatArray,
    ) -> Geometry:
        """Return the lines of sight at the true times of reception; sets the clocks."""
        to_itrf = self._motion.to_itrf(time)
        clocks = [self._absolute.clock, self._absolute.clock + self._clock]
        for _ in range(3):
            offsets = np.array(
                [
                    (0.0 if epoch is None else epoch.time - time) - clock
                    for epoch, clock in zip(epochs, clocks, strict=True)
                ]
            )
            seen = geometry(table, time, offsets, states, to_itrf)
            changed = False
            for receiver, of_one in enumerate(signals):
                if of_one is None:
                    continue
                clock = _code_clock(of_one, seen, receiver)
                if abs(clock - clocks[receiver]) > _CLOCK_TOLERANCE:
                    clocks[receiver], changed = clock, True
            if not changed:
                break
        self._absolute.clock = clocks[0]
        self._clock = clocks[1] - clocks[0]
        return seen

    def _update(
        self,
        time: GpsTime,
        interval: float,
        measured: SingleDifferences,
        sky: Sky,
        degraded: list[str],
        laser: LaserMeasurement | None,
    ) -> RelativeSolution:
        """Use single differences."""
        state = self._state
        assert state is not None
        excluded: dict[SignalKey, str] = {}
        for key, reason in self._arcs.broken(time, measured, interval).items():
            self._end_arc(key)
            if reason != "not seen any more":
                excluded[key] = reason
        if laser is not None and ("laser_latency",) not in state:
            state.add(("laser_latency",), 0.0, self.configuration.laser_latency_sigma**2)
        clock = SPEED_OF_LIGHT * self._clock
        self._begin_arcs(time, measured, sky)
        innovation = self._without_faults(time, measured, sky, clock, laser, excluded, degraded)
        state.update(innovation)
        nuisance = innovation.nuisance_gain @ innovation.values
        self._clock = (clock + float(nuisance[0])) / SPEED_OF_LIGHT
        self._arcs.keep(time, measured)
        self._last_update = time
        if self._has_failed(innovation):
            self._start_anew()
            return RelativeSolution.none(
                time, ("innovations too large: starting anew",), self._age(time)
            )
        fixed = self._fix(time, measured, sky, innovation)
        return self._solution(time, measured, sky, innovation, degraded, excluded, laser, fixed)

    def _begin_arcs(self, time: GpsTime, measured: SingleDifferences, sky: Sky) -> None:
        """Add arcs and states for signals that have none."""
        state = self._state
        assert state is not None
        if all(key in self._arcs for key in measured.keys):
            return
        clock = _median(measured.code - sky.predicted - code_biases(state, measured))
        for row, key in enumerate(measured.keys):
            if key in self._arcs:
                continue
            if self._code_reference is None:
                self._code_reference = key.group
            label = ("code_bias", key.group)
            if key.group != self._code_reference and label not in state:
                state.add(label, 0.0, _UNKNOWN_CODE_BIAS_SIGMA**2)
            expected = float(sky.predicted[row] + clock)
            arc = self._arcs.start(time, measured, row, expected)
            wavelength = float(measured.wavelength[row])
            mean = arc.phase - wavelength * arc.offset_cycles - expected
            state.add(("ambiguity", key), mean, _UNKNOWN_AMBIGUITY_SIGMA**2)

    def _end_arc(self, key: SignalKey) -> None:
        """Forget an arc, its state, and the bias of its signal if no integer rests on it."""
        state = self._state
        assert state is not None
        had_integer = key in self._arcs and self._arcs[key].integer is not None
        self._arcs.end(key)
        state.remove([("ambiguity", key)])
        if had_integer and key.group not in self._arcs.fixed_groups():
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

        A phase that does not fit begins a new arc: at worst its ambiguity is decided anew. If many
        do not fit, it is the motion that is not what was predicted.
        """
        state = self._state
        assert state is not None
        count = len(measured)
        was_surprised = False
        for _ in range(_DETECTION_PASSES):
            innovation = measurement_innovation(state, self._arcs, measured, sky, clock, laser)
            self._leave_out_faults(innovation)
            left_out = np.flatnonzero(~innovation.is_used).tolist()
            slipped = [index - count for index in left_out if count <= index < 2 * count]
            if len(slipped) > max(2, count // 4) and not was_surprised:
                was_surprised = True
                degraded.append("the motion was not as predicted")
                for axis in range(6):
                    sigma = _SURPRISE_SIGMAS[axis // 3]
                    if self.configuration.dynamics != "static":
                        state.add_noise(("motion", axis), sigma**2)
                continue
            for row in slipped:
                key = measured.keys[row]
                excluded[key] = "cycle slip"
                self._end_arc(key)
            if not slipped:
                break
            self._begin_arcs(time, measured, sky)
        for index in left_out:
            if index < count:
                excluded.setdefault(measured.keys[index], "code outlier")
            elif index == 2 * count:
                degraded.append("laser range left out")
        return innovation

    def _leave_out_faults(self, innovation: Innovation) -> None:
        """Leave out one measurement after the other until none is a fault."""
        limit = self.configuration.fault_sigmas
        while innovation.degrees_of_freedom > 0:
            normalised = np.abs(innovation.normalised)
            worst = int(normalised.argmax())
            if normalised[worst] <= limit:
                return
            innovation.leave_out(worst)

    def _has_failed(self, innovation: Innovation) -> bool:
        """Return whether the innovations of consecutive epochs are too large as a whole."""
        freedom = innovation.degrees_of_freedom
        if freedom <= 0:
            return False
        probability = float(gammaincc(0.5 * freedom, 0.5 * max(innovation.squared_norm, 0.0)))
        is_bad = probability < self.configuration.global_probability
        self._global_failures = self._global_failures + 1 if is_bad else 0
        return self._global_failures >= _GLOBAL_FAILURES

    def _fix(
        self,
        time: GpsTime,
        measured: SingleDifferences,
        sky: Sky,
        innovation: Innovation,
    ) -> set[object]:
        """Make integers of what is certain; return the signals fixed at this epoch."""
        state, configuration = self._state, self.configuration
        assert state is not None
        count = len(measured)
        is_used = innovation.is_used[count : 2 * count]
        candidates = [
            self._arcs[key]
            for row, key in enumerate(measured.keys)
            if is_used[row] and measured.is_parity_known[row] and self._arcs[key].integer is None
        ]
        if not candidates:
            return set()
        wavelength = dict(zip(measured.keys, measured.wavelength.tolist(), strict=True))
        elevation = dict(zip(measured.keys, sky.elevation.tolist(), strict=True))
        self._attempt = fix_ambiguities(
            state,
            time,
            candidates,
            wavelength,
            elevation,
            configuration.success_rate,
            configuration.failure_rate,
            configuration.smallest_ratio,
        )
        return set(self._attempt.fixed)

    def _solution(
        self,
        time: GpsTime,
        measured: SingleDifferences | None,
        sky: Sky | None,
        innovation: Innovation | None,
        degraded: list[str],
        excluded: dict[SignalKey, str],
        laser: LaserMeasurement | None = None,
        fixed: set[object] | None = None,
    ) -> RelativeSolution:
        """Return the solution of an epoch."""
        state, absolute = self._state, self._absolute
        assert state is not None
        chief, relative = self._gcrf(time)
        covariance_chief, covariance = absolute.covariance, state.covariance[:6, :6]
        if self.configuration.dynamics != "orbital":
            both = np.kron(np.eye(2), OrbitalMotion.to_itrf(time).T)
            covariance_chief = both @ covariance_chief @ both.T
            covariance = both @ covariance @ both.T
        state_rtn, covariance_rtn = relative_rtn(chief, relative, covariance_chief, covariance)
        to_itrf = self._motion.to_itrf(time)
        kind, satellites, integers = self._kind(measured, innovation)
        if kind < SOLUTION_FIXED and measured is not None and self._attempt.reason:
            degraded.append(f"ambiguities: {self._attempt.reason}")
        statistics = _statistics(innovation)
        ambiguities, tec = AmbiguityTable(), DifferentialTecTable()
        if measured is not None and sky is not None and innovation is not None:
            count = len(measured)
            sigmas = np.sqrt(innovation.variances[count : 2 * count])
            ambiguities = ambiguity_table(state, self._arcs, measured, sigmas, fixed or set())
            tec = differential_tec_table(state, self._arcs, measured, sky)
        extras: dict[str, float] = {}
        layers = [k for k, label in enumerate(state.labels) if label[0] == "plasma"]
        if layers:
            variance = float(state.covariance[np.ix_(layers, layers)].sum())
            extras["local_electron_density"] = DENSITY_UNIT * float(state.mean[layers].sum())
            extras["local_electron_density_sigma"] = DENSITY_UNIT * math.sqrt(variance)
        if ("laser_latency",) in state:
            extras["laser_latency"] = state.value(("laser_latency",))
            extras["laser_latency_sigma"] = state.sigma(("laser_latency",))
            if laser is not None:
                extras["laser_residual"] = self._laser_residual(laser)
        return RelativeSolution(
            time=time,
            solution=kind,
            position_rtn=state_rtn[:3],
            velocity_rtn=state_rtn[3:],
            covariance_rtn=covariance_rtn,
            position_itrf=to_itrf @ state.mean[:3],
            covariance_position_itrf=to_itrf @ state.covariance[:3, :3] @ to_itrf.T,
            position_chief_gcrf=chief[:3],
            velocity_chief_gcrf=chief[3:],
            covariance_chief_gcrf=covariance_chief,
            satellites_used=satellites,
            ambiguities_fixed=integers,
            ratio=self._attempt.ratio,
            success_rate=self._attempt.success_rate,
            innovation_rms=statistics[0],
            normalised_innovation_squared=statistics[1],
            innovation_count=statistics[2],
            age=self._age(time),
            ambiguities=ambiguities,
            differential_tec=tec,
            clock_difference=self._clock,
            degraded=tuple(degraded),
            excluded=tuple(f"{key}: {reason}" for key, reason in excluded.items()),
            **extras,
        )

    def _gcrf(self, time: GpsTime) -> tuple[FloatArray, FloatArray]:
        """Return chief and difference in GCRF, each (6,)."""
        assert self._state is not None
        chief, relative = self._absolute.mean[:6], self._state.mean[:6]
        if self.configuration.dynamics == "orbital":
            return chief.copy(), relative.copy()
        first = state_itrf_to_gcrf(time, chief)
        return first, state_itrf_to_gcrf(time, chief + relative) - first

    def _kind(
        self, measured: SingleDifferences | None, innovation: Innovation | None
    ) -> tuple[int, int, int]:
        """Return the kind of the solution, the satellites used and the integers it rests on."""
        if measured is None or innovation is None:
            return SOLUTION_PREDICTED, 0, 0
        count = len(measured)
        code_used = innovation.is_used[:count]
        phase_used = innovation.is_used[count : 2 * count]
        satellites = len(np.unique(measured.satellite[code_used | phase_used]))
        used = [key for key, is_used in zip(measured.keys, phase_used, strict=True) if is_used]
        with_integer = [key for key in used if self._arcs[key].integer is not None]
        if len({key.satellite for key in with_integer}) >= _FEWEST_FIXED_SATELLITES:
            return SOLUTION_FIXED, satellites, len(with_integer)
        kind = SOLUTION_FLOAT if used else SOLUTION_CODE
        return kind, satellites, len(with_integer)

    def _laser_residual(self, laser: LaserMeasurement) -> float:
        """Return the range measured less that of the state with its latency, m."""
        assert self._state is not None
        position, velocity = self._state.mean[:3], self._state.mean[3:6]
        distance = float(np.linalg.norm(position))
        latency = self._state.value(("laser_latency",))
        return laser.range - distance - latency * float(position @ velocity) / distance


def _motion(configuration: CdgpsConfiguration) -> OrbitalMotion | TerrestrialMotion:
    """Return the motion model of a configuration."""
    noises = configuration.noise_chief, configuration.noise_relative
    if configuration.dynamics == "orbital":
        return OrbitalMotion(
            configuration.force_model,
            *noises,
            thrust_relative_sigma=configuration.thrust_relative_sigma,
            force_model_deputy=configuration.force_model_deputy,
        )
    return TerrestrialMotion(configuration.chief_motion, configuration.dynamics, *noises)


def _taken(measured: SingleDifferences, rows: npt.NDArray[np.intp]) -> SingleDifferences:
    """Return some rows."""
    if len(rows) == len(measured):
        return measured
    columns = {
        name: getattr(measured, name)[..., rows]
        for name in measured.__dataclass_fields__
        if name != "keys"
    }
    return SingleDifferences(keys=[measured.keys[row] for row in rows.tolist()], **columns)


def _code_clock(signals: SignalTable, seen: Geometry, receiver: int) -> float:
    """Return the receiver clock that codes tell, s; good to the ionosphere."""
    rows = seen.rows(signals.satellite)
    residual = signals.pseudorange - seen.range[receiver, rows] + seen.clock[receiver, rows]
    return _median(residual) / SPEED_OF_LIGHT


def _median(values: FloatArray) -> float:
    """Return the (upper) median; `numpy.median` takes ten times as long on so few numbers."""
    ordered = sorted(values.tolist())
    return ordered[len(ordered) // 2]


def _statistics(innovation: Innovation | None) -> tuple[float, float, int]:
    """Return the normalised RMS, the normalised square and its degrees of freedom."""
    if innovation is None or innovation.degrees_of_freedom <= 0:
        return 0.0, 0.0, 0
    normalised = innovation.normalised
    count = np.count_nonzero(innovation.is_used)
    rms = math.sqrt(float(normalised @ normalised) / count)
    return rms, innovation.squared_norm, innovation.degrees_of_freedom
