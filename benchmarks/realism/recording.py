"""Flights of a world: truth, thrust, and what both emulated receivers send; kept in a folder."""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib.util
import os
import pathlib
import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from vtff_analysis.closed_loop.simulation import simulate_closed_loop
from vtff_control.tracking.sdre import SdreDesign
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.novatel import ReceiverLogStream
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.signals import SignalKey
from vtff_sim_bridge.attitude.attitude_motion import attitude_motion
from vtff_sim_bridge.bridge.simgen_link import motion_state
from vtff_sim_bridge.gnss.configuration import GnssConfiguration
from vtff_sim_bridge.gnss.signal_table import SIGNALS, satellite_from_name
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware
from vtff_sim_bridge.receiver.truth_file import TruthFile
from vtff_sim_bridge.simgen.gnss_emulation import ReceiverSet
from vtff_sim_bridge.simremote.motion import VehicleMotion
from vtff_sim_bridge.truth.scenario import Scenario

from .worlds import World

__all__ = [
    "DESIGN",
    "EmulatedFormation",
    "Recording",
    "Second",
    "fly_truth_fed",
    "load_or_fly",
    "simulator_fingerprint",
]

DESIGN = SdreDesign("delay_aware", acceleration_cap=1.4)
LOGS = b"LOG RANGEB ONTIME 1\r\nLOG GPSEPHEMB ONCHANGED\r\n"
# A recording stands while these packages, which make it, do the same.
_SOURCES = ("vtff_dynamics", "vtff_gnss", "vtff_sim_bridge")


@dataclass(frozen=True, eq=False)
class Second:
    """What a second of a flight gives.

    Parameters
    ----------
    time : GpsTime
    state_chief_gcrf, state_deputy_gcrf : ndarray, shape (6,)
        Truth, m and m/s.
    position_chief_itrf : ndarray, shape (3,)
        m.
    thrust_rtn : ndarray, shape (3,)
        What the thruster reports for the second that begins, m/s2.
    epochs : tuple of 2 ObservationEpoch or None
        Of chief and deputy.
    ephemerides : tuple of BroadcastEphemeris
        New ones.
    cycles : dict of SignalKey to float
        True ambiguities of the signals that both receivers track, deputy less chief, cycles.
    """

    time: GpsTime
    state_chief_gcrf: FloatArray
    state_deputy_gcrf: FloatArray
    position_chief_itrf: FloatArray
    thrust_rtn: FloatArray
    epochs: tuple[ObservationEpoch | None, ObservationEpoch | None]
    ephemerides: tuple[BroadcastEphemeris, ...]
    cycles: dict[SignalKey, float]


Recording = list[Second]


class _Ambiguities(TruthFile):
    """Takes the ambiguities of each receiver from what would go to the truth file."""

    def __init__(self) -> None:
        super().__init__(None)
        self.cycles: dict[str, dict[SignalKey, float]] = {}
        self._wind_up: dict[str, dict[tuple[int, int], float]] = {}

    @property
    def is_wanted(self) -> bool:
        """Whether records are kept."""
        return True

    def write(self, record: str, **fields: Any) -> None:
        """Keep the ambiguity of an arc, and the turns of the antenna under each satellite."""
        if record == "second" and "wind_up" in fields:
            satellites = map(satellite_from_name, fields["satellites"])
            turns = zip(satellites, fields["wind_up"], strict=True)
            self._wind_up[fields["receiver"]] = dict(turns)
        if record != "arc":
            return
        signal = SIGNALS[fields["signal"]]
        key = SignalKey(*satellite_from_name(fields["satellite"]), signal.band, signal.attribute)
        of_receiver = self.cycles.setdefault(fields["receiver"], {})
        if fields["event"] == "lost":
            of_receiver.pop(key, None)
        else:
            of_receiver[key] = fields["cycles"]

    def differences(self, chief: str, deputy: str) -> dict[SignalKey, float]:
        """Return what phases exceed ranges by, deputy less chief: whole cycles and wind-up."""
        first, second = (
            {
                key: cycles + self._wind_up.get(name, {}).get(key.satellite, 0.0)
                for key, cycles in self.cycles.get(name, {}).items()
            }
            for name in (chief, deputy)
        )
        return {key: second[key] - first[key] for key in first.keys() & second.keys()}


class EmulatedFormation:
    """Truth and both emulated receivers with decoders of what they send, second by second.

    Parameters
    ----------
    gnss : GnssConfiguration
    scenario : Scenario
    attitude_deputy : callable, optional
        Quaternion to GCRF (4,) and rate (3,), rad/s, of the deputy's body for its state (6,) and
        the seconds since the start. By default the body is aligned with the local horizon.
    """

    def __init__(
        self,
        gnss: GnssConfiguration,
        scenario: Scenario,
        attitude_deputy: Callable[[FloatArray, int], tuple[FloatArray, FloatArray]] | None = None,
    ) -> None:
        self._attitude_deputy = attitude_deputy
        firmware = {
            receiver.name: ReceiverFirmware(settings=HeaderSettings(generation=receiver.generation))
            for receiver in gnss.receivers
        }
        for emulated in firmware.values():
            emulated.receive(LOGS)
        self._names = tuple(craft.name for craft in scenario.spacecraft[:2])
        self.truth = scenario.formation_truth()
        motion = self.truth.motion_itrf(self._names[0])
        end = scenario.epoch + scenario.duration
        self._ambiguities = _Ambiguities()
        self._set = ReceiverSet(
            gnss, firmware, scenario.epoch, end, motion[:2].ravel(), self._ambiguities
        )
        self._streams = {name: ReceiverLogStream() for name in firmware}
        self._vehicles = {receiver.vehicle: VehicleMotion() for receiver in gnss.receivers}
        self._second = 0

    def measure(self, thrust_rtn: FloatArray) -> Second:
        """Return what is measured now, where the deputy's thrust of the coming second begins."""
        time, second = self.truth.time, self._second
        nanoseconds = second * 10**9
        chief, deputy = self._names
        for name, motion in zip(self._names, self._vehicles.values(), strict=True):
            applied = thrust_rtn if name == deputy else None
            moved = self.truth.motion_itrf(name, applied)
            if name == deputy and self._attitude_deputy is not None:
                state = self.truth.state_gcrf(name)
                attitude = self._attitude_deputy(state, second)
                moved = np.concatenate((moved, attitude_motion(time, state, *attitude)))
            motion.command(nanoseconds, motion_state(moved))
        sent: dict[str, bytearray] = {name: bytearray() for name in self._streams}
        self._set.advance(
            nanoseconds, self._vehicles.__getitem__, lambda name, new: sent[name].extend(new)
        )
        for motion in self._vehicles.values():
            motion.forget_before(nanoseconds)
        epochs: list[ObservationEpoch | None] = []
        ephemerides: list[BroadcastEphemeris] = []
        for name, stream in self._streams.items():
            events = stream.feed(bytes(sent[name]))
            observed = [event for event in events if isinstance(event, ObservationEpoch)]
            epochs.append(observed[-1] if observed else None)
            ephemerides += [event for event in events if isinstance(event, BroadcastEphemeris)]
        return Second(
            time=time,
            state_chief_gcrf=self.truth.state_gcrf(chief),
            state_deputy_gcrf=self.truth.state_gcrf(deputy),
            position_chief_itrf=self.truth.motion_itrf(chief)[0],
            thrust_rtn=thrust_rtn,
            epochs=(epochs[0], epochs[1]),
            ephemerides=tuple(ephemerides),
            cycles=self._ambiguities.differences(*self._streams),
        )

    def advance(self, thrust_rtn: FloatArray) -> None:
        """Go on by a second in which the deputy's thruster reports a thrust."""
        self.truth.advance({self._names[1]: thrust_rtn})
        self._second += 1


def fly_truth_fed(
    scenario: Scenario, gnss: GnssConfiguration, *, is_controlled: bool
) -> Iterator[Second]:
    """Yield the seconds of a flight whose controller, if there is one, is fed with truth."""
    count = round(scenario.duration)
    thrust_rtn = np.zeros((count, 3))
    if is_controlled:
        thrust_rtn = simulate_closed_loop(scenario, DESIGN).deputy().applied_rtn
    formation = EmulatedFormation(gnss, scenario)
    for thrust in thrust_rtn:
        yield formation.measure(thrust)
        formation.advance(thrust)


def load_or_fly(
    name: str, world: World, seed: int, seconds: int | None, cache: pathlib.Path | None
) -> Recording:
    """Return the flight of a world: that of the folder `cache`, where it is kept, if it is there.

    A recording that was made by another version of the simulator or of the world is not taken.
    """
    scenario, gnss = world.make(seed, seconds)
    is_controlled = world.motion != "free"
    if cache is None:
        return list(fly_truth_fed(scenario, gnss, is_controlled=is_controlled))
    inputs = hashlib.sha256(pickle.dumps((scenario, gnss, is_controlled)))
    inputs.update(simulator_fingerprint().encode())
    seconds = round(scenario.duration)
    path = cache / f"{name}-{seed}-{seconds}s-{inputs.hexdigest()[:16]}.pickle"
    if path.is_file():
        with path.open("rb") as stream:
            recording: Recording = pickle.load(stream)
        return recording
    recording = list(fly_truth_fed(scenario, gnss, is_controlled=is_controlled))
    cache.mkdir(parents=True, exist_ok=True)
    for outdated in cache.glob(f"{name}-{seed}-{seconds}s-*.pickle"):
        outdated.unlink(missing_ok=True)
    partial = path.with_suffix(f".{os.getpid()}")
    with partial.open("wb") as stream:
        pickle.dump(recording, stream, protocol=pickle.HIGHEST_PROTOCOL)
    partial.replace(path)
    return recording


@functools.cache
def simulator_fingerprint() -> str:
    """Return a hash of what the sources of the simulator do: not of comments and docstrings."""
    digest = hashlib.sha256()
    for package in _SOURCES:
        specification = importlib.util.find_spec(package)
        assert specification is not None and specification.origin is not None
        for path in sorted(pathlib.Path(specification.origin).parent.rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            for node in ast.walk(tree):
                body = getattr(node, "body", None)
                if isinstance(body, list):
                    node.body = [line for line in body if not _is_text(line)]  # type: ignore[attr-defined]
            digest.update(ast.dump(tree).encode())
    return digest.hexdigest()


def _is_text(line: ast.stmt) -> bool:
    return (
        isinstance(line, ast.Expr)
        and isinstance(line.value, ast.Constant)
        and isinstance(line.value.value, str)
    )
