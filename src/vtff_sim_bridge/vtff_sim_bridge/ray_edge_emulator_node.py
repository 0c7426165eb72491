"""Node `ray_edge_emulator`: edges and scintillation of rays, emulated from the truth."""

from __future__ import annotations

import functools
import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.time.local_time import mean_solar_local_time_hours
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_msgs.msg import IrregularityBoundary, OrbitState, Scintillation
from vtff_node import diagnostics
from vtff_node.epoch_join import EpochJoin, JoinedEpoch
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.stamps import to_nanoseconds, to_stamp
from vtff_sim_bridge.atmosphere.ray_edge_emulation import (
    EmulatedRayEdge,
    EmulatedScintillation,
    RayEdgeEmulation,
    RayEdgeEmulationSettings,
)
from vtff_sim_bridge.gnss.configuration import load_gnss_configuration


@dataclass(frozen=True)
class RayEdgeEmulatorParameters:
    """Parameters of `ray_edge_emulator`."""

    chief: str = parameter("chief", "name of the chief")
    deputies: list[str] = parameter(REQUIRED, "names of the deputies")
    gnss_file: str = parameter(REQUIRED, "file with the regions of irregular plasma")
    seed: int = parameter(1, "seed of the rays and their errors", minimum=0)
    rays: int = parameter(
        RayEdgeEmulationSettings.rays, "rays of each spacecraft", minimum=2, maximum=60
    )
    time_sigma: float = parameter(
        RayEdgeEmulationSettings.time_sigma, "error of the time of an edge", unit="s", minimum=0.0
    )
    detection: float = parameter(
        RayEdgeEmulationSettings.detection,
        "probability that an edge of a ray is told",
        minimum=0.0,
        maximum=1.0,
    )


class RayEdgeEmulatorNode(VtffNode):
    """Stands in for receivers and ionosphere chain in a software loop; what it tells is emulated.

    Subscribes to /<spacecraft>/truth/orbit of all spacecraft. Publishes
    /<spacecraft>/iono/scintillation (Scintillation, every 10 s) and for each deputy
    /<deputy>/iono/irregularity_boundary (IrregularityBoundary, of the deputy and the chief), as
    `ionosphere_processor` does, from the regions of a GNSS file with drawn errors.
    """

    Parameters = RayEdgeEmulatorParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("ray_edge_emulator", **node_arguments)
        given: RayEdgeEmulatorParameters = self.parameters
        if not given.deputies:
            raise ParameterError("parameter 'deputies': at least one name expected")
        try:
            self._regions = load_gnss_configuration(Path(given.gnss_file)).regions
        except (ValueError, OSError) as error:
            raise ParameterError(f"parameter 'gnss_file': {error}") from error
        self._names = (given.chief, *given.deputies)
        self._emulation: RayEdgeEmulation | None = None
        self._start = 0
        self._told = {"edges": 0, "windows": 0}
        self._join = EpochJoin(self._names, 1.0, waits_for_closing=True)
        self._edge_publishers = {
            name: self.publisher(IrregularityBoundary, f"/{name}/iono/irregularity_boundary")
            for name in given.deputies
        }
        self._window_publishers = {
            name: self.publisher(Scintillation, f"/{name}/iono/scintillation")
            for name in self._names
        }
        for name in self._names:
            self.subscribe(
                OrbitState, f"/{name}/truth/orbit", functools.partial(self._on_orbit, name)
            )

    def _on_orbit(self, name: str, message: OrbitState) -> None:
        self._join.add(name, to_nanoseconds(message.header.stamp), message, time.monotonic())
        epoch = self._join.take(time.monotonic())
        while epoch is not None:
            self._step(epoch)
            epoch = self._join.take(time.monotonic())

    def _step(self, epoch: JoinedEpoch) -> None:
        started = time.perf_counter()
        stamp = epoch.stamp_nanoseconds
        given: RayEdgeEmulatorParameters = self.parameters
        if self._emulation is None:
            self._start = stamp
            self._emulation = RayEdgeEmulation(
                self._regions,
                GpsTime.from_unix_nanoseconds(stamp),
                self._names,
                given.seed,
                RayEdgeEmulationSettings(
                    rays=given.rays, time_sigma=given.time_sigma, detection=given.detection
                ),
            )
        states = {
            name: np.concatenate((message.position, message.velocity))
            for name, message in epoch.measured.items()
        }
        if len(states) == len(self._names):
            seconds = (stamp - self._start) / NANOSECONDS_PER_SECOND
            edges, windows = self._emulation.advance(seconds, states)
            for edge in edges:
                self._publish_edge(edge)
            for window in windows:
                self._publish_window(window)
        self.acknowledge_step(to_stamp(stamp), started)

    def _publish_edge(self, edge: EmulatedRayEdge) -> None:
        stamp = self._start + round(edge.time * NANOSECONDS_PER_SECOND)
        latitude, longitude, altitude = geodetic_from_itrf(edge.position_itrf).tolist()
        message = IrregularityBoundary(
            kind=IrregularityBoundary.KIND_HORIZONTAL,
            source=IrregularityBoundary.SOURCE_S4,
            entry=edge.is_entry,
            system=0,
            prn=edge.ray + 1,
            time_sigma=self.parameters.time_sigma,
            position=edge.position_itrf,
            latitude_deg=float(np.degrees(latitude)),
            longitude_deg=float(np.degrees(longitude)),
            altitude=altitude,
            local_time_hours=mean_solar_local_time_hours(
                GpsTime.from_unix_nanoseconds(stamp), longitude
            ),
            confidence=self.parameters.detection,
            width=math.nan,
            width_sigma=math.nan,
            spacecraft=edge.spacecraft,
        )
        message.header.stamp, message.header.frame_id = to_stamp(stamp), "earth"
        for deputy, publisher in self._edge_publishers.items():
            if edge.spacecraft in (deputy, self.parameters.chief):
                message.child_frame_id = deputy
                publisher.publish(message)
                self._told["edges"] += 1

    def _publish_window(self, window: EmulatedScintillation) -> None:
        assert self._emulation is not None
        count = len(window.s4)
        unknown = np.full(count, np.nan, dtype=np.float32)
        message = Scintillation(
            window=self._emulation.settings.window,
            prn=np.arange(1, count + 1, dtype=np.uint8),
            system=np.zeros(count, dtype=np.uint8),
            band=np.ones(count, dtype=np.uint8),
            attribute=np.full(count, ord("C"), dtype=np.uint8),
            s4=_column(window.s4),
            s4_corrected=_column(window.s4),
            s4_pseudo=unknown,
            sigma_phi=unknown,
            roti_tecu_per_minute=unknown,
            cn0_dbhz=unknown,
            elevation=_column(self._emulation.elevations),
            azimuth=_column(self._emulation.azimuths),
            samples=np.zeros(count, dtype=np.uint32),
        )
        message.header.stamp = to_stamp(self._start + round(window.time * NANOSECONDS_PER_SECOND))
        message.header.frame_id = f"{window.spacecraft}/gnss_antenna"
        self._window_publishers[window.spacecraft].publish(message)
        self._told["windows"] += 1

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report how much was told."""
        return [
            diagnostics.status(
                f"{self.get_name()}: rays", diagnostics.OK, "emulated from the truth", self._told
            )
        ]


def _column(values: FloatArray) -> np.ndarray:
    return np.asarray(values, dtype=np.float32)


NODE_CLASS = RayEdgeEmulatorNode


def main() -> None:
    """Run the node."""
    run_node(RayEdgeEmulatorNode)
