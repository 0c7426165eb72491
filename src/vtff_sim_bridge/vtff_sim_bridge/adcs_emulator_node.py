"""Node `adcs_emulator`: the ADCS module of a spacecraft as its CAN bus shows it."""

from __future__ import annotations

from dataclasses import dataclass

import can
import numpy as np

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_msgs.msg import AdcsReport
from vtff_node import diagnostics
from vtff_node.loopback_can_bus import LoopbackCanBus
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.stamps import to_nanoseconds
from vtff_sim_bridge.attitude.adcs_bus import AdcsBus, AdcsModulePort


@dataclass(frozen=True)
class AdcsEmulatorParameters:
    """Parameters of `adcs_emulator`."""

    dbc_file: str = parameter(REQUIRED, "DBC file with the frames of the module")
    interface: str = parameter(
        "udp_multicast", "interface of python-can: virtual, socketcan, udp_multicast, ..."
    )
    channel: str = parameter("239.74.163.3", "bus of that interface, as can0 or a multicast group")
    port: int = parameter(0, "UDP port of udp_multicast, 0 = its default", minimum=0, maximum=65535)
    spacecraft: str = parameter("spacecraft", "spacecraft of the module")
    longest_pulse: int = parameter(400, "steps of a pulse at most", minimum=0, maximum=511)
    largest_wheel_speed_rpm: float = parameter(5000.0, "either way", unit="rpm", minimum=0.0)
    bus_off_after: float = parameter(
        0.0, "a fault: time of the run from which the module is off the bus", unit="s", minimum=0.0
    )
    bus_off_duration: float = parameter(0.0, "how long; 0: no fault", unit="s", minimum=0.0)


class AdcsEmulatorNode(VtffNode):
    """The other end of the CAN bus of an ADCS module, run in the namespace of the spacecraft.

    Subscribes to adcs/module_report (vtff_msgs/AdcsReport, of the simulator) and sends it as
    frames; answers the commands that come over the bus within the limits of the module.
    """

    Parameters = AdcsEmulatorParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("adcs_emulator", **node_arguments)
        given: AdcsEmulatorParameters = self.parameters
        try:
            self._port = AdcsModulePort(
                given.dbc_file, given.longest_pulse, given.largest_wheel_speed_rpm
            )
        except ValueError as error:
            raise ParameterError(f"parameter 'dbc_file': {error}") from error
        self._bus = AdcsBus(self._port, self._open_bus)
        try:
            self._bus.start()
        except can.CanInterfaceNotImplementedError as error:
            raise ParameterError(f"parameter 'interface': {error}") from error
        self._first_stamp = -1
        self._reports = 0
        self.subscribe(AdcsReport, "adcs/module_report", self._on_report)

    def _open_bus(self) -> can.BusABC:
        given: AdcsEmulatorParameters = self.parameters
        if given.interface == "udp_multicast":
            return LoopbackCanBus(given.channel, given.port)
        return can.Bus(given.channel, given.interface)

    def _on_report(self, message: AdcsReport) -> None:
        if not self.is_of_deputy(message, self.parameters.spacecraft, "adcs/module_report"):
            return
        stamp = to_nanoseconds(message.header.stamp)
        self.scenario_nanoseconds = stamp
        if self._first_stamp < 0:
            self._first_stamp = stamp
        elapsed = (stamp - self._first_stamp) / NANOSECONDS_PER_SECOND
        since = elapsed - self.parameters.bus_off_after
        self._bus.is_off = 0.0 <= since < self.parameters.bus_off_duration
        x, y, z = (int(steps) for steps in message.pulse_steps)
        time = GpsTime.from_unix_nanoseconds(stamp)
        self._reports += 1
        self._bus.send(
            self._port.report(
                time.time_of_week_nanoseconds / NANOSECONDS_PER_SECOND,
                message.period,
                np.array(message.field_body).reshape(-1, 3),
                (x, y, z),
                message.wheel_command_rpm,
                message.wheel_speed_rpm,
            )
        )

    def on_stop(self) -> None:
        """Close the bus."""
        self._bus.close()

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report the bus."""
        level, text = diagnostics.OK, "on the bus"
        if self._bus.problem:
            level, text = diagnostics.ERROR, f"no bus: {self._bus.problem}"
        elif self._bus.is_off:
            level, text = diagnostics.WARN, "off the bus, as told"
        return [
            diagnostics.status(
                f"{self.get_name()}: bus",
                level,
                text,
                {
                    "reports": self._reports,
                    "commands": self._port.commands,
                    "rejected frames": self._port.rejected_frames,
                },
                hardware_id=f"{self.parameters.interface} {self.parameters.channel}",
            )
        ]


NODE_CLASS = AdcsEmulatorNode


def main() -> None:
    """Run the node."""
    run_node(AdcsEmulatorNode)
