"""The relative navigation of the VTFF testbed paper: single-differenced carrier phase, 8 states.

The ambiguities are no states: they are set to integers when a signal comes into view, from the
state at that time, and then held. A start that is wrong by decimetres therefore stays wrong, and
the paper names "poor initial EKF estimations" as the cause of its station-keeping error. Here the
fraction of a cycle that all first ambiguities share is given to the clock. The integers are then
right if the start is better than about half a cycle along each line of sight. No test is made of
the integers, and the covariance takes them as certain.

References
----------
Peng and others, sections 3.3 and 3.4, equations 3 to 6, and appendix A.2; Busse, How and Simpson
(2003), "Demonstration of adaptive extended Kalman filter for low-Earth-orbit formation estimation
using CDGPS", Navigation 50, 79-93.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf, state_gcrf_to_itrf, state_itrf_to_gcrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss import constants as c
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.orbits.satellite_table import SatelliteTable
from vtff_nav.relative.cdgps.ambiguity_arcs import ArcBook
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.orbit_filter import AbsoluteFilter
from vtff_nav.relative.cdgps.output import relative_rtn
from vtff_nav.relative.common.dynamics import DYNAMIC_STATES, OrbitalMotion
from vtff_nav.relative.common.estimator_inputs import EstimatorInputs
from vtff_nav.relative.common.measurements import (
    DEFAULT_BANDS,
    Geometry,
    SignalReader,
    SingleDifferences,
    compute_geometry,
    form_single_differences,
    satellite_mask,
    satellite_numbers,
)
from vtff_nav.relative.common.solution import (
    AMBIGUITY_FLOAT,
    SOLUTION_FLOAT,
    SOLUTION_PREDICTED,
    AmbiguityTable,
    LaserMeasurement,
    RelativeSolution,
)
from vtff_nav.relative.paper.code_mean import CodeMean, StartEpoch
from vtff_nav.relative.paper.configuration import PaperConfiguration
from vtff_nav.relative.paper.filter import (
    CLOCK,
    CLOCK_RATE,
    MOTION,
    POSITION,
    STATES,
    VELOCITY,
    CarrierPhaseFilter,
    process_noise,
    state_jacobian,
)

__all__ = ["PaperConfiguration", "PaperEstimator"]

_CLOCK_JUMP = 30.0
"""A clock that changes by more (m), or has a larger sigma after an outage, is taken from the codes.
Codes give a clock to below 1 m, and steered clocks change by less in a second."""


@dataclass(frozen=True, eq=False)
class _Measured:
    """Single differences of an epoch, with ephemerides and time tags (less `time`, s)."""

    time: GpsTime
    table: SatelliteTable
    differences: SingleDifferences
    tag_offsets: FloatArray


class PaperEstimator(EstimatorInputs):
    """Relative state of two spacecraft in orbit, as in the paper; a `RelativeEstimator`.

    The first `start_duration` seconds give no solution. The chief's orbit, which the paper takes
    from the propagator of the simulation itself, comes from the chief's own observations.

    Parameters
    ----------
    configuration : PaperConfiguration, optional
    """

    def __init__(self, configuration: PaperConfiguration | None = None) -> None:
        super().__init__()
        self.configuration = configuration or PaperConfiguration()
        orbit = CdgpsConfiguration(
            force_model=self.configuration.force_model,
            measurement_noise=self.configuration.measurement_noise,
            elevation_mask_deg=self.configuration.elevation_mask_deg,
        )
        self._motion = OrbitalMotion(
            self.configuration.force_model, orbit.noise_chief, orbit.noise_relative
        )
        self._chief = AbsoluteFilter(orbit)
        noise = self.configuration.measurement_noise
        self._chief_signals = SignalReader(noise, DEFAULT_BANDS)
        self._signals = SignalReader(noise, self.configuration.bands)
        self.reset()

    def reset(self) -> None:
        """Forget every estimate; keep the ephemerides."""
        self._chief.reset()
        self._thrust.clear()
        self._time: GpsTime | None = None
        self._restart()

    def _restart(self) -> None:
        """Forget the relative state."""
        self._filter: CarrierPhaseFilter | None = None
        self._arcs = ArcBook()
        self._mean = CodeMean()
        self._mean_since: GpsTime | None = None
        self._last_start: StartEpoch | None = None
        self._last_update: GpsTime | None = None

    def process(
        self,
        time: GpsTime,
        chief: ObservationEpoch | None,
        deputy: ObservationEpoch | None,
        laser: LaserMeasurement | None = None,
    ) -> RelativeSolution:
        """Process the carrier phases of an epoch; see `RelativeEstimator.process`.

        A laser range is not used: the paper has none.

        Raises
        ------
        ValueError
            If `time` is not after the last epoch.
        """
        interval = 1.0 if self._time is None else time - self._time
        if not interval > 0.0:
            raise ValueError(f"time {time}: not after the epoch before, {self._time}")
        table = self._ephemeris_table(time)
        self._predict(time)
        self._time = time
        self._update_chief(time, chief, table)
        if self._chief.state is None:
            self._restart()
            return RelativeSolution.none(time, ("the chief has no position yet",))
        measured = self._form_differences(time, interval, chief, deputy, table)
        if self._filter is None:
            self._start(measured)
        elif measured is not None:
            self._update(measured)
        age = 0.0 if self._last_update is None else time - self._last_update
        if age > self.configuration.longest_prediction:
            self._restart()
        if self._filter is None:
            return RelativeSolution.none(time, (self._start_reason(time, deputy),), age)
        return self._solution(measured, age)

    def _start_reason(self, time: GpsTime, deputy: ObservationEpoch | None) -> str:
        if deputy is None:
            return "no observations of the deputy"
        seconds = 0.0 if self._mean_since is None else time - self._mean_since
        return f"mean of the code differences: {seconds:.0f} s"

    def _predict(self, time: GpsTime) -> None:
        """Propagate chief and difference to an epoch."""
        if self._time is None or self._chief.state is None:
            return
        begin, duration = self._time, time - self._time
        self._thrust = [interval for interval in self._thrust if interval.end > begin]
        chief = self._chief.mean.copy()
        relative = np.zeros(DYNAMIC_STATES)
        if self._filter is not None:
            relative[:6] = state_itrf_to_gcrf(begin, self._filter.x[list(MOTION)])
        factors = (self._chief.acceleration.factor, 1.0)
        prediction = self._motion.predict(
            begin, duration, chief, relative, self._thrust, noise_factors=factors
        )
        self._chief.predict(
            prediction.chief, prediction.transition_chief, prediction.noise_chief, duration
        )
        if self._filter is None:
            return
        mean = self._filter.x.copy()
        mean[list(MOTION)] = state_gcrf_to_itrf(time, prediction.relative[:6])
        mean[CLOCK] += duration * mean[CLOCK_RATE]
        middle = chief[:3] + 0.5 * relative[:3]
        jacobian = state_jacobian(middle, rotation_gcrf_to_itrf(begin))
        given = self.configuration
        noise = process_noise(
            duration, given.acceleration_noise, given.clock_noise, given.clock_rate_noise
        )
        self._filter.predict_to(mean, expm(duration * jacobian), noise)

    def _update_chief(
        self, time: GpsTime, epoch: ObservationEpoch | None, table: SatelliteTable
    ) -> None:
        """Update the chief's orbit and clock, or initialise them."""
        if epoch is None:
            return
        signals = self._chief_signals.read(epoch, satellite_mask(satellite_numbers(table)))
        if not len(signals):
            return
        if self._chief.state is None:
            self._chief.start(time, epoch.time, signals, table)
            return
        seen = self._chief_geometry(time, epoch.time - time, table)
        columns = seen.columns(signals.satellite)
        distance = (seen.range[0] - seen.clock[0])[columns]
        clock = float(np.median(signals.pseudorange - distance)) / SPEED_OF_LIGHT
        if abs(clock - self._chief.clock) > _CLOCK_JUMP / SPEED_OF_LIGHT:
            self._chief.clock = clock
            seen = self._chief_geometry(time, epoch.time - time, table)
        self._chief.update(time, signals, table, seen)

    def _chief_geometry(self, time: GpsTime, tag_offset: float, table: SatelliteTable) -> Geometry:
        state = state_gcrf_to_itrf(time, self._chief.mean[:6])
        offsets = np.full(2, tag_offset - self._chief.clock)
        return compute_geometry(
            table, time, offsets, np.array([state] * 2), rotation_gcrf_to_itrf(time)
        )

    def _form_differences(
        self,
        time: GpsTime,
        interval: float,
        chief: ObservationEpoch | None,
        deputy: ObservationEpoch | None,
        table: SatelliteTable,
    ) -> _Measured | None:
        """Return the signals in common view; forget the ambiguities of signals that slipped."""
        if chief is None or deputy is None:
            return None
        has_ephemeris = satellite_mask(satellite_numbers(table))
        signals = [self._signals.read(epoch, has_ephemeris) for epoch in (chief, deputy)]
        # Without parity the phase may be off by half a cycle.
        chief_signals, deputy_signals = (
            s.select(np.flatnonzero(s.flags & c.FLAG_PARITY_KNOWN)) for s in signals
        )
        differences = form_single_differences(chief_signals, deputy_signals)
        for key in self._arcs.find_breaks(time, differences, interval):
            self._arcs.end(key)
            self._mean.forget(key)
        if not len(differences):
            return None
        tags = np.array([chief.time - time, deputy.time - time])
        return _Measured(time, table, differences, tags)

    def _start(self, measured: _Measured | None) -> None:
        """Average code differences; initialise the filter when that has lasted long enough."""
        if measured is None:
            return
        time, differences = measured.time, measured.differences
        for row, key in enumerate(differences.keys):
            if key not in self._arcs:
                self._arcs.start(time, differences, row, float(differences.code[row]))
        self._arcs.record(time, differences)
        self._mean.add(differences)
        epoch = StartEpoch(
            time,
            measured.table,
            differences,
            state_gcrf_to_itrf(time, self._chief.mean[:6]),
            measured.tag_offsets - self._chief.clock,
        )
        last, self._last_start = self._last_start, epoch
        if self._mean_since is None:
            self._mean_since = time
        if last is None or time - self._mean_since < self.configuration.start_duration:
            return
        now, before = self._mean.solve(epoch), self._mean.solve(last)
        if now is None or before is None:
            return
        mean, covariance = np.zeros(STATES), np.zeros((STATES, STATES))
        mean[POSITION], mean[CLOCK] = now.position_itrf, now.clock
        mean[VELOCITY] = self._solve_velocity(last, before.position_itrf, time, now.position_itrf)
        mean[CLOCK_RATE] = (now.clock - before.clock) / (time - last.time)
        given = self.configuration
        covariance[:4, :4] = now.covariance
        covariance[CLOCK, CLOCK] += given.clock_sigma**2
        covariance[VELOCITY, VELOCITY] = given.velocity_sigma**2 * np.eye(3)
        covariance[CLOCK_RATE, CLOCK_RATE] = given.clock_sigma**2
        self._filter = CarrierPhaseFilter(mean, covariance)
        self._arcs = ArcBook()
        self._update(measured)

    def _solve_velocity(
        self, last: StartEpoch, before: FloatArray, time: GpsTime, now: FloatArray
    ) -> FloatArray:
        """Return the Earth-fixed relative velocity that leads from one position to the next."""
        duration = time - last.time
        chief, relative = np.zeros(DYNAMIC_STATES), np.zeros(DYNAMIC_STATES)
        chief[:6] = state_itrf_to_gcrf(last.time, last.state_chief_itrf)
        velocity = (now - before) / duration
        # The path is not straight: gravity gradient, rotation of the Earth and thrust bend it.
        for _ in range(2):
            relative[:6] = state_itrf_to_gcrf(last.time, np.concatenate((before, velocity)))
            prediction = self._motion.predict(last.time, duration, chief, relative, self._thrust)
            predicted = state_gcrf_to_itrf(time, prediction.relative[:6])
            velocity = velocity + (now - predicted[:3]) / duration
        arrival: FloatArray = predicted[3:] + (now - predicted[:3]) / duration
        return arrival

    def _predict_differences(
        self, measured: _Measured
    ) -> tuple[FloatArray, npt.NDArray[np.intp], Geometry]:
        """Return range differences without receiver clocks (m), their columns, and the geometry.

        The directions of the geometry are in ITRF.
        """
        assert self._filter is not None
        chief = state_gcrf_to_itrf(measured.time, self._chief.mean[:6])
        mean = self._filter.x
        deputy = chief + mean[list(MOTION)]
        clock = self._chief.clock
        clocks = np.array([clock, clock + mean[CLOCK] / SPEED_OF_LIGHT])
        states = np.array([chief, deputy])
        offsets = measured.tag_offsets - clocks
        seen = compute_geometry(measured.table, measured.time, offsets, states, np.eye(3))
        columns = seen.columns(measured.differences.satellite)
        distance = (seen.range - seen.clock)[:, columns]
        return distance[1] - distance[0], columns, seen

    def _update(self, measured: _Measured) -> None:
        """Update with the phases that have integers, then set the integers of the others."""
        filter_, differences = self._filter, measured.differences
        assert filter_ is not None
        predicted, columns, seen = self._predict_differences(measured)
        jump = float(np.median(differences.code - predicted)) - float(filter_.x[CLOCK])
        if max(abs(jump), float(np.sqrt(filter_.P[CLOCK, CLOCK]))) > _CLOCK_JUMP:
            filter_.release_clock(jump, self.configuration.clock_sigma)
            predicted, columns, seen = self._predict_differences(measured)
        mask = np.radians(self.configuration.elevation_mask_deg)
        is_high = (seen.elevation[:, columns] > mask).all(axis=0)
        has_integer = np.array([key in self._arcs for key in differences.keys])
        if not (is_high & has_integer).any():
            self._set_first_integers(measured, np.flatnonzero(is_high), predicted)
            has_integer = is_high
        rows = np.flatnonzero(is_high & has_integer)
        if len(rows):
            cycles = np.array(
                [self._arcs[differences.keys[row]].offset_cycles for row in rows.tolist()]
            )
            ranges = differences.phase[rows] - differences.wavelength[rows] * cycles
            filter_.update_phases(
                ranges - predicted[rows] - filter_.x[CLOCK],
                -seen.direction[1, columns[rows]],
                differences.phase_variance[rows],
            )
            self._last_update = measured.time
        new = np.flatnonzero(is_high & ~has_integer)
        if len(new):
            predicted, _, _ = self._predict_differences(measured)
            self._set_integers(measured, new, predicted)
        self._arcs.record(measured.time, differences)

    def _set_first_integers(
        self, measured: _Measured, rows: npt.NDArray[np.intp], predicted: FloatArray
    ) -> None:
        """Give the fraction that all phases share to the clock, then set all integers.

        Receivers start their phases with any fraction of a cycle, and the first clock comes from
        the codes. The fraction is the same for all satellites; it is averaged on the circle.
        """
        assert self._filter is not None
        if len(rows):
            wavelength = measured.differences.wavelength[rows]
            residual = measured.differences.phase[rows] - predicted[rows] - self._filter.x[CLOCK]
            mean = np.exp(2j * np.pi * residual / wavelength).mean()
            self._filter.x[CLOCK] += float(np.angle(mean)) / (2.0 * np.pi) * wavelength.mean()
            self._set_integers(measured, rows, predicted)

    def _set_integers(
        self, measured: _Measured, rows: npt.NDArray[np.intp], predicted: FloatArray
    ) -> None:
        """Set the integers of rows to the rounded ambiguities of the state."""
        assert self._filter is not None
        expected = predicted + self._filter.x[CLOCK]
        for row in rows.tolist():
            arc = self._arcs.start(measured.time, measured.differences, row, float(expected[row]))
            arc.fixed_since = measured.time

    def _solution(self, measured: _Measured | None, age: float) -> RelativeSolution:
        """Return the solution of an epoch."""
        filter_, time = self._filter, self._time
        assert filter_ is not None and time is not None
        chief, motion = self._chief.mean[:6].copy(), list(MOTION)
        to_gcrf = np.array([state_itrf_to_gcrf(time, column) for column in np.eye(6)]).T
        covariance = to_gcrf @ filter_.P[np.ix_(motion, motion)] @ to_gcrf.T
        relative = to_gcrf @ filter_.x[motion]
        state, covariance = relative_rtn(chief, relative, self._chief.covariance, covariance)
        is_updated = age == 0.0
        squared, count = filter_.innovation if is_updated else (0.0, 0)
        return RelativeSolution(
            time=time,
            solution=SOLUTION_FLOAT if is_updated else SOLUTION_PREDICTED,
            position_rtn=state[:3],
            velocity_rtn=state[3:],
            covariance_rtn=covariance,
            position_itrf=filter_.x[POSITION].copy(),
            covariance_position_itrf=filter_.P[:3, :3].copy(),
            position_chief_gcrf=chief[:3],
            velocity_chief_gcrf=chief[3:],
            covariance_chief_gcrf=self._chief.covariance.copy(),
            satellites_used=count,
            innovation_rms=float(np.sqrt(squared / max(count, 1))),
            normalised_innovation_squared=squared,
            innovation_count=count,
            age=age,
            ambiguities=self._ambiguity_table(measured),
            clock_difference=float(filter_.x[CLOCK]) / SPEED_OF_LIGHT,
            degraded=() if is_updated else (f"no common satellite for {age:.0f} s",),
        )

    def _ambiguity_table(self, measured: _Measured | None) -> AmbiguityTable:
        """Return the integers of the signals in view, as float because no test was made of them."""
        keys = [] if measured is None else measured.differences.keys
        arcs = [self._arcs[key] for key in keys if key in self._arcs]
        columns = np.array([arc.key for arc in arcs], dtype=np.uint8).reshape(-1, 4)
        return AmbiguityTable(
            system=columns[:, 0],
            prn=columns[:, 1],
            band=columns[:, 2],
            attribute=columns[:, 3],
            reference_prn=np.zeros(len(arcs), dtype=np.uint8),
            ambiguity_cycles=np.array([arc.offset_cycles for arc in arcs]),
            ambiguity_sigma_cycles=np.full(len(arcs), np.nan),
            state=np.full(len(arcs), AMBIGUITY_FLOAT, dtype=np.uint8),
            fixed_since=tuple(None for _ in arcs),
        )
