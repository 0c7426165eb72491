"""Flights of two spacecraft at 20 Hz: what receivers and relative navigation give, and the truth.

The measurements are those of the emulated receivers before they are encoded, in the precision of
their logs; the relative filter that vtff ships runs over them at 1 Hz. What costs most, the
emulation and the filter, is kept in a folder, so that the ionosphere chain can be run again alone.
"""

from __future__ import annotations

import hashlib
import math
import os
import pathlib
import pickle
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from realism.recording import DESIGN, simulator_fingerprint

from vtff_analysis.closed_loop.simulation import simulate_closed_loop
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_GPS
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationSeries
from vtff_gnss.signals import carrier_frequency_hz
from vtff_iono.links.geometry_free import tecu_per_metre
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock
from vtff_nav.relative.common.estimator_setting import EstimatorSetting
from vtff_nav.relative.common.solution import RelativeSolution
from vtff_nav.relative.shipped_estimators import make_cdgps
from vtff_sim_bridge.bridge.simgen_link import motion_state
from vtff_sim_bridge.gnss.configuration import GnssConfiguration
from vtff_sim_bridge.receiver.measurements import Measurements
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware
from vtff_sim_bridge.receiver.truth_file import TruthFile
from vtff_sim_bridge.simgen.gnss_emulation import ReceiverSet
from vtff_sim_bridge.simremote.motion import VehicleMotion
from vtff_sim_bridge.truth.scenario import Scenario

__all__ = ["RecordedSecond", "Recording", "load_or_fly"]


@dataclass(frozen=True, eq=False)
class RecordedSecond:
    """What a second of a flight gives.

    Parameters
    ----------
    time : GpsTime
        End of the second.
    position_itrf : ndarray, shape (2, 3)
        True positions of chief and deputy at its end, m.
    observations : tuple of 2 ObservationBlock
        All epochs of the second.
    ephemerides : tuple of BroadcastEphemeris
        New ones.
    solution : RelativeSolution
        Solution of the relative filter.
    fixes_itrf : tuple of 2 ndarray, shape (6,), or None
        Own solutions of the receivers, m and m/s.
    stec_tecu : tuple of 2 dict of int to float
        True slant TEC by PRN of GPS at the end of the second.
    column_errors : dict of int to (float, float)
        By PRN of GPS what the phases show of the differential slant TEC, deputy less chief, if
        every integer is known, less the true one: mean over the second, TECU; and the path of the
        ray through a layer over its height. Only where both receivers track both signals all the
        time.
    """

    time: GpsTime
    position_itrf: FloatArray
    observations: tuple[ObservationBlock, ObservationBlock]
    ephemerides: tuple[BroadcastEphemeris, ...]
    solution: RelativeSolution
    fixes_itrf: tuple[FloatArray | None, FloatArray | None]
    stec_tecu: tuple[dict[int, float], dict[int, float]]
    column_errors: dict[int, tuple[float, float]]


Recording = list[RecordedSecond]


def _block(series: ObservationSeries) -> ObservationBlock:
    """Return all observations of a series, epoch by epoch."""
    epochs = [series.epoch(index) for index in range(len(series))]
    times = np.repeat([epoch.time.nanoseconds for epoch in epochs], [len(e) for e in epochs])
    columns = {
        name: np.concatenate([getattr(epoch, name) for epoch in epochs])
        for name in OBSERVATION_COLUMNS
    }
    return ObservationBlock(times.astype(np.int64), columns)


def _phase_errors(measured: Measurements) -> dict[int, tuple[float, float]]:
    """Return the error of the content that phases show if their integers are known, by PRN.

    Mean over the second, TECU; and the path through a layer over its height. What receivers slip
    by is known too, what scintillation winds the signals up by is not.
    """
    signals, tracks = measured.signals, measured.tracks
    plan = signals.plan
    phase = (measured.observables.carrier_phase_cycles - tracks.cycles) * plan.wavelength
    columns = {
        (int(prn), int(band)): column
        for column, (system, prn, band) in enumerate(
            zip(plan.system.tolist(), plan.prn.tolist(), plan.band.tolist(), strict=True)
        )
        if system == SYSTEM_GPS and band in (1, 2)
    }
    scale = tecu_per_metre(*carrier_frequency_hz([SYSTEM_GPS] * 2, (1, 2)).tolist())
    errors = {}
    for (prn, band), first in columns.items():
        second = columns.get((prn, 2))
        if band != 1 or second is None or not tracks.is_tracked[:, [first, second]].all():
            continue
        satellite = plan.satellite[first]
        content = scale * (phase[:, first] - phase[:, second])
        error = float(np.mean(content - signals.slant_tec_tecu[:, satellite]))
        elevation = float(signals.line_of_sight.elevation[-1, satellite])
        errors[prn] = (error, 1.0 / math.sin(elevation))
    return errors


def fly(
    scenario: Scenario, gnss: GnssConfiguration, setting: EstimatorSetting
) -> Iterator[RecordedSecond]:
    """Yield the seconds of a flight whose deputy keeps its target, fed with truth."""
    thrust_rtn = simulate_closed_loop(scenario, DESIGN).deputy().applied_rtn
    firmware = {
        receiver.name: ReceiverFirmware(settings=HeaderSettings(generation=receiver.generation))
        for receiver in gnss.receivers
    }
    truth = scenario.formation_truth()
    names = tuple(craft.name for craft in scenario.spacecraft[:2])
    vehicles = {receiver.vehicle: VehicleMotion() for receiver in gnss.receivers}
    end = scenario.epoch + scenario.duration
    first = truth.motion_itrf(names[0])[:2].ravel()
    receivers = ReceiverSet(gnss, firmware, scenario.epoch, end, first, TruthFile(None))
    estimator = make_cdgps(setting)
    heard: dict[str, tuple[BroadcastEphemeris, ...]] = {}
    for second, thrust in enumerate(thrust_rtn):
        for name, motion in zip(names, vehicles.values(), strict=True):
            applied = thrust if name == names[1] else None
            motion.command(second * 10**9, motion_state(truth.motion_itrf(name, applied)))
        receivers.advance(second * 10**9, vehicles.__getitem__, lambda name, sent: None)
        for motion in vehicles.values():
            motion.forget_before(second * 10**9)
        now = truth.time
        blocks, epochs, fixes, contents, new = [], [], [], [], []
        errors: list[dict[int, tuple[float, float]]] = []
        for name, engine in receivers.receivers.items():
            measured = engine.measurements
            assert measured is not None
            blocks.append(_block(measured.series))
            epochs.append(measured.series.epoch(-1))
            fix = engine.fix(now)
            state = np.array([*fix.position, *fix.velocity])
            fixes.append(state if np.isfinite(state).all() else None)
            plan = measured.signals.plan
            of_gps = [
                (prn, column) for column, (system, prn) in enumerate(plan.satellites) if system == 0
            ]
            contents.append(
                {prn: float(measured.signals.slant_tec_tecu[-1, column]) for prn, column in of_gps}
            )
            errors.append(_phase_errors(measured))
            broadcast = engine.ephemerides(now)
            if broadcast is not heard.get(name):
                heard[name] = broadcast
                new += broadcast
        for ephemeris in new:
            estimator.add_ephemeris(ephemeris)
        solution = estimator.process(now, *epochs)
        if thrust.any():
            estimator.add_thrust(now, 1.0, thrust)
        yield RecordedSecond(
            now,
            np.array([truth.motion_itrf(name)[0] for name in names]),
            (blocks[0], blocks[1]),
            tuple(new),
            solution,
            (fixes[0], fixes[1]),
            (contents[0], contents[1]),
            {
                prn: (errors[1][prn][0] - errors[0][prn][0], errors[0][prn][1])
                for prn in errors[0].keys() & errors[1].keys()
            },
        )
        truth.advance({names[1]: thrust})


def load_or_fly(
    name: str,
    scenario: Scenario,
    gnss: GnssConfiguration,
    setting: EstimatorSetting,
    cache: pathlib.Path | None,
) -> Recording:
    """Return a flight: that of the folder `cache`, where one of the same simulator is there."""
    if cache is None:
        return list(fly(scenario, gnss, setting))
    inputs = hashlib.sha256(pickle.dumps((scenario, gnss, setting)))
    inputs.update(simulator_fingerprint().encode())
    inputs.update(" ".join(RecordedSecond.__annotations__).encode())
    path = cache / f"{name}-{inputs.hexdigest()[:16]}.pickle"
    if path.is_file():
        with path.open("rb") as stream:
            recording: Recording = pickle.load(stream)
        return recording
    recording = list(fly(scenario, gnss, setting))
    cache.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(f".{os.getpid()}.{time.monotonic_ns()}")
    with partial.open("wb") as stream:
        pickle.dump(recording, stream, protocol=pickle.HIGHEST_PROTOCOL)
    partial.replace(path)
    return recording
