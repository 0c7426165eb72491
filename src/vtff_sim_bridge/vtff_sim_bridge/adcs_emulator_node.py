"""Node `adcs_emulator`: the ADCS module of a spacecraft as its CAN bus shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_msgs.msg import AdcsReport
from vtff_node import diagnostics
from vtff_node.can_bus.node_bus import (
    CanBusParameters,
    bus_status,
    connect_first,
    read_database,
)
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import parameter
from vtff_node.stamps import to_nanoseconds
from vtff_sim_bridge.attitude.adcs_bus import AdcsBus, AdcsModulePort


@dataclass(frozen=True)
class AdcsEmulatorParameters(CanBusParameters):
    """Parameters of `adcs_emulator`."""

    channel: str = parameter("239.74.163.3", "bus of that interface, as can0 or a multicast group")
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
        limits = (given.longest_pulse, given.largest_wheel_speed_rpm)
        self._port = read_database(lambda file: AdcsModulePort(file, *limits), given.dbc_file)
        self._bus = AdcsBus(self._port, given.open_bus)
        connect_first(self._bus.start)
        self._first_stamp = -1
        self._reports = 0
        self.subscribe(AdcsReport, "adcs/module_report", self._on_report)

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
        state = diagnostics.OK, "on the bus"
        if self._bus.is_off:
            state = diagnostics.WARN, "off the bus, as told"
        values = {
            "reports": self._reports,
            "commands": self._port.commands,
            "rejected frames": self._port.rejected_frames,
        }
        subject = f"{self.get_name()}: bus"
        return [bus_status(subject, self.parameters, self._bus.problem, state, values)]


NODE_CLASS = AdcsEmulatorNode


def main() -> None:
    """Run the node."""
    run_node(AdcsEmulatorNode)
