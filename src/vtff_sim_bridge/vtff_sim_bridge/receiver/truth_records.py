"""Contents of the truth file's records."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import GRAVITATIONAL_PARAMETER_BROADCAST
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.signals import satellite_name
from vtff_sim_bridge.gnss.configuration import ReceiverConfiguration
from vtff_sim_bridge.gnss.link_plan import signals_of
from vtff_sim_bridge.gnss.signal_table import SIGNALS, Signal, clock_group_delay
from vtff_sim_bridge.gnss.sky import Constellation
from vtff_sim_bridge.noise.random_streams import EPOCHS_PER_SECOND
from vtff_sim_bridge.receiver.measurements import Measurements
from vtff_sim_bridge.receiver.tracking import Arc
from vtff_sim_bridge.receiver.truth_file import TruthFile

__all__ = ["SatelliteTruth", "arc_record", "receiver_record", "second_record"]


def receiver_record(receiver: ReceiverConfiguration) -> dict[str, Any]:
    """Return all settings of a receiver; ``biases`` (m) tells every signal that it tracks."""
    phase_centre = receiver.phase_centre
    settings = dataclasses.asdict(dataclasses.replace(receiver, phase_centre=None))
    record = {"receiver" if n == "name" else n: v for n, v in settings.items()}
    record["phase_centre"] = None if phase_centre is None else phase_centre.antenna
    record["biases"] = {s.name: receiver.biases.get(s.name, 0.0) for s in signals_of(receiver)}
    return record


def arc_record(arc: Arc) -> dict[str, Any]:
    """Return what an arc of a receiver begins with."""
    return {
        "time": arc.epoch / EPOCHS_PER_SECOND,
        "satellite": satellite_name(arc.link.system, arc.link.prn),
        "signal": arc.link.signal.name,
        "event": arc.event,
        "cycles": arc.cycles,
    }


def second_record(measured: Measurements, second: int) -> dict[str, Any]:
    """Return the state of a receiver and its signals at the last epoch of a second."""
    signals, columns = measured.signals, measured.tracked_satellites(-1)
    names = signals.plan.satellite_names
    record = {
        "time": second,
        "position_itrf": signals.position_itrf[-1].round(6).tolist(),
        "clock_offset": float(signals.clock_offset[-1]),
        "clock_drift": float(signals.clock_drift[-1]),
        "satellites": [names[column] for column in columns],
        "slant_tec_tecu": signals.slant_tec_tecu[-1, columns].round(6).tolist(),
        "s4_l1": signals.s4_l1[-1, columns].round(4).tolist(),
    }
    if measured.observables.range_error is not None:
        record["range_error"] = np.round(measured.observables.range_error[-1, columns], 6).tolist()
    if measured.observables.multipath is not None:
        record["multipath"] = _by_signal(measured, measured.observables.multipath)
    if signals.wind_up is not None:
        record["wind_up"] = np.round(signals.wind_up[-1, columns], 6).tolist()
    if signals.antenna_delay is not None:
        record["antenna_delay"] = _by_signal(measured, (signals.antenna_delay,))
    return record


def _by_signal(
    measured: Measurements, errors: Sequence[FloatArray]
) -> dict[str, dict[str, list[float]]]:
    """Return errors (k, m) by tracked satellite and signal at the last epoch, rounded to 1 um."""
    plan = measured.signals.plan
    names = {(s.system, s.band, s.attribute): name for name, s in SIGNALS.items()}
    by_satellite: dict[str, dict[str, list[float]]] = {}
    for link in np.flatnonzero(measured.tracks.is_tracked[-1]).tolist():
        system = int(plan.system[link])
        satellite = satellite_name(system, int(plan.prn[link]))
        signal = names[system, int(plan.band[link]), int(plan.attribute[link])]
        by_satellite.setdefault(satellite, {})[signal] = [
            round(float(error[-1, link]), 6) for error in errors
        ]
    return by_satellite


class SatelliteTruth:
    """Writes a record of each satellite when its broadcast ephemeris comes into use.

    The record ``satellite`` has ``time`` (s into the run), ``satellite``, ``orbit_error`` (true
    less broadcast: radial, along-track, normal; m) and ``clock_error`` (m) at that time, and, in
    ``signals``, for each signal ``group_delay`` (what the broadcast message tells beyond the clock,
    m) and ``bias`` (what it does not, m). Pseudoranges are longer by the sum of the two.

    Parameters
    ----------
    truth : TruthFile
    constellation : Constellation
    receivers : iterable of ReceiverConfiguration
        Receivers whose signals are written.
    start : GpsTime
        Start of the run.
    """

    def __init__(
        self,
        truth: TruthFile,
        constellation: Constellation,
        receivers: Iterable[ReceiverConfiguration],
        start: GpsTime,
    ) -> None:
        names = {name for receiver in receivers for name in receiver.cn0_zenith_dbhz}
        self._truth = truth
        self._constellation = constellation
        self._signals = [signal for name, signal in SIGNALS.items() if name in names]
        self._start = start
        self._written: Sequence[BroadcastEphemeris] = ()

    def write(self, second: int) -> None:
        """Write what is new at a second of the run."""
        if not self._truth.is_wanted:
            return
        ephemerides = self._constellation.table(self._start + second).ephemerides
        if ephemerides is self._written:
            return
        written = {id(ephemeris) for ephemeris in self._written}
        for ephemeris in ephemerides:
            if id(ephemeris) not in written:
                self._truth.write("satellite", time=second, **self._record(ephemeris, second))
        self._written = ephemerides

    def _record(self, ephemeris: BroadcastEphemeris, second: int) -> dict[str, Any]:
        system, prn = ephemeris.system, ephemeris.prn
        errors = self._constellation.orbit_errors([(system, prn)], [second])[0, 0]
        upload = self._constellation.upload_error(ephemeris)
        mean_motion = math.sqrt(
            GRAVITATIONAL_PARAMETER_BROADCAST[system] / ephemeris.semi_major_axis**3
        )
        errors[1] -= upload.seconds_ahead * mean_motion * ephemeris.semi_major_axis
        errors[3] -= upload.clock
        *orbit, clock = errors.tolist()
        return {
            "satellite": satellite_name(system, prn),
            "orbit_error": orbit,
            "clock_error": clock,
            "signals": {
                signal.name: self._signal(signal, ephemeris)
                for signal in self._signals
                if signal.system == system
            },
        }

    def _signal(self, signal: Signal, ephemeris: BroadcastEphemeris) -> dict[str, float]:
        return {
            "group_delay": SPEED_OF_LIGHT * clock_group_delay(signal, ephemeris),
            "bias": self._constellation.signal_bias(
                signal.system, ephemeris.prn, signal.band, signal.attribute
            ),
        }
