"""Carrier-phase differential filter: the position of one receiver relative to another.

The filter uses single differences of code and phase on any mix of signals and propagates both
spacecraft with all forces. Integers are fixed and held; faults show in the innovations. Sources:
Kroes (2006), Precise relative positioning of formation flying spacecraft using GPS; Leung and
Montenbruck (2005), Real-time navigation of formation-flying spacecraft using GPS (JGCD 28, 2);
Teunissen (1995) for the integers.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.earth import state_itrf_to_gcrf
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray, norm
from vtff_gnss.constants import EARTH_ROTATION_RATE_BROADCAST
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.orbits.satellite_table import SatelliteTable
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.filter import RelativeFilter, Update
from vtff_nav.relative.cdgps.model import make_sky
from vtff_nav.relative.cdgps.omitted_accelerations import relative_noise
from vtff_nav.relative.cdgps.orbit_filter import AbsoluteFilter
from vtff_nav.relative.cdgps.output import (
    ambiguity_table,
    differential_tec_table,
    relative_rtn,
)
from vtff_nav.relative.common.antenna_correction import Attitudes
from vtff_nav.relative.common.columns import are_all, with_columns
from vtff_nav.relative.common.dynamics import (
    DYNAMIC_STATES,
    MotionNoise,
    OrbitalMotion,
    Prediction,
    TerrestrialMotion,
    ThrustInterval,
)
from vtff_nav.relative.common.estimator_inputs import EstimatorInputs
from vtff_nav.relative.common.measurements import (
    Geometry,
    SignalReader,
    SignalTable,
    compute_geometry,
    form_single_differences,
    satellite_mask,
    satellite_numbers,
)
from vtff_nav.relative.common.orbit_single_point import form_combinations, solve_single_point
from vtff_nav.relative.common.solution import (
    SOLUTION_FIXED,
    SOLUTION_PREDICTED,
    LaserMeasurement,
    RelativeSolution,
)
from vtff_nav.relative.kernels.combinations import clock_from_codes
from vtff_nav.relative.kernels.sky import move_over_ground

__all__ = ["CdgpsEstimator"]

# The same codes give the first state and its first update: the first state counts for little.
_START_INFLATION = 25.0
_START_VELOCITY_SIGMA = 30.0
# The codes of the deputy help the chief from this sigma of the difference on, m.
_LOCATED_SIGMA = 0.1

# At larger distances both orbits are estimated together: an error of the chief's turns the rays to
# the satellites, 0.1 mm for 10 cm. They are so until the distance is half of it, m.
_JOINT_DISTANCE = 2e4

# The clocks with which the times of reception are computed are replaced if they are off by more, s.
# Smaller errors are corrected well enough by the derivative of the range.
_CLOCK_TOLERANCE = 3e-7

# Its other fields are those of a prediction.
_NO_SOLUTION = RelativeSolution.none(GpsTime(0), ())


class CdgpsEstimator(EstimatorInputs):
    """Relative navigation filter; see `vtff_nav.relative.common.solution.RelativeEstimator`.

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
        super().__init__(ephemerides)
        self.configuration = configuration or CdgpsConfiguration()
        self._motion = _motion(self.configuration)
        self._absolute = AbsoluteFilter(self.configuration)
        self._signal_reader = SignalReader(
            self.configuration.measurement_noise, self.configuration.bands
        )
        self._mask_of_table: tuple[SatelliteTable, npt.NDArray[np.bool_]] | None = None
        self._table_in_view: tuple[SatelliteTable, npt.NDArray[np.bool_], SatelliteTable] | None
        self._table_in_view = None
        self._relative: RelativeFilter | None = None
        self.reset()

    def reset(self) -> None:
        """Forget every estimate; keep the ephemerides."""
        self._forget_relative()
        self._absolute.reset()
        self._time: GpsTime | None = None
        self._last_update: GpsTime | None = None

    def _forget_relative(self) -> None:
        """Forget the relative state."""
        if self._are_joint:
            self._absolute.part_from_relative()
            self._motion = _motion(self.configuration)
        self._trusts_gravity = False
        self._relative = None
        self._attitudes_used: Attitudes = (None, None)

    def process(
        self,
        time: GpsTime,
        chief: ObservationEpoch | None,
        deputy: ObservationEpoch | None,
        laser: LaserMeasurement | None = None,
    ) -> RelativeSolution:
        """Process the measurements of an epoch; see `RelativeEstimator.process`.

        Raises
        ------
        ValueError
            If `time` is not after the last epoch.
        """
        interval = 1.0 if self._time is None else time - self._time
        if not interval > 0.0:
            raise ValueError(f"time {time}: not after the epoch before, {self._time}")
        table = self._ephemeris_table(time)
        signals = [self._read_signals(epoch, table) for epoch in (chief, deputy)]
        if self._absolute.state is not None and self._time is not None:
            self._predict(self._time, interval, self._thrust_within(self._time, time))
        self._thrust = [each for each in self._thrust if each.end.nanoseconds > time.nanoseconds]
        self._time = time
        if self._is_outdated(time):
            self.reset()
            self._time = time
        reasons = self._start(time, (chief, deputy), signals, table)
        if self._absolute.state is None or self._relative is None:
            return RelativeSolution.none(time, tuple(reasons), self._age(time))
        self._join_or_part()
        return self._update(time, interval, (chief, deputy), signals, table, laser)

    @property
    def _are_joint(self) -> bool:
        """Whether the orbits of chief and deputy are members of one state."""
        return self._relative is not None and self._relative.state is self._absolute.state

    def _join_or_part(self) -> None:
        """Estimate both orbits in one state where the spacecraft are far apart."""
        absolute, relative = self._absolute, self._relative
        assert absolute.state is not None and relative is not None
        if self.configuration.dynamics != "orbital":
            return
        distance = norm(relative.state.mean[:3])
        if not self._are_joint and distance > _JOINT_DISTANCE:
            absolute.trust_forces()
            relative.state.join(absolute.state)
            absolute.state = relative.state
        elif self._are_joint and distance < 0.5 * _JOINT_DISTANCE:
            absolute.part_from_relative()
            relative.state.remove(absolute.state.labels)
            self._expect_accelerations(self.configuration.noise_relative)
        # The orbit of the chief shows before the difference does whether gravity is as modelled.
        if self._are_joint and not self._trusts_gravity and absolute.acceleration.is_borne_out:
            self._expect_accelerations(relative_noise(self.configuration, norm(absolute.mean[:3])))
            self._trusts_gravity = True

    def _expect_accelerations(self, noise: MotionNoise) -> None:
        """Have another a priori noise of the relative motion from now on."""
        assert self._relative is not None
        self._trusts_gravity = False
        self._motion = _motion(replace(self.configuration, noise_relative=noise))
        self._relative.expect_accelerations(noise)

    def _is_outdated(self, time: GpsTime) -> bool:
        """Return whether the last measurement is too old to go on from."""
        last = self._last_update
        return last is not None and time - last > self.configuration.longest_prediction

    def _age(self, time: GpsTime) -> float:
        return 0.0 if self._last_update is None else time - self._last_update

    def _read_signals(
        self, epoch: ObservationEpoch | None, table: SatelliteTable
    ) -> SignalTable | None:
        """Return the signals of a receiver whose satellites have an ephemeris; None without."""
        if epoch is None:
            return None
        if self._mask_of_table is None or self._mask_of_table[0] is not table:
            self._mask_of_table = (table, satellite_mask(satellite_numbers(table)))
        signals = self._signal_reader.read(epoch, self._mask_of_table[1])
        return signals if len(signals) else None

    def _select_in_view(
        self, table: SatelliteTable, signals: list[SignalTable | None]
    ) -> SatelliteTable:
        """Return a table of the satellites in view; the same object while they are the same."""
        satellites = np.concatenate([s.satellite for s in signals if s is not None])
        if self._table_in_view is not None:
            whole, is_in_view, in_view = self._table_in_view
            if whole is table and are_all(is_in_view[satellites]):
                return in_view
        satellites = np.unique(satellites)
        rows = np.searchsorted(satellite_numbers(table), satellites)
        in_view = table.select(rows)
        self._table_in_view = (table, satellite_mask(satellites), in_view)
        return in_view

    def _start(
        self,
        time: GpsTime,
        epochs: tuple[ObservationEpoch | None, ObservationEpoch | None],
        signals: list[SignalTable | None],
        table: SatelliteTable,
    ) -> list[str]:
        """Initialise the filters that are not running; return why one could not be."""
        chief, deputy = epochs
        if self._absolute.state is None:
            self._forget_relative()
            if chief is None or signals[0] is None:
                return ["no observations of the chief"]
            if not self._absolute.start(time, chief.time, signals[0], table):
                return ["the chief has no position: too few satellites or no velocity yet"]
        if self._relative is not None:
            return []
        if deputy is None or signals[1] is None:
            return ["no observations of the deputy"]
        mask = math.radians(self.configuration.elevation_mask_deg)
        measured = form_combinations(signals[1], table)
        has_troposphere = self.configuration.has_troposphere
        point = solve_single_point(measured, table, deputy.time, mask, has_troposphere)
        if point is None:
            return ["the deputy has no position: too few satellites"]
        received = deputy.time - point.clock / SPEED_OF_LIGHT
        state_itrf = self._motion.state_itrf(time, self._absolute.mean[:6])
        position = point.position_itrf + (time - received) * state_itrf[3:]
        # With a surveyed chief the error that the codes of both receivers share is known.
        position -= self._absolute.code_error(chief, state_itrf)
        mean = np.zeros(DYNAMIC_STATES)
        mean[:3] = self._motion.to_itrf(time).T @ (position - state_itrf[:3])
        covariance = np.zeros((DYNAMIC_STATES, DYNAMIC_STATES))
        covariance[:3, :3] = _START_INFLATION * (point.covariance + np.eye(3))
        covariance[:3, :3] += self._absolute.covariance[:3, :3]
        if self.configuration.dynamics != "static":
            covariance[3:6, 3:6] = _START_VELOCITY_SIGMA**2 * np.eye(3)
        if self.configuration.dynamics == "orbital":
            if np.isfinite(point.velocity_itrf).all():
                # The velocity from Doppler has no part in the covariance of the start.
                state_deputy = np.concatenate((point.position_itrf, point.velocity_itrf))
                velocity = state_itrf_to_gcrf(received, state_deputy)[3:]
                mean[3:6] = velocity - self._absolute.mean[3:6]
            noise = self.configuration.noise_relative.at_distance(norm(mean[:3]))
            covariance[6:, 6:] = np.diag(noise.sigma**2)
        clock = point.clock / SPEED_OF_LIGHT - self._absolute.clock
        self._relative = RelativeFilter(self.configuration, mean, covariance, clock)
        return []

    def _predict_motion(
        self, time: GpsTime, interval: float, thrust: list[ThrustInterval]
    ) -> Prediction:
        """Return where the motion leads."""
        absolute, relative = self._absolute, np.zeros(DYNAMIC_STATES)
        thrust_sigma, relative_factor = self.configuration.thrust_relative_sigma, 1.0
        if self._relative is not None:
            relative = self._relative.state.mean[:DYNAMIC_STATES]
            thrust_sigma = self._relative.thrust_sigma
            relative_factor = self._relative.acceleration.factor
        factors = (absolute.acceleration.factor, relative_factor)
        return self._motion.predict(
            time, interval, absolute.mean, relative, thrust, thrust_sigma, factors
        )

    def _thrust_within(self, begin: GpsTime, end: GpsTime) -> list[ThrustInterval]:
        """Return the thrust that acts between two times."""
        first, last = begin.nanoseconds, end.nanoseconds
        return [
            each
            for each in self._thrust
            if each.end.nanoseconds > first and each.start.nanoseconds < last
        ]

    def _predict(self, time: GpsTime, interval: float, thrust: list[ThrustInterval]) -> None:
        """Propagate both filters by an interval (s) that begins at `time`."""
        absolute, end = self._absolute, time + interval
        predicted = self._predict_motion(time, interval, thrust)
        before = absolute.mean[:3].copy()
        absolute.predict(
            predicted.chief, predicted.transition_chief, predicted.noise_chief, interval
        )
        if self._relative is not None:
            motion_deg = self._motion_over_ground_deg(before, absolute.mean[:3], interval)
            turn = self._rotation_body_to_rtn(time, end) if thrust else None
            self._relative.predict(predicted, interval, motion_deg, turn)

    def _rotation_body_to_rtn(self, time: GpsTime, end: GpsTime) -> FloatArray | None:
        """Return the rotation from the deputy's body to the chief's RTN axes; None without need.

        Only thrusters that are fixed in the body need it, to find what an error of the attitude
        does: a rotation that is 0.1 deg wrong changes 0.2 % of that.
        """
        attitude = self._attitudes_at(end)[1]
        if not self.configuration.thrust_follows_attitude or attitude is None:
            return None
        to_rtn = rotation_gcrf_to_rtn(self._absolute.mean[:6])
        return np.asarray(to_rtn @ attitude.rotation_gcrf_from_body(time))

    def _motion_over_ground_deg(
        self, before: FloatArray, after: FloatArray, interval: float
    ) -> FloatArray:
        """Return the geocentric angles to north and east between two positions, deg, shape (2,)."""
        turn = 0.0
        if self.configuration.dynamics == "orbital":
            turn = interval * EARTH_ROTATION_RATE_BROADCAST
        axes, moved = move_over_ground(before, after, turn)
        return np.asarray(np.degrees(axes @ moved))

    def _update(
        self,
        time: GpsTime,
        interval: float,
        epochs: tuple[ObservationEpoch | None, ObservationEpoch | None],
        signals: list[SignalTable | None],
        table: SatelliteTable,
        laser: LaserMeasurement | None,
    ) -> RelativeSolution:
        """Update both filters with the observations of an epoch and return the solution."""
        degraded = [
            f"no observations of the {name}"
            for name, signals_of_receiver in zip(("chief", "deputy"), signals, strict=True)
            if signals_of_receiver is None
        ]
        seen, states, rotations = None, np.zeros((2, 6)), None
        if signals[0] is not None or signals[1] is not None:
            table = self._select_in_view(table, signals)
            states, rotations = self._antenna_states_itrf(time)
            seen = self._synchronise(time, epochs, signals, table, states)
            signals = self._refer_to_antennas(signals, seen, rotations)
        if seen is not None and signals[0] is not None:
            before = self._positions()
            assert self._relative is not None
            self._absolute.update(
                time,
                signals[0],
                table,
                seen,
                *self._help_of_deputy(signals[1]),
                # A single difference has the scatter of two receivers.
                self._relative.scatter.common_sigma / math.sqrt(2.0),
            )
            if self._absolute.state is None:
                self._forget_relative()
                return RelativeSolution.none(
                    time, ("the orbit of the chief has been given up",), self._age(time)
                )
            shift = np.einsum("rni,ri->rn", seen.direction, self._positions() - before)
            seen = with_columns(seen, range=seen.range - shift)
        if seen is None or signals[0] is None or signals[1] is None:
            return self._solution(time, None, degraded, None)
        measured = form_single_differences(signals[0], signals[1])
        rows = seen.columns(measured.satellite)
        mask = math.radians(self.configuration.elevation_mask_deg)
        elevation = seen.elevation[0, rows]
        is_above = elevation > mask
        if not are_all(is_above):
            measured = measured.select(np.flatnonzero(is_above))
        if not len(measured):
            degraded.append("no satellite in common view")
            return self._solution(time, None, degraded, None)
        if self.configuration.measurement_noise.elevation_noise_ratio > 0.0:
            growth = self.configuration.measurement_noise.growth(elevation[is_above])
            measured = measured.grown(growth)
        assert self._relative is not None
        positions = self._positions()
        attitudes = self._attitudes_at(time)
        sky = make_sky(
            measured, seen, states[:, :3], positions, self.configuration, rotations, attitudes
        )
        self._relative.expect_satellite_offsets(
            self._absolute.broadcast_sigma,
            measured.keys.distinct_satellites,
            seen.range,
        )
        self._relative.expect_plasma_waves(measured.keys.distinct_satellites)
        update = self._relative.update(time, interval, measured, sky, laser)
        self._last_update = time
        if update.has_failed:
            self._forget_relative()
            reason = "innovations too large: starting anew"
            return RelativeSolution.none(time, (reason,), self._age(time))
        return self._solution(time, update, degraded, laser)

    def _positions(self) -> FloatArray:
        """Return the positions of chief and deputy, navigation axes, m, shape (2, 3)."""
        assert self._relative is not None
        chief = self._absolute.mean[:3]
        return np.array([chief, chief + self._relative.state.mean[:3]])

    def _help_of_deputy(self, signals: SignalTable | None) -> tuple[SignalTable | None, float]:
        """Return what the deputy's signals tell of the chief, and the sigma of slow phase errors.

        Its phases tell something only where both orbits are members of one state.
        """
        assert self._relative is not None
        slow_sigma = math.inf
        if self._are_joint:
            slow_sigma = self._relative.noise.phase.slow.sigma / math.sqrt(2.0)
        if signals is None or not self._is_deputy_located():
            return None, slow_sigma
        if self._are_joint:
            return self._relative.without_ambiguities(signals), slow_sigma
        unknown = np.full(len(signals), np.nan)
        return with_columns(signals, carrier_range=unknown), slow_sigma

    def _is_deputy_located(self) -> bool:
        """Return whether the deputy's orbit is known, but for that of the chief."""
        if self._relative is None or self.configuration.dynamics != "orbital":
            return False
        return self._relative.state.trace(3) < _LOCATED_SIGMA**2

    def _antenna_states_itrf(self, time: GpsTime) -> tuple[FloatArray, FloatArray | None]:
        """Return states of both antennas (2, 6), and rotations from body to navigation axes.

        The states are position and Earth-fixed velocity; the rotations, shape (2, 3, 3), are None
        where the antennas are in the centres of mass.
        """
        assert self._relative is not None
        chief = self._absolute.mean[:6]
        centres = (chief, chief + self._relative.state.mean[:6])
        states = np.array([self._motion.state_itrf(time, centre) for centre in centres])
        antennas = self.configuration.antennas
        if antennas is None:
            return states, None
        attitudes = self._attitudes_at(time)
        rotations = antennas.rotations_body_to_itrf(time, states, attitudes)
        self._relative.expect_attitude_errors(
            antennas.attitude_variances(attitudes),
            antennas.attitude_turns(
                time,
                self._attitudes_used,
                attitudes,
                self._corrections_since(self._attitudes_used, attitudes),
            ),
        )
        self._attitudes_used = attitudes
        to_navigation = self._motion.to_itrf(time).T
        return antennas.states_itrf(states, rotations), to_navigation @ rotations

    def _refer_to_antennas(
        self, signals: list[SignalTable | None], seen: Geometry, rotations: FloatArray | None
    ) -> list[SignalTable | None]:
        """Return the signals as the reference points of the antennas would receive them."""
        antennas = self.configuration.antennas
        if antennas is None or rotations is None:
            return signals
        return [
            None if table is None else antennas.corrected(table, receiver, seen, rotation)
            for receiver, (table, rotation) in enumerate(zip(signals, rotations, strict=True))
        ]

    def _synchronise(
        self,
        time: GpsTime,
        epochs: tuple[ObservationEpoch | None, ObservationEpoch | None],
        signals: list[SignalTable | None],
        table: SatelliteTable,
        states: FloatArray,
    ) -> Geometry:
        """Set the receiver clocks from codes; return the geometry at the times of reception."""
        to_itrf = self._motion.to_itrf(time)
        assert self._relative is not None
        clocks = [self._absolute.clock, self._absolute.clock + self._relative.clock]
        for _ in range(3):
            offsets = np.array(
                [
                    (0.0 if epoch is None else epoch.time - time) - clock
                    for epoch, clock in zip(epochs, clocks, strict=True)
                ]
            )
            seen = compute_geometry(table, time, offsets, states, to_itrf)
            has_changed = False
            for receiver, signals_of_receiver in enumerate(signals):
                if signals_of_receiver is None:
                    continue
                clock = _clock_from_codes(signals_of_receiver, seen, receiver)
                if abs(clock - clocks[receiver]) > _CLOCK_TOLERANCE:
                    clocks[receiver], has_changed = clock, True
            if not has_changed:
                break
        self._absolute.clock = clocks[0]
        self._relative.clock = clocks[1] - clocks[0]
        return seen

    def _solution(
        self,
        time: GpsTime,
        update: Update | None,
        degraded: list[str],
        laser: LaserMeasurement | None,
    ) -> RelativeSolution:
        """Return the solution of an epoch; without `update` it is a prediction."""
        filter_, absolute = self._relative, self._absolute
        assert filter_ is not None
        state = filter_.state
        chief, relative = self._gcrf(time)
        covariance_chief, covariance = absolute.covariance, state.covariance[:6, :6]
        covariance_cross = None
        if self._are_joint:
            covariance_cross = state.covariance[:6, absolute.motion][:, :6]
        if self.configuration.dynamics != "orbital":
            to_gcrf = np.kron(np.eye(2), OrbitalMotion.to_itrf(time).T)
            covariance_chief = to_gcrf @ covariance_chief @ to_gcrf.T
            covariance = to_gcrf @ covariance @ to_gcrf.T
        state_rtn, covariance_rtn = relative_rtn(
            chief, relative, covariance_chief, covariance, covariance_cross
        )
        to_itrf = self._motion.to_itrf(time)
        density, density_sigma = filter_.local_density()
        latency, latency_sigma, residual = filter_.laser(laser)
        predicted = with_columns(
            _NO_SOLUTION,
            time=time,
            solution=SOLUTION_PREDICTED,
            position_rtn=state_rtn[:3],
            velocity_rtn=state_rtn[3:],
            covariance_rtn=covariance_rtn,
            position_itrf=to_itrf @ state.mean[:3],
            covariance_position_itrf=to_itrf @ state.covariance[:3, :3] @ to_itrf.T,
            position_chief_gcrf=chief[:3],
            velocity_chief_gcrf=chief[3:],
            covariance_chief_gcrf=covariance_chief,
            age=self._age(time),
            local_electron_density=density,
            local_electron_density_sigma=density_sigma,
            clock_difference=filter_.clock,
            degraded=tuple(degraded),
            laser_latency=latency,
            laser_latency_sigma=latency_sigma,
            laser_residual=residual,
        )
        return predicted if update is None else _add_update(predicted, filter_, update)

    def _gcrf(self, time: GpsTime) -> tuple[FloatArray, FloatArray]:
        """Return chief and difference in GCRF, each (6,)."""
        assert self._relative is not None
        chief, relative = self._absolute.mean[:6], self._relative.state.mean[:6]
        if self.configuration.dynamics == "orbital":
            return chief.copy(), relative.copy()
        chief_gcrf = state_itrf_to_gcrf(time, chief)
        return chief_gcrf, state_itrf_to_gcrf(time, chief + relative) - chief_gcrf


def _add_update(
    predicted: RelativeSolution, filter_: RelativeFilter, update: Update
) -> RelativeSolution:
    """Return a solution with the kind, statistics and tables of a measurement update."""
    kind, satellites, integers = filter_.classify(update)
    degraded = [*predicted.degraded, *update.degraded]
    if kind < SOLUTION_FIXED and filter_.attempt.reason:
        degraded.append(f"ambiguities: {filter_.attempt.reason}")
    rms, squared, freedom = update.statistics
    measured, state, arcs = update.measured, filter_.state, filter_.arcs
    return with_columns(
        predicted,
        solution=kind,
        satellites_used=satellites,
        ambiguities_fixed=integers,
        ratio=filter_.attempt.ratio,
        success_rate=filter_.attempt.success_rate,
        innovation_rms=rms,
        normalised_innovation_squared=squared,
        innovation_count=freedom,
        ambiguities=ambiguity_table(state, arcs, measured, update.innovation, update.fixed),
        differential_tec=differential_tec_table(state, arcs, measured, update.sky),
        degraded=tuple(degraded),
        excluded=tuple(f"{key}: {reason}" for key, reason in update.excluded.items()),
    )


def _motion(configuration: CdgpsConfiguration) -> OrbitalMotion | TerrestrialMotion:
    """Return the motion model of a configuration."""
    if configuration.dynamics == "orbital":
        return OrbitalMotion(
            configuration.force_model,
            configuration.noise_chief,
            configuration.noise_relative,
            force_model_deputy=configuration.force_model_deputy,
            integrator=configuration.integrator,
            longest_step=configuration.longest_step,
        )
    return TerrestrialMotion(
        configuration.chief_motion,
        configuration.dynamics,
        configuration.noise_chief,
        configuration.noise_relative,
    )


def _clock_from_codes(signals: SignalTable, seen: Geometry, receiver: int) -> float:
    """Return the receiver clock from the codes, s; it is in error by the ionosphere."""
    clock: float = clock_from_codes(
        seen.columns(signals.satellite), signals.pseudorange, seen.range, seen.clock, receiver
    )
    return clock / SPEED_OF_LIGHT
