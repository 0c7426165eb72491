"""A simulated receiver: what it measures at its epochs, and what it computes from that."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss import constants as c
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.fix import Fix, ReceiverTime
from vtff_gnss.novatel.encode.frame import TIME_STATUS_FINE_STEERING
from vtff_gnss.novatel.encode.solution import IonosphereUtc
from vtff_gnss.novatel.header import TIME_STATUS_UNKNOWN
from vtff_gnss.orbits.line_of_sight import LineOfSight, earth_obstructs, lines_of_sight
from vtff_sim_bridge.gnss.configuration import ReceiverConfiguration
from vtff_sim_bridge.gnss.faults import Fault
from vtff_sim_bridge.gnss.link_plan import (
    LinkPlan,
    all_links,
    link_addresses,
    link_rows,
    signals_of,
)
from vtff_sim_bridge.gnss.power_levels import PowerLevels
from vtff_sim_bridge.gnss.propagation import Ionosphere, RegionCrossing, ScintillatedLinks
from vtff_sim_bridge.gnss.receiver_clock import ReceiverClock
from vtff_sim_bridge.gnss.sky import Constellation, Sky, fnav_ephemeris
from vtff_sim_bridge.gnss.vehicle_track import VehicleTrack
from vtff_sim_bridge.noise.cycle_slips import NoiseSlips, slip_rate
from vtff_sim_bridge.noise.random_streams import EPOCHS_PER_SECOND, receiver_number
from vtff_sim_bridge.receiver.arriving_signals import ArrivingSignals
from vtff_sim_bridge.receiver.measurements import Measurements
from vtff_sim_bridge.receiver.navigation_solution import NavigationSolver
from vtff_sim_bridge.receiver.observables import (
    LineBiasDrift,
    MeasurementNoise,
    Multipath,
    Observables,
    observe,
)
from vtff_sim_bridge.receiver.receiver_logs import EpochOfSeries
from vtff_sim_bridge.receiver.tracking import Arc, Tracker, Tracks
from vtff_sim_bridge.receiver.truth_file import TruthFile
from vtff_sim_bridge.receiver.truth_records import arc_record, second_record
from vtff_sim_bridge.receiver.wind_up import WindUp

__all__ = ["MeasurementEngine"]

# s; the frame of GPS. Galileo repeats its ephemeris as often in I/NAV, and every 50 s in F/NAV.
_EPHEMERIS_REPETITION = 30.0
_NO_TERMS = np.empty((0, 0, 0))
_TAGS = np.arange(1 - EPOCHS_PER_SECOND, 1) / EPOCHS_PER_SECOND


class _Channels(NamedTuple):
    """Channels of links, shape (k, m), while the same satellites are visible."""

    plan: LinkPlan
    visible: bytes
    has_channel: npt.NDArray[np.bool_]
    number: npt.NDArray[np.uint8]


class MeasurementEngine:
    """Tracks signals, measures and solves for position: the outputs that a `ReceiverFirmware` logs.

    Parameters
    ----------
    configuration : ReceiverConfiguration
    constellation : Constellation
    ionosphere : Ionosphere
    power_levels : PowerLevels
        Levels at the vehicle of the receiver.
    faults : sequence of Fault
        Faults of this receiver.
    seed : int
        Seed of the run.
    start : GpsTime
        Start of the run: a whole second.
    truth : TruthFile

    Attributes
    ----------
    measurements : Measurements or None
        Measurements of the last `measure`.
    time_status : int
        Quality of the time in the headers of the logs of these epochs.
    """

    def __init__(
        self,
        configuration: ReceiverConfiguration,
        constellation: Constellation,
        ionosphere: Ionosphere,
        power_levels: PowerLevels,
        faults: Sequence[Fault],
        seed: int,
        start: GpsTime,
        truth: TruthFile,
    ) -> None:
        number = receiver_number(configuration.name)
        links = all_links(signals_of(configuration))
        jumps = [(f.first_epoch, f.seconds) for f in faults if f.kind == "clock_jump"]
        self.configuration = configuration
        self._number = number
        self._constellation = constellation
        self._ionosphere = ionosphere
        self._power_levels = power_levels
        self._start = start
        self._truth = truth
        self._links = links
        self._rows_of = link_rows(links)
        self._clock = ReceiverClock(configuration.clock, seed, number, jumps)
        self._tracker = Tracker(
            links, configuration.tracking, faults, seed, number, self._report_arc
        )
        self._noise = MeasurementNoise(configuration.noise, links, seed, number)
        self._multipath = Multipath(configuration, links, seed, number)
        self._line_bias_drift = LineBiasDrift(configuration, links, seed, number)
        self._slips = NoiseSlips(seed, link_addresses(links, number))
        self._last_acceleration: FloatArray | None = None
        self._wind_up = WindUp()
        self._scintillated = ScintillatedLinks(np.array([k.signal.frequency for k in links]))
        self._last_phase_delay = np.full(len(links), np.nan)
        self._sky: Sky | None = None
        self._sky_second = -1
        self._plan: LinkPlan | None = None
        self._channels: _Channels | None = None
        self._ephemerides: tuple[BroadcastEphemeris, ...] = ()
        self._heard: tuple[LinkPlan, bytes] | None = None
        self._received: dict[tuple[int, int, int], tuple[BroadcastEphemeris, ...]] = {}
        self._received_satellites: frozenset[tuple[int, int]] = frozenset()
        self._solver = NavigationSolver()
        self._ionosphere_utc: tuple[IonosphereUtc, ...] = ()
        self._solution: tuple[int, Fix, ReceiverTime] | None = None
        self.measurements: Measurements | None = None
        self.time_status = TIME_STATUS_UNKNOWN

    # Measuring

    def measure(self, second: int, emitted: slice, track: VehicleTrack) -> Measurements:
        """Measure at epochs of a second.

        Parameters
        ----------
        second : int
            Number of the second: its epochs are those after ``second - 1`` s up to and including
            ``second`` s into the run; not before that of the last call.
        emitted : slice
            Which of the 20 epochs are measured: later ones than in all calls before. The motion
            at the others does not matter.
        track : VehicleTrack

        Notes
        -----
        The geometry of the whole second is computed for any choice of epochs, so that an epoch is
        the same to the last bit however a run is cut into calls.
        """
        is_up = self._knows_time(second)
        self.time_status = TIME_STATUS_FINE_STEERING if is_up else TIME_STATUS_UNKNOWN
        signals = self._receive_signals(second, emitted, track).at(emitted)
        plan = signals.plan
        first_epoch = (second - 1) * EPOCHS_PER_SECOND + 1 + range(EPOCHS_PER_SECOND)[emitted][0]
        channels = self._assign_channels(signals)
        can_track = signals.cn0_dbhz > self.configuration.tracking.threshold_dbhz
        can_track &= channels.has_channel if is_up else False
        tracks = self._tracker.advance(
            first_epoch, plan.row, can_track, self._draw_slips(second, emitted, signals)
        )
        self.measurements = Measurements(
            start=self._start,
            time_status=self.time_status,
            first_epoch=first_epoch,
            signals=signals,
            tracks=tracks,
            observables=self._measure_observables(second, emitted, signals, tracks),
            channel=channels.number,
        )
        if (first_epoch + signals.epoch_count - 1) % EPOCHS_PER_SECOND == 0:
            self._receive_ephemerides(self._start + second)
            self._write_truth(second)
        return self.measurements

    def _receive_signals(self, second: int, emitted: slice, track: VehicleTrack) -> ArrivingSignals:
        """Return the signals at all 20 epochs of a second; true only at the `emitted` ones."""
        time = self._start + second
        offset, drift = self._clock.second(second)
        position, velocity = track.before(offset)
        sky, plan = self._refresh_sky(second, position[emitted][0])
        line_of_sight = lines_of_sight(sky.table, time, _TAGS - offset, position, velocity)
        elapsed = second + _TAGS
        stec_tecu = self._ionosphere.slant_tec_tecu(line_of_sight, position, elapsed)
        crossings = self._ionosphere.crossings(
            line_of_sight, position, time, elapsed, plan.stream, self._number
        )
        s4_l1 = np.zeros(line_of_sight.range.shape)
        for crossing in crossings:
            s4_l1 = np.maximum(s4_l1, crossing.s4_l1)

        cn0_dbhz, code_delay, phase_delay = plan.levels_and_delays(
            line_of_sight, stec_tecu, self.configuration, track.boresight_itrf
        )
        power = self._power_levels.offsets_db(second, emitted, plan.satellites)
        if power is not None:
            cn0_dbhz = cn0_dbhz + power[:, plan.satellite]
        phase_centre, body_axes = self.configuration.phase_centre, track.body_axes_itrf
        antenna_delay = None
        if phase_centre is not None and body_axes is not None:
            antenna_delay = plan.antenna_delay(line_of_sight, body_axes, phase_centre)
        # Wind-up and scintillation move the phase only.
        wind_up = None
        if self.configuration.has_wind_up and body_axes is not None:
            wind_up = self._wind_up.second(line_of_sight, body_axes, plan.satellites, emitted)
            phase_delay = phase_delay + plan.wavelength * wind_up[:, plan.satellite]
        scintillation = self._scintillation(crossings, plan, emitted)
        if scintillation is not None:
            amplitude, phase = scintillation
            cn0_dbhz = cn0_dbhz + 20.0 * np.log10(np.maximum(amplitude, 1e-3))
            # The argument of the gain is added to the phase that the receiver measures, which
            # falls when the range grows: the range of the phase shrinks.
            phase_delay = phase_delay - plan.wavelength / (2.0 * math.pi) * phase
        return ArrivingSignals(
            plan=plan,
            line_of_sight=line_of_sight,
            position_itrf=position,
            velocity_itrf=velocity,
            clock_offset=offset,
            clock_drift=drift,
            elapsed=elapsed,
            slant_tec_tecu=stec_tecu,
            s4_l1=s4_l1,
            cn0_dbhz=cn0_dbhz,
            code_delay=code_delay,
            phase_delay=phase_delay,
            jerk=self._jerk(line_of_sight, track, emitted),
            wind_up=wind_up,
            antenna_delay=antenna_delay,
        )

    def _jerk(self, line_of_sight: LineOfSight, track: VehicleTrack, emitted: slice) -> FloatArray:
        """Return the third derivative of ranges by the receiver's motion, m/s3, shape (20, n).

        Only where loops slip by it. The acceleration of a command holds from its epoch on: where a
        thruster is switched, its step counts as jerk of one epoch.
        """
        jerk = np.zeros(line_of_sight.range.shape)
        if not self.configuration.tracking.has_noise_slips:
            return jerk
        acceleration = track.acceleration_itrf
        before = np.concatenate((acceleration[:1], acceleration[:-1]))
        first = range(len(acceleration))[emitted][0]
        if self._last_acceleration is not None:
            before[first] = self._last_acceleration
        self._last_acceleration = acceleration[emitted][-1]
        change = (acceleration - before) * EPOCHS_PER_SECOND
        return np.asarray(-np.einsum("ki,kni->kn", change, line_of_sight.direction_itrf))

    def _draw_slips(
        self, second: int, emitted: slice, signals: ArrivingSignals
    ) -> FloatArray | None:
        """Return by how many cycles the loops slip, shape (k, m); None where they never do."""
        if not self.configuration.tracking.has_noise_slips:
            return None
        plan, noise = signals.plan, self.configuration.noise
        rate = slip_rate(
            signals.cn0_dbhz,
            signals.jerk[:, plan.satellite],
            plan.frequency,
            plan.has_data,
            noise.phase_loop_bandwidth_hz,
            noise.integration_time,
        )
        return self._slips.drawn(second, emitted, plan.row, rate, plan.has_data)

    def _knows_time(self, second: int) -> bool:
        """Return whether the search after a cold start is over in a second."""
        duration = self.configuration.tracking.cold_start_duration
        return second > duration or duration == 0.0

    def _refresh_sky(self, second: int, position: FloatArray) -> tuple[Sky, LinkPlan]:
        """Return satellites and links of a second, chosen when its first epoch is measured."""
        if self._sky is not None and self._plan is not None and second == self._sky_second:
            return self._sky, self._plan
        self._sky_second = second
        mask = math.radians(self.configuration.tracking.elevation_mask_deg)
        time = self._start + second
        sky = Sky.refresh(self._sky, self._constellation, time, position, mask)
        if sky is not self._sky or self._plan is None:
            self._plan = LinkPlan.of_sky(
                sky, self._constellation, self._links, self._rows_of, self.configuration
            )
        self._sky = sky
        return sky, self._plan

    def _scintillation(
        self, crossings: Sequence[RegionCrossing], plan: LinkPlan, emitted: slice
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return amplitude and phase of the links; None if no link was ever scintillated."""
        if crossings:
            return self._scintillated.second(crossings, plan.satellite, plan.row, emitted)
        self._scintillated.calm()
        if not self._scintillated.has_slipped:
            return None
        phase = self._scintillated.settled_phase[plan.row]
        if not phase.any():
            return None
        shape = (EPOCHS_PER_SECOND, len(phase))
        return np.ones(shape), np.broadcast_to(phase, shape).copy()

    def _assign_channels(self, signals: ArrivingSignals) -> _Channels:
        """Return which links have a channel, and its number."""
        plan, line_of_sight = signals.plan, signals.line_of_sight
        mask = math.radians(self.configuration.tracking.elevation_mask_deg)
        visible = line_of_sight.elevation > mask
        if mask < 0.0:
            visible &= ~earth_obstructs(
                signals.position_itrf[:, None], line_of_sight.position_satellite_itrf
            )
        key, last = visible.tobytes(), self._channels
        if last is not None and last.plan is plan and key == last.visible:
            return last
        has_channel = np.empty(visible.shape, dtype=bool)
        number = np.empty(visible.shape, dtype=np.uint8)
        for index, row in enumerate(visible):
            if index and (row == visible[index - 1]).all():
                has_channel[index], number[index] = has_channel[index - 1], number[index - 1]
                continue
            has_channel[index] = self._tracker.with_channel(
                plan.satellites, line_of_sight.elevation[index], row
            )
            number[index] = self._tracker.channels(plan.satellites)
        channels = _Channels(
            plan,
            key,
            np.take(has_channel, plan.satellite, axis=1),
            np.take(number, plan.satellite, axis=1),
        )
        # The next second has the same ones if nothing changed within this one.
        self._channels = channels if (visible == visible[0]).all() else None
        return channels

    def _measure_observables(
        self, second: int, emitted: slice, signals: ArrivingSignals, tracks: Tracks
    ) -> Observables:
        """Return what the receiver measures of its signals."""
        plan, rays = signals.plan, signals.line_of_sight
        range_terms: list[FloatArray] = []
        code_terms: list[FloatArray] = []
        phase_terms: list[FloatArray] = []
        range_error = None
        if self._constellation.has_errors:
            orbit_errors = self._constellation.orbit_errors(plan.satellites, signals.elapsed)
            range_error = plan.range_error(rays, orbit_errors)
            range_terms.append(range_error)
        if signals.antenna_delay is not None:
            code_terms.append(signals.antenna_delay)
            phase_terms.append(signals.antenna_delay)
        multipath = None
        if self._multipath.is_on:
            multipath = self._multipath.errors(
                second,
                emitted,
                rays.elevation[:, plan.satellite],
                plan.cn0_zenith_dbhz - signals.cn0_dbhz,
                plan.row,
            )
            code_terms.append(multipath[0])
            phase_terms.append(multipath[1])
        if self._line_bias_drift.is_on:
            code_bias, phase_bias = self._line_bias_drift.errors(second, emitted, plan.row)
            code_terms.append(code_bias)
            phase_terms.append(phase_bias)
        sigmas = self._noise.sigmas(signals.cn0_dbhz, plan.wavelength, plan.chip_length)
        pseudorange, carrier_phase_cycles, doppler_hz, cn0_dbhz = observe(
            signals.clock_offset,
            signals.clock_drift,
            rays.range,
            rays.range_rate,
            rays.clock_offset_satellite,
            rays.clock_drift_satellite,
            plan.satellite,
            plan.row,
            plan.code_bias,
            plan.wavelength,
            _stack(range_terms),
            _stack(code_terms),
            _stack(phase_terms),
            signals.code_delay,
            signals.phase_delay,
            self._last_phase_delay,
            tracks.cycles,
            signals.cn0_dbhz,
            sigmas.code,
            sigmas.phase,
            sigmas.doppler,
            *self._noise.of_all_links(second, plan.row),
            range(EPOCHS_PER_SECOND)[emitted][0],
            10.0,
        )
        return Observables(
            pseudorange=pseudorange,
            carrier_phase_cycles=carrier_phase_cycles,
            doppler_hz=doppler_hz,
            cn0_dbhz=cn0_dbhz,
            sigmas=self._noise.stated(sigmas),
            multipath=multipath,
            range_error=range_error,
        )

    # What an ReceiverFirmware asks for

    def _index(self, time: GpsTime) -> int:
        """Return the index of an epoch in the last measurements."""
        measured = self._last_measurements()
        since = (time.nanoseconds - self._start.nanoseconds) * EPOCHS_PER_SECOND
        index = since // NANOSECONDS_PER_SECOND - measured.first_epoch
        if not 0 <= index < measured.signals.epoch_count:
            raise ValueError(f"time: {time} was not measured last")
        return index

    def _last_measurements(self) -> Measurements:
        if self.measurements is None:
            raise ValueError("nothing was measured yet")
        return self.measurements

    def observations(self, time: GpsTime) -> EpochOfSeries:
        """Return the observations of an epoch of the last `measure`."""
        return EpochOfSeries(self._last_measurements().series, self._index(time))

    def ephemerides(self, time: GpsTime) -> tuple[BroadcastEphemeris, ...]:
        """Return the ephemerides received so far; the same object while none is received."""
        return self._ephemerides

    def ionosphere_utc(self, time: GpsTime) -> tuple[IonosphereUtc, ...]:
        """Return the broadcast ionosphere model and UTC parameters."""
        if not self._ionosphere_utc:
            model = self._constellation.klobuchar
            coefficients = () if model is None else (model.alpha, model.beta)
            self._ionosphere_utc = (IonosphereUtc.at(self._start, *coefficients),)
        return self._ionosphere_utc

    def fix(self, time: GpsTime) -> Fix:
        """Return the least-squares solution of an epoch of the last `measure`."""
        return self._solve(time)[0]

    def receiver_time(self, time: GpsTime) -> ReceiverTime:
        """Return the clock of the solution of an epoch of the last `measure`."""
        return self._solve(time)[1]

    def _receive_ephemerides(self, time: GpsTime) -> None:
        measured = self._last_measurements()
        plan, tracks = measured.signals.plan, measured.tracks
        old_enough = tracks.is_tracked[-1] & (
            tracks.lock_time[-1] >= self.configuration.tracking.ephemeris_delay
        )
        is_repeated = time.time_of_week % _EPHEMERIS_REPETITION == 0.0
        heard = (plan, old_enough.tobytes())
        if heard == self._heard and not is_repeated:
            return
        self._heard = heard
        has_new = False
        for column in np.flatnonzero(np.bincount(plan.satellite[old_enough])).tolist():
            source = plan.ephemerides[column]
            key = (source.system, source.prn, source.source)
            received = self._received.get(key)
            if received is None or received[0] is not source or is_repeated:
                has_new = True
                sets = [replace(source, time=time)]
                if source.system == c.SYSTEM_GALILEO:
                    sets.append(fnav_ephemeris(sets[0]))
                self._received[key] = (source, *sets)
        if has_new:
            self._received_satellites = frozenset(key[:2] for key in self._received)
            self._ephemerides = tuple(
                e for _, sets in sorted(self._received.items()) for e in sets[1:]
            )

    # Solution

    def _solve(self, time: GpsTime) -> tuple[Fix, ReceiverTime]:
        index = self._index(time)
        epoch = self._last_measurements().first_epoch + index
        if self._solution is None or self._solution[0] != epoch:
            measured = self._last_measurements()
            self._solution = (
                epoch,
                *self._solver.solve(measured, index, time, self._received_satellites),
            )
        return self._solution[1:]

    # Truth

    def _report_arc(self, arc: Arc) -> None:
        if self._truth.is_wanted:
            self._truth.write("arc", receiver=self.configuration.name, **arc_record(arc))

    def _write_truth(self, second: int) -> None:
        if self._truth.is_wanted:
            measured = self._last_measurements()
            self._truth.write(
                "second", receiver=self.configuration.name, **second_record(measured, second)
            )


def _stack(terms: Sequence[FloatArray]) -> FloatArray:
    """Return arrays (k, m) as one, (any, k, m)."""
    return np.stack(terms) if terms else _NO_TERMS
