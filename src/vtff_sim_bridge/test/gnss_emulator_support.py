"""Runs of simulated receivers without processes and ports, for the tests of this folder."""

from __future__ import annotations

import dataclasses
import pathlib
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from vtff_dynamics.constants import EARTH_ROTATION_RATE, GM_EARTH
from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_dynamics.orbit.propagator import ForceModel, Propagator
from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_gnss.novatel import ReceiverLogStream
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.observations import ObservationEpoch
from vtff_sim_bridge.gnss.configuration import GnssConfiguration, load_gnss_configuration
from vtff_sim_bridge.receiver.measurements import Measurements
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware
from vtff_sim_bridge.receiver.truth_file import TruthFile
from vtff_sim_bridge.simgen.gnss_emulation import ReceiverSet
from vtff_sim_bridge.simremote.motion import MotionState, VehicleMotion
from vtff_sim_bridge.simremote.power_command import PowerCommand

REPOSITORY = pathlib.Path(__file__).resolve().parents[3]
START = parse_epoch("2016-03-21T01:00:00 GPS")
CHIEF_GCRF = np.array([6928137.0, 0.0, 0.0, 0.0, 3792.5442661521847, 6568.879358929605])
DEPUTY_GCRF = CHIEF_GCRF + np.array([120.0, 500.0, 866.0, 0.0, 0.0, 0.0])
VEHICLES = ("v1_m1", "v2_m1")
LOGS = b"LOG RANGEB ONTIME 0.05\r\nLOG GPSEPHEMB ONCHANGED\r\nLOG GALINAVEPHEMERISB ONCHANGED\r\n"


def configuration(name: str = "noise_free", **changes: object) -> GnssConfiguration:
    """Return a configuration of the repository with other fields."""
    loaded = load_gnss_configuration(REPOSITORY / "config" / "gnss" / f"{name}.yaml")
    return dataclasses.replace(loaded, **changes)


def with_receivers(base: GnssConfiguration, **changes: object) -> GnssConfiguration:
    """Return a configuration in which every receiver has other fields."""
    receivers = tuple(dataclasses.replace(r, **changes) for r in base.receivers)
    return dataclasses.replace(base, receivers=receivers)


def motion_state(state_itrf: np.ndarray) -> MotionState:
    """Return position, velocity and two-body acceleration as a motion command tells them."""
    position, velocity = state_itrf[:3], state_itrf[3:]
    rotation = np.array([0.0, 0.0, EARTH_ROTATION_RATE])
    acceleration = (
        -GM_EARTH * position / np.linalg.norm(position) ** 3
        - 2.0 * np.cross(rotation, velocity)
        - np.cross(rotation, np.cross(rotation, position))
    )
    return MotionState(*(tuple(v.tolist()) for v in (position, velocity, acceleration)))


def orbit_motions(
    states_gcrf: Sequence[np.ndarray], seconds: int, start: GpsTime = START, step: float = 1.0
) -> list[list[MotionState]]:
    """Return the motion commands of vehicles on two-body orbits: one list per step."""
    model = ForceModel(gravity="two_body")
    crafts = [Propagator(start, state, model, step=step) for state in states_gcrf]
    motions = []
    for _ in range(round(seconds / step) + 1):
        motions.append([motion_state(state_gcrf_to_itrf(c.time, c.state_gcrf)) for c in crafts])
        for craft in crafts:
            craft.advance()
    return motions


class Run:
    """A run of the receivers of a configuration, advanced second by second.

    Parameters
    ----------
    base : GnssConfiguration
    motions : list of list of MotionState
        One list for each second.
    logs : bytes or dict of str to bytes
        Commands for all receivers, or for each.
    chunk : int
        Nanoseconds of scenario time by which the receivers are advanced.
    truth_path : path-like, optional
    power_commands : sequence of PowerCommand, optional
    ahead : int
        How many vehicles, from the first on, are commanded a second ahead; receivers that can
        measure the next second then do so.
    """

    def __init__(
        self,
        base: GnssConfiguration,
        motions: list[list[MotionState]],
        logs: bytes | Mapping[str, bytes] = b"",
        chunk: int = 1_000_000_000,
        start: GpsTime = START,
        truth_path: pathlib.Path | None = None,
        power_commands: Sequence[PowerCommand] = (),
    ) -> None:
        self.start = start
        self.emulated = {
            r.name: ReceiverFirmware(settings=HeaderSettings(generation=r.generation))
            for r in base.receivers
        }
        for name, emulated in self.emulated.items():
            emulated.receive(logs if isinstance(logs, bytes) else logs[name])
        first = motions[0][0]
        state = np.array(first.position_itrf + first.velocity_itrf)
        self.truth = TruthFile(truth_path)
        end = start + (len(motions) - 1)
        self.set = ReceiverSet(base, self.emulated, start, end, state, self.truth, power_commands)
        self._motions = motions
        self._chunk = chunk
        self._vehicles = {vehicle: VehicleMotion() for vehicle in VEHICLES}
        self.content = {name: bytearray() for name in self.emulated}

    def all(self, each: Callable[[int], None] | None = None) -> Run:
        """Advance to the end; `each` is called with the time in s after each second."""
        times = range(0, (len(self._motions) - 1) * 10**9 + 1, self._chunk)
        for time in times:
            second, part = divmod(time, 10**9)
            if part == 0:
                for vehicle, state in zip(VEHICLES, self._motions[second], strict=False):
                    self._vehicles[vehicle].command(time, state)
            self.set.advance(time, self._vehicles.__getitem__, self._send)
            for vehicle in self._vehicles.values():
                vehicle.forget_before(time)
            if part == 0 and each is not None:
                each(second)
        self.truth.close()
        return self

    def _send(self, name: str, content: bytes) -> None:
        self.content[name] += content

    def measurements(self, name: str) -> Measurements:
        """Return the last measurements of a receiver."""
        measured = self.set.receivers[name].measurements
        assert measured is not None
        return measured

    def epochs(self, name: str) -> list[ObservationEpoch]:
        """Return the observations in the bytes of a receiver, as the decoder reads them."""
        events = ReceiverLogStream().feed(bytes(self.content[name]))
        return [event for event in events if isinstance(event, ObservationEpoch)]


def signal_index(epoch: ObservationEpoch) -> dict[tuple[int, int, int], int]:
    """Return the places of the signals (system, number, band) of an epoch."""
    keys = zip(epoch.system.tolist(), epoch.prn.tolist(), epoch.band.tolist(), strict=True)
    return {key: index for index, key in enumerate(keys)}
