"""Receivers of a simulated scenario: follows scenario time and sends their bytes to their ports."""

from __future__ import annotations

import dataclasses
import logging
import select
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_sim_bridge.gnss.configuration import (
    ConstellationConfiguration,
    GnssConfiguration,
    ReceiverConfiguration,
)
from vtff_sim_bridge.gnss.faults import ByteFaults
from vtff_sim_bridge.gnss.power_levels import PowerLevels
from vtff_sim_bridge.gnss.propagation import Ionosphere
from vtff_sim_bridge.gnss.signal_table import SIGNALS
from vtff_sim_bridge.gnss.sky import Constellation
from vtff_sim_bridge.gnss.vehicle_track import vehicle_track
from vtff_sim_bridge.noise.random_streams import (
    EPOCH_NANOSECONDS,
    EPOCHS_PER_SECOND,
    receiver_number,
)
from vtff_sim_bridge.receiver.measurement_engine import MeasurementEngine
from vtff_sim_bridge.receiver.measurements import Measurements
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware
from vtff_sim_bridge.receiver.receiver_port import ReceiverPort
from vtff_sim_bridge.receiver.truth_file import TruthFile
from vtff_sim_bridge.receiver.truth_records import SatelliteTruth, receiver_record
from vtff_sim_bridge.simgen.emulator_state import ScenarioMachine
from vtff_sim_bridge.simremote.motion import MotionState, VehicleMotion
from vtff_sim_bridge.simremote.power_command import PowerCommand

__all__ = ["GnssEmulation", "ReceiverSet", "measure_synthetic_second"]

LOGGER = logging.getLogger("simgen_emulator")

_WHOLE_SECOND = slice(0, EPOCHS_PER_SECOND)
_SYNTHETIC_MOTION = MotionState((6.9e6, 0.0, 0.0), (0.0, 5.2e3, 5.2e3), (-7.5, 0.0, 0.0))


class ReceiverSet:
    """All receivers during one run: measurements and bytes, without ports.

    Parameters
    ----------
    configuration : GnssConfiguration
    emulated : dict of str to ReceiverFirmware
        Firmware by receiver name: it obeys commands and makes logs.
    start, end : GpsTime
        Start and end of the run; the start is a whole second.
    state_itrf : array_like, shape (6,)
        Position (m) and velocity (m/s) of the first receiver's vehicle at the start.
    truth : TruthFile
    power_commands : sequence of PowerCommand
        Levels of the signals; may grow during the run.

    Raises
    ------
    ValueError, OSError
        If the constellation cannot be made for this run.
    """

    def __init__(
        self,
        configuration: GnssConfiguration,
        emulated: dict[str, ReceiverFirmware],
        start: GpsTime,
        end: GpsTime,
        state_itrf: np.ndarray,
        truth: TruthFile,
        power_commands: Sequence[PowerCommand] = (),
    ) -> None:
        seed, faults = configuration.seed, configuration.faults
        systems = {
            SIGNALS[name].system for r in configuration.receivers for name in r.cn0_zenith_dbhz
        }
        constellation = Constellation(configuration.constellation, start, end, systems, seed)
        ionosphere = Ionosphere(
            configuration.profile, configuration.regions, seed, state_itrf, configuration.structures
        )
        truth.write(
            "run", name=configuration.name, seed=seed, start=start.isoformat(), end=end.isoformat()
        )
        self._emulated = emulated
        self._last_epoch = -1
        self._truth = truth
        self.receivers: dict[str, MeasurementEngine] = {}
        self._byte_faults: dict[str, ByteFaults] = {}
        for receiver in configuration.receivers:
            receiver_faults = [fault for fault in faults if fault.receiver == receiver.name]
            self.receivers[receiver.name] = MeasurementEngine(
                receiver,
                constellation,
                ionosphere,
                PowerLevels(power_commands, receiver.vehicle),
                receiver_faults,
                seed,
                start,
                truth,
            )
            number = receiver_number(receiver.name)
            self._byte_faults[receiver.name] = ByteFaults(receiver_faults, seed, number)
            truth.write("receiver", **receiver_record(receiver))
        for region in configuration.regions:
            truth.write("region", **vars(region))
        for structure in configuration.structures:
            kind = type(structure).__name__
            truth.write("horizontal_structure", kind=kind, **vars(structure))
        for fault in faults:
            truth.write("fault", **vars(fault))
        self._satellite_truth = SatelliteTruth(truth, constellation, configuration.receivers, start)

    def advance(
        self,
        time_nanoseconds: int,
        motion_of: Callable[[str], VehicleMotion],
        send: Callable[[str, bytes], None],
    ) -> None:
        """Measure and send everything up to and including a time into the run.

        Parameters
        ----------
        time_nanoseconds : int
            Into the run.
        motion_of : callable
            Motion of a vehicle by its id.
        send : callable
            Is given the name of a receiver and its bytes, part of a second by part.
        """
        newest = time_nanoseconds // EPOCH_NANOSECONDS
        while self._last_epoch < newest:
            first = self._last_epoch + 1
            second = -(-first // EPOCHS_PER_SECOND)
            last = min(newest, second * EPOCHS_PER_SECOND)
            self._satellite_truth.write(second)
            for name, receiver in self.receivers.items():
                motion = motion_of(receiver.configuration.vehicle)
                send(name, self._bytes_of(name, receiver, motion, second, first, last))
            self._last_epoch = last
        self._truth.flush()

    def _bytes_of(
        self,
        name: str,
        receiver: MeasurementEngine,
        motion: VehicleMotion,
        second: int,
        first: int,
        last: int,
    ) -> bytes:
        """Return what a receiver sends at epochs of one second."""
        origin = (second - 1) * EPOCHS_PER_SECOND + 1
        emitted = slice(first - origin, last - origin + 1)
        emulated, faults = self._emulated[name], self._byte_faults[name]
        measured = _measure(receiver, motion, second, emitted)
        emulated.time_status = receiver.time_status
        contents = emulated.advance_epochs(measured.times, receiver)
        return b"".join(map(faults.apply, contents, range(first, last + 1)))


def _measure(
    receiver: MeasurementEngine, motion: VehicleMotion, second: int, emitted: slice
) -> Measurements:
    """Return what a receiver measures at epochs of one second."""
    antenna = None
    if receiver.configuration.has_antenna_geometry:
        antenna = receiver.configuration.lever_arm_body or (0.0, 0.0, 0.0)
    return receiver.measure(second, emitted, vehicle_track(motion, second, emitted, antenna))


def measure_synthetic_second(configuration: GnssConfiguration) -> None:
    """Measure a second with another receiver: the first one compiles for many seconds."""
    receiver = dataclasses.replace(configuration.receivers[0], name="synthetic")
    synthetic = dataclasses.replace(
        configuration,
        constellation=ConstellationConfiguration(),
        receivers=(receiver,),
        faults=(),
        regions=(),
        structures=(),
    )
    firmware = ReceiverFirmware()
    firmware.receive(b"LOG RANGEB ONTIME 0.05\rLOG BESTXYZB ONTIME 1\rLOG TIMEB ONTIME 1\r")
    state = _SYNTHETIC_MOTION
    motion = VehicleMotion()
    motion.command(0, state)
    receivers = ReceiverSet(
        synthetic,
        {receiver.name: firmware},
        GpsTime(0),
        GpsTime(NANOSECONDS_PER_SECOND),
        np.concatenate((state.position_itrf, state.velocity_itrf)),
        TruthFile(),
    )
    for second in (0, 1):
        receivers.advance(
            second * NANOSECONDS_PER_SECOND, lambda vehicle: motion, lambda name, content: None
        )


class GnssEmulation:
    """Receivers of a `ScenarioMachine` with their ports; an observer of its time.

    The bytes of a time are handed to the ports, and its truth is written, before the reply to the
    motion command that brought it. What a client does not take waits; in lockstep the server
    carries out no further command while too much of it waits (see `is_congested`), so that nothing
    is lost.

    Parameters
    ----------
    machine : ScenarioMachine
        Is observed from now on.
    configuration : GnssConfiguration
    link_directory : path-like or None
        Folder, made if absent, in which each pseudo-terminal gets a symlink named as its receiver.
    truth_path : path-like or None
        Where the truth of the last run is written.
    tcp_host : str
        Address on which receivers with a TCP port listen.

    Attributes
    ----------
    ports : dict of str to ReceiverPort
        By receiver name.

    Raises
    ------
    ValueError
        If a vehicle is not in the scenario, or a receiver would have no port.
    OSError
        If a port cannot be made.
    """

    def __init__(
        self,
        machine: ScenarioMachine,
        configuration: GnssConfiguration,
        link_directory: str | Path | None,
        truth_path: str | Path | None = None,
        *,
        tcp_host: str = "127.0.0.1",
    ) -> None:
        for receiver in configuration.receivers:
            if receiver.vehicle not in machine.motions:
                vehicles = ", ".join(machine.motions)
                raise ValueError(
                    f"receiver {receiver.name}: vehicle {receiver.vehicle} is none of {vehicles}"
                )
            if link_directory is None and receiver.tcp_port is None:
                raise ValueError(f"receiver {receiver.name}: neither link directory nor tcp_port")
        measure_synthetic_second(configuration)
        self._machine = machine
        self._configuration = configuration
        self._links = None if link_directory is None else Path(link_directory)
        self._truth_path = truth_path
        self._tcp_host = tcp_host
        self._truth = TruthFile()
        self._set: ReceiverSet | None = None
        self._emulated: dict[str, ReceiverFirmware] = {}
        self.ports: dict[str, ReceiverPort] = {}
        self._epoll = select.epoll()
        if self._links is not None:
            self._links.mkdir(parents=True, exist_ok=True)
        self._open_ports()
        machine.observers.append(self._advance)

    @property
    def is_congested(self) -> bool:
        """Whether a client is so slow that scenario time should wait for it.

        In lockstep only: the wall clock waits for nobody, and a receiver loses what is not taken.
        """
        return self._machine.is_lockstep and any(port.is_congested for port in self.ports.values())

    def fileno(self) -> int:
        """Return a descriptor that is readable when `process` has something to do."""
        return self._epoll.fileno()

    def process(self) -> None:
        """Take commands from the ports and send what waits, as far as clients take it."""
        for port in self.ports.values():
            port.process()

    def close(self) -> None:
        """Close ports and truth file."""
        self._close_ports()
        self._epoll.close()
        self._truth.close()

    def _close_ports(self) -> None:
        for port in self.ports.values():
            self._epoll.unregister(port.fileno())
            port.close()
        self.ports.clear()

    def _open_ports(self) -> None:
        try:
            for receiver in self._configuration.receivers:
                self._open_port(receiver)
        except OSError:
            self.close()
            raise

    def _open_port(self, receiver: ReceiverConfiguration) -> None:
        emulated = ReceiverFirmware(
            "COM1",
            HeaderSettings(generation=receiver.generation),
            baud=receiver.baud,
            limits_baud=receiver.limits_baud,
        )
        link = None if self._links is None else self._links / receiver.name
        port = ReceiverPort(emulated, link, tcp_host=self._tcp_host, tcp_port=receiver.tcp_port)
        self._emulated[receiver.name] = emulated
        self.ports[receiver.name] = port
        self._epoll.register(port.fileno(), select.EPOLLIN)
        addresses = [] if link is None else [str(link)]
        if port.tcp_port is not None:
            addresses.append(f"TCP port {port.tcp_port}")
        LOGGER.info("receiver %s on %s", receiver.name, " and ".join(addresses))

    def _advance(self, time_nanoseconds: int) -> None:
        machine = self._machine
        if time_nanoseconds == 0:
            self._set = self._start_receivers()
        if self._set is not None:
            self._set.advance(time_nanoseconds, machine.motions.__getitem__, self._send)

    def _send(self, name: str, content: bytes) -> None:
        # While this receiver measured, clients have read of the others what their terminals held.
        for port in self.ports.values():
            port.send_waiting()
        if content:
            self.ports[name].send(content)

    def _start_receivers(self) -> ReceiverSet:
        """Return the receivers of a run that begins; those of a run before start anew."""
        machine = self._machine
        if self._set is not None:
            LOGGER.info("a new run begins: the receivers are switched off and on")
            self._close_ports()
            self._open_ports()
        start = GpsTime(machine.start_time_seconds * NANOSECONDS_PER_SECOND)
        self._truth.close()
        self._truth = TruthFile(self._truth_path)
        first = machine.motions[self._configuration.receivers[0].vehicle].at(0)
        return ReceiverSet(
            self._configuration,
            self._emulated,
            start,
            start + machine.duration_seconds,
            np.concatenate((first.position_itrf, first.velocity_itrf)),
            self._truth,
            machine.power_commands,
        )
