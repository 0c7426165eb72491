"""A simulated receiver: what it measures at its epochs, and what it computes from that."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss import constants as c
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.fix import Fix, ReceiverTime
from vtff_gnss.novatel.encode.frame import TIME_STATUS_FINE_STEERING
from vtff_gnss.novatel.encode.solution import IonosphereUtc
from vtff_gnss.novatel.header import TIME_STATUS_UNKNOWN
from vtff_gnss.orbits.line_of_sight import LineOfSight, earth_obstructs
from vtff_sim_bridge.atmosphere.slant_tec import group_delay
from vtff_sim_bridge.gnss.configuration import ReceiverConfiguration
from vtff_sim_bridge.gnss.faults import Fault
from vtff_sim_bridge.gnss.power_levels import PowerLevels
from vtff_sim_bridge.gnss.propagation import Ionosphere, RegionCrossing, ScintillatedLinks
from vtff_sim_bridge.gnss.random_streams import EPOCHS_PER_SECOND, Effect, receiver_number
from vtff_sim_bridge.gnss.receiver_clock import ReceiverClock
from vtff_sim_bridge.gnss.sky import Constellation, Sky, fnav_ephemeris
from vtff_sim_bridge.gnss.vehicle_track import VehicleTrack
from vtff_sim_bridge.receiver.measurements import Measurements
from vtff_sim_bridge.receiver.navigation_solution import navigation_solution
from vtff_sim_bridge.receiver.observables import (
    LinkPlan,
    MeasurementNoise,
    Multipath,
    all_links,
    link_rows,
    signals_of,
)
from vtff_sim_bridge.receiver.receiver_logs import EpochOfSeries
from vtff_sim_bridge.receiver.tracking import Arc, Tracker, Tracks
from vtff_sim_bridge.receiver.truth_file import TruthFile
from vtff_sim_bridge.receiver.truth_records import arc_record, second_record

__all__ = ["MeasurementEngine"]

# s; the frame of GPS. Galileo repeats its ephemeris as often in I/NAV, and every 50 s in F/NAV.
_EPHEMERIS_REPETITION = 30.0
_TAGS = np.arange(1 - EPOCHS_PER_SECOND, 1) / EPOCHS_PER_SECOND


class _Channels(NamedTuple):
    """Channels while the same satellites are visible."""

    plan: LinkPlan
    visible: bytes
    has_channel: npt.NDArray[np.bool_]
    number: npt.NDArray[np.uint8]


class MeasurementEngine:
    """One receiver on one vehicle; makes the outputs that an `ReceiverFirmware` logs.

    Parameters
    ----------
    configuration : ReceiverConfiguration
    constellation : Constellation
    ionosphere : Ionosphere
    power_levels : PowerLevels
        At its vehicle.
    faults : sequence of Fault
        Of this receiver.
    seed : int
        Of the run.
    start : GpsTime
        Start of the run: a whole second.
    truth : TruthFile

    Attributes
    ----------
    measurements : Measurements or None
        Those of the last `measure`.
    time_status : int
        Of the headers of all logs of their epochs.
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
        self._scintillated = ScintillatedLinks(np.array([k.signal.frequency for k in links]))
        self._last_extra = np.full(len(links), np.nan)
        self._sky: Sky | None = None
        self._sky_second = -1
        self._plan: LinkPlan | None = None
        self._visible: _Channels | None = None
        self._ephemerides: tuple[BroadcastEphemeris, ...] = ()
        self._received: dict[tuple[int, int, int], tuple[BroadcastEphemeris, ...]] = {}
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
            Which of the 20, later than all before. The motion at the others does not matter.
        track : VehicleTrack

        Notes
        -----
        Whatever part is asked for, the geometry of the whole second is computed; so an epoch is
        the same to the last bit however a run is cut into calls.
        """
        time = self._start + second
        is_up = self._knows_time(second)
        self.time_status = TIME_STATUS_FINE_STEERING if is_up else TIME_STATUS_UNKNOWN
        offset, drift = self._clock.second(second)
        position, velocity = _at_reception(track, offset)
        sky, plan = self._refreshed(second, position[emitted][0])
        seen = sky.lines_of_sight(time, _TAGS - offset, position, velocity)
        elapsed = second + _TAGS
        stec_tecu = self._ionosphere.slant_tec_tecu(seen, position)
        crossings = self._ionosphere.crossings(seen, position, time, elapsed, plan.stream)
        s4_l1 = np.zeros(seen.range.shape)
        for crossing in crossings:
            s4_l1 = np.maximum(s4_l1, crossing.s4_l1)

        cn0_dbhz = plan.cn0_dbhz(seen, self.configuration, track.boresight_itrf)
        power = self._power_levels.offsets_db(second, emitted, plan.satellites)
        if power is not None:
            cn0_dbhz = cn0_dbhz + power[:, plan.satellite]
        delay = group_delay(stec_tecu[:, plan.satellite], plan.frequency)
        # The ionosphere delays the code by as much as it advances the phase; scintillation moves
        # the phase only.
        extra = -delay
        scintillation = self._scintillation(crossings, plan, emitted)
        if scintillation is not None:
            amplitude, phase = scintillation
            cn0_dbhz = cn0_dbhz + 20.0 * np.log10(np.maximum(amplitude, 1e-3))
            # The argument of the gain is added to the phase that the receiver measures, which
            # falls when the range grows: the range of the phase shrinks.
            extra = extra - plan.wavelength / (2.0 * math.pi) * phase

        first_epoch = (second - 1) * EPOCHS_PER_SECOND + 1 + range(EPOCHS_PER_SECOND)[emitted][0]
        seen = _selected(seen, emitted)
        position, velocity, offset, drift, elapsed, stec_tecu, s4_l1, cn0_dbhz, delay, extra = (
            part[emitted]
            for part in (
                *(position, velocity, offset, drift, elapsed),
                *(stec_tecu, s4_l1, cn0_dbhz, delay, extra),
            )
        )
        has_channel, channel = self._channels(plan, seen, position)
        strong = cn0_dbhz > self.configuration.tracking.threshold_dbhz
        if not is_up:
            has_channel = np.zeros_like(has_channel)
        tracks = self._tracker.advance(
            first_epoch, plan.row, has_channel[:, plan.satellite] & strong
        )
        measured = self._observables(
            *(second, emitted, plan, seen, offset, drift, elapsed),
            *(cn0_dbhz, delay, extra, tracks),
        )
        self.measurements = Measurements(
            start=self._start,
            time_status=self.time_status,
            first_epoch=first_epoch,
            plan=plan,
            line_of_sight=seen,
            position_itrf=position,
            velocity_itrf=velocity,
            clock_offset=offset,
            clock_drift=drift,
            slant_tec_tecu=stec_tecu,
            s4_l1=s4_l1,
            tracks=tracks,
            channel=channel,
            **measured,
        )
        if (first_epoch + len(offset) - 1) % EPOCHS_PER_SECOND == 0:
            self._receive_ephemerides(time)
            self._write_truth(second)
        return self.measurements

    def _knows_time(self, second: int) -> bool:
        """Return whether the search after a cold start is over in a second."""
        duration = self.configuration.tracking.cold_start_duration
        return second > duration or duration == 0.0

    def _refreshed(self, second: int, position: FloatArray) -> tuple[Sky, LinkPlan]:
        """Return satellites and links of a second, chosen when its first epoch is measured."""
        if self._sky is not None and self._plan is not None and second == self._sky_second:
            return self._sky, self._plan
        self._sky_second = second
        mask = math.radians(self.configuration.tracking.elevation_mask_deg)
        time = self._start + second
        sky = Sky.refreshed(self._sky, self._constellation, time, position, mask)
        if sky is not self._sky or self._plan is None:
            self._plan = LinkPlan.of_sky(
                sky, self._constellation, self._links, self._rows_of, self.configuration
            )
        self._sky = sky
        return sky, self._plan

    def _scintillation(
        self, crossings: Sequence[RegionCrossing], plan: LinkPlan, emitted: slice
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return amplitude and phase; None where there is nothing and was nothing."""
        if crossings:
            return self._scintillated.second(crossings, plan.satellite, plan.row, emitted)
        self._scintillated.calm()
        phase = self._scintillated.settled_phase[plan.row]
        if not phase.any():
            return None
        shape = (EPOCHS_PER_SECOND, len(phase))
        return np.ones(shape), np.broadcast_to(phase, shape).copy()

    def _channels(
        self, plan: LinkPlan, seen: LineOfSight, position: FloatArray
    ) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.uint8]]:
        """Return which satellites have a channel, and its number, shape (k, n)."""
        mask = math.radians(self.configuration.tracking.elevation_mask_deg)
        visible = seen.elevation > mask
        if mask < 0.0:
            visible &= ~earth_obstructs(position[:, None], seen.position_satellite_itrf)
        epochs = []
        for index, row in enumerate(visible):
            key = row.tobytes()
            last = self._visible
            if last is None or last.plan is not plan or last.visible != key:
                has_channel = self._tracker.with_channel(
                    plan.satellites, seen.elevation[index], row
                )
                number = self._tracker.channels(plan.satellites)
                self._visible = last = _Channels(plan, key, has_channel, number)
            epochs.append(last)
        return (
            np.array([epoch.has_channel for epoch in epochs]),
            np.array([epoch.number for epoch in epochs]),
        )

    def _observables(
        self,
        second: int,
        emitted: slice,
        plan: LinkPlan,
        seen: LineOfSight,
        offset: FloatArray,
        drift: FloatArray,
        elapsed: FloatArray,
        cn0_dbhz: FloatArray,
        delay: FloatArray,
        extra: FloatArray,
        tracks: Tracks,
    ) -> dict[str, Any]:
        """Return pseudorange, phase, Doppler, C/N0 and sigmas.

        `delay` and `extra` are what the code and carrier ranges are longer by than the geometric.
        """
        satellite = plan.satellite
        clocks = SPEED_OF_LIGHT * (offset[:, None] - seen.clock_offset_satellite)
        ranges = seen.range + clocks
        error = plan.range_error(seen)
        if error is not None:
            ranges = ranges + error
        ranges = ranges[:, satellite]
        pseudorange = ranges + delay + plan.code_bias
        carrier = ranges + extra
        if self._multipath.is_on:
            code, phase = self._multipath.errors(elapsed, seen.elevation[:, satellite], plan.row)
            pseudorange = pseudorange + code
            carrier = carrier + phase
        rate = self._carrier_rate(plan, seen, drift, extra)
        sigmas = self._noise.sigmas(cn0_dbhz, plan.wavelength, plan.chip_length)
        if self._noise.is_on:
            draw = self._noise.drawn
            arguments = (second, plan.row, emitted)
            pseudorange = pseudorange + sigmas.code * draw(Effect.CODE_NOISE, *arguments)
            carrier = carrier + sigmas.phase * draw(Effect.PHASE_NOISE, *arguments)
            rate = rate + sigmas.doppler * draw(Effect.DOPPLER_NOISE, *arguments)
            cn0_dbhz = self._noise.noisy_cn0_dbhz(cn0_dbhz, draw(Effect.CN0_NOISE, *arguments))
        return {
            "pseudorange": pseudorange,
            "carrier_phase_cycles": carrier / plan.wavelength + tracks.cycles,
            "doppler_hz": -rate / plan.wavelength,
            "cn0_dbhz": cn0_dbhz,
            "sigmas": sigmas,
        }

    def _carrier_rate(
        self,
        plan: LinkPlan,
        seen: LineOfSight,
        drift: FloatArray,
        extra: FloatArray,
    ) -> FloatArray:
        """Return the derivative of the carrier range by receiver time, m/s, shape (k, m)."""
        to_receiver_time = 1.0 - drift[:, None]
        satellite_drift = seen.clock_drift_satellite * (1.0 - seen.range_rate / SPEED_OF_LIGHT)
        rate = (seen.range_rate - SPEED_OF_LIGHT * satellite_drift) * to_receiver_time
        rate = rate + SPEED_OF_LIGHT * drift[:, None]
        before = np.concatenate((self._last_extra[plan.row][None, :], extra[:-1]))
        change = (extra - before) * EPOCHS_PER_SECOND
        self._last_extra[:] = np.nan
        self._last_extra[plan.row] = extra[-1]
        return np.asarray(rate[:, plan.satellite] + np.where(np.isnan(change), 0.0, change))

    # What an ReceiverFirmware asks for

    def _index(self, time: GpsTime) -> int:
        """Return the place of an epoch in the last measurements."""
        measured = self._last()
        since = (time.nanoseconds - self._start.nanoseconds) * EPOCHS_PER_SECOND
        index = since // 1_000_000_000 - measured.first_epoch
        if not 0 <= index < len(measured.clock_offset):
            raise ValueError(f"time: {time} was not measured last")
        return index

    def _last(self) -> Measurements:
        if self.measurements is None:
            raise ValueError("nothing was measured yet")
        return self.measurements

    def observations(self, time: GpsTime) -> EpochOfSeries:
        """Return the observations of an epoch of the last `measure`."""
        return EpochOfSeries(self._last().series, self._index(time))

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
        return self._solved(time)[0]

    def receiver_time(self, time: GpsTime) -> ReceiverTime:
        """Return the clock of the solution of an epoch of the last `measure`."""
        return self._solved(time)[1]

    def _receive_ephemerides(self, time: GpsTime) -> None:
        measured = self._last()
        plan, tracks = measured.plan, measured.tracks
        old_enough = tracks.is_tracked[-1] & (
            tracks.lock_time[-1] >= self.configuration.tracking.ephemeris_delay
        )
        has_new = False
        is_repeated = time.time_of_week % _EPHEMERIS_REPETITION == 0.0
        for column in np.flatnonzero(np.bincount(plan.satellite[old_enough])).tolist():
            source = plan.ephemerides[column]
            key = (source.system, source.prn, source.source)
            known = self._received.get(key)
            if known is None or known[0] is not source or is_repeated:
                has_new = True
                sets = [replace(source, time=time)]
                if source.system == c.SYSTEM_GALILEO:
                    sets.append(fnav_ephemeris(sets[0]))
                self._received[key] = (source, *sets)
        if has_new:
            self._ephemerides = tuple(
                e for _, sets in sorted(self._received.items()) for e in sets[1:]
            )

    # Solution

    def _solved(self, time: GpsTime) -> tuple[Fix, ReceiverTime]:
        index = self._index(time)
        epoch = self._last().first_epoch + index
        if self._solution is None or self._solution[0] != epoch:
            received = {key[:2] for key in self._received}
            self._solution = (epoch, *navigation_solution(self._last(), index, time, received))
        return self._solution[1:]

    # Truth

    def _report_arc(self, arc: Arc) -> None:
        if self._truth.is_wanted:
            self._truth.write("arc", receiver=self.configuration.name, **arc_record(arc))

    def _write_truth(self, second: int) -> None:
        if self._truth.is_wanted:
            record = second_record(self._last(), second)
            self._truth.write("second", receiver=self.configuration.name, **record)


def _at_reception(track: VehicleTrack, offset: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return position and velocity at the true times of reception, shape (20, 3)."""
    late = -offset[:, None]
    position = track.position_itrf + late * (
        track.velocity_itrf + 0.5 * late * track.acceleration_itrf
    )
    return position, track.velocity_itrf + late * track.acceleration_itrf


def _selected(seen: LineOfSight, emitted: slice) -> LineOfSight:
    """Return the geometry of some of the epochs."""
    return LineOfSight(**{name: part[emitted] for name, part in vars(seen).items()})
