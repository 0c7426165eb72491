"""Node `ionosphere_processor`: TEC, scintillation and electron density from a formation."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rosgraph_msgs.msg import Clock

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_iono.bias.bias_files import read_code_biases
from vtff_iono.bias.code_biases import BiasFileError
from vtff_iono.content.slant_tec import SlantTecSettings
from vtff_iono.conversions import (
    block_from_messages,
    boundary_to_message,
    density_to_message,
    scintillation_to_message,
    second_from_messages,
    slant_tec_to_message,
)
from vtff_iono.density.filter.settings import DensitySettings
from vtff_iono.edges.ray_edges import RayEdgeSettings
from vtff_iono.formation_ionosphere import (
    FormationIonosphere,
    FormationResult,
    FormationSettings,
)
from vtff_iono.geometry.satellite_geometry import ELEVATION_MASK_DEG
from vtff_iono.scintillation.indices import ScintillationSettings
from vtff_iono.spacecraft.formation_second import FormationSecond
from vtff_iono.spacecraft.navigation_choice import NavigationChoice
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftIonosphere, SpacecraftSettings
from vtff_iono.synthetic_seconds import process_synthetic_seconds
from vtff_msgs.msg import (
    AmbiguityStatus,
    ElectronDensity,
    GnssEphemeris,
    GnssFix,
    GnssObservations,
    IrregularityBoundary,
    RelativeState,
    Scintillation,
    SlantTec,
    StepDone,
)
from vtff_node import diagnostics
from vtff_node.conversions.gnss import ephemeris_from_message
from vtff_node.epoch_join import EpochJoin, JoinedEpoch
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import ParameterError, parameter
from vtff_node.stamps import StampOrder, to_nanoseconds, to_stamp

LOOK_INTERVAL = 0.02  # s of wall time between looks at seconds that wait for a source


@dataclass(frozen=True)
class IonosphereProcessorParameters:
    """Parameters of `ionosphere_processor`."""

    chief: str = parameter("chief", "name of the spacecraft that the deputies are compared with")
    deputies: list[str] = parameter(["deputy"], "names of the other spacecraft")
    elevation_mask_deg: float = parameter(
        ELEVATION_MASK_DEG,
        "lowest elevation of satellites for contents and density; edges of rays have their own",
        unit="deg",
        minimum=0.0,
        maximum=60.0,
    )
    cn0_minimum_dbhz: float = parameter(
        SlantTecSettings.cn0_minimum_dbhz,
        "signals below this C/N0 are marked and not used",
        unit="dB-Hz",
        minimum=0.0,
    )
    code_sigma: float = parameter(
        SlantTecSettings.pseudorange_sigma, "noise of a pseudorange", unit="m", minimum=1e-3
    )
    phase_sigma: float = parameter(
        SlantTecSettings.carrier_phase_sigma,
        "noise of a carrier phase at the full rate",
        unit="m",
        minimum=1e-5,
    )
    bias_file: str = parameter(
        "", "satellite biases, Bias-SINEX or DCB; empty = those that the satellites broadcast"
    )
    bias_interval: float = parameter(
        SpacecraftSettings.bias_interval,
        "longest time between estimates of the receiver biases",
        unit="s",
        minimum=10.0,
    )
    bias_delay: float = parameter(
        SpacecraftSettings.bias_delay,
        "observations before the first estimate of the receiver biases",
        unit="s",
        minimum=0,
    )
    window: float = parameter(
        ScintillationSettings.window, "window of the scintillation indices", unit="s", minimum=1.0
    )
    phase_cutoff_hz: float = parameter(
        ScintillationSettings.phase_cutoff_hz,
        "high-pass cut-off of sigma-phi; 1 Hz is 7.5 km in low orbit",
        unit="Hz",
        minimum=0.01,
    )
    roti_interval: float = parameter(
        SpacecraftSettings.roti_interval,
        "interval of the rates that ROTI is made of",
        unit="s",
        minimum=0.05,
    )
    irregularity_altitude: float = parameter(
        RayEdgeSettings.irregularity_altitude,
        "altitude at which rays are said to meet an irregularity",
        unit="m",
        minimum=1e5,
    )
    source_nodes: list[str] = parameter(
        [],
        "in lockstep, the receiver drivers of chief and deputies, then the relative navigation of "
        "each deputy: a second is processed without their messages once they have finished the "
        "step",
    )
    patience: float = parameter(
        0.5, "without lockstep, wall time that a second waits for messages", unit="s", minimum=0.0
    )
    lockstep_patience: float = parameter(
        0.2,
        "in lockstep, wall time that a second waits for messages which the end of their step has "
        "overtaken; more where the link to another node loses packets",
        unit="s",
        minimum=0.0,
    )


def formation_settings(parameters: IonosphereProcessorParameters) -> FormationSettings:
    """Return the settings of the algorithms that the parameters of the node stand for."""
    mask = math.radians(parameters.elevation_mask_deg)
    return FormationSettings(
        spacecraft=SpacecraftSettings(
            slant_tec=SlantTecSettings(
                elevation_mask=mask,
                cn0_minimum_dbhz=parameters.cn0_minimum_dbhz,
                pseudorange_sigma=parameters.code_sigma,
                carrier_phase_sigma=parameters.phase_sigma,
            ),
            scintillation=ScintillationSettings(parameters.window, parameters.phase_cutoff_hz),
            roti_interval=parameters.roti_interval,
            bias_interval=parameters.bias_interval,
            bias_delay=parameters.bias_delay,
        ),
        density=DensitySettings(elevation_mask=mask),
        ray_edges=RayEdgeSettings(irregularity_altitude=parameters.irregularity_altitude),
        carrier_phase_sigma=parameters.phase_sigma,
    )


class IonosphereProcessorNode(VtffNode):
    """Computes the ionosphere that a formation observes.

    Subscribes to <craft>/gnss/high_rate, <craft>/gnss/ephemeris and <craft>/gnss/fix of the chief
    and every deputy, <deputy>/ambiguities and <deputy>/relative_state, and /clock. Publishes
    <craft>/iono/slant_tec (SlantTec, TECU, once a second), <craft>/iono/scintillation
    (Scintillation, once a window) and for each deputy <deputy>/iono/electron_density
    (ElectronDensity, electrons/m^3, once a second, stamped with the mean time of the samples) and
    <deputy>/iono/irregularity_boundary (IrregularityBoundary, each edge that the deputy or the
    chief has met once it is confirmed, stamped with the time of its crossing).
    """

    Parameters = IonosphereProcessorParameters
    #: No command waits for it.
    niceness = 0

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("ionosphere_processor", **node_arguments)
        parameters: IonosphereProcessorParameters = self.parameters
        self._crafts = (parameters.chief, *parameters.deputies)
        for name in self._crafts:
            if self._crafts.count(name) > 1:
                raise ParameterError(f"parameter 'deputies': {name!r} is given twice")
        if len(self._crafts) < 2:
            raise ParameterError("parameter 'deputies': at least one name expected")
        self._code_biases = None
        if parameters.bias_file:
            try:
                self._code_biases = read_code_biases(parameters.bias_file)
            except (BiasFileError, OSError) as error:
                raise ParameterError(f"parameter 'bias_file': {error}") from error
        self._formation = self._new_formation()
        self._choice = NavigationChoice()
        self._sources_of_node = self._sources_by_node(parameters.source_nodes)
        waits_for_closing = self.lockstep and bool(parameters.source_nodes)
        sources = [*self._crafts, *map(_fix, self._crafts)]
        for deputy in parameters.deputies:
            sources += _navigation(deputy)
        self._join = EpochJoin(
            sources,
            parameters.lockstep_patience if waits_for_closing else parameters.patience,
            waits_for_closing,
        )
        self._pending: dict[str, list[GnssObservations]] = {craft: [] for craft in self._crafts}
        self._newest = -1
        self._compute_time = 0.0
        self._counts = {"seconds": 0, "seconds with density": 0, "samples": 0}
        self._result: FormationResult | None = None
        self._tec_publishers = [
            self.publisher(SlantTec, f"{craft}/iono/slant_tec") for craft in self._crafts
        ]
        self._scintillation_publishers = [
            self.publisher(Scintillation, f"{craft}/iono/scintillation") for craft in self._crafts
        ]
        self._density_publishers = [
            self.publisher(ElectronDensity, f"{deputy}/iono/electron_density")
            for deputy in parameters.deputies
        ]
        self._boundary_publishers = [
            self.publisher(IrregularityBoundary, f"{deputy}/iono/irregularity_boundary")
            for deputy in parameters.deputies
        ]
        self._subscribe()
        self.create_timer(LOOK_INTERVAL, self._process_complete, clock=self.steady_clock)

    def warm_up(self) -> None:
        """Process the crossing of a plasma wall with another instance."""
        process_synthetic_seconds(FormationIonosphere(formation_settings(self.parameters)))

    def _new_formation(self) -> FormationIonosphere:
        return FormationIonosphere(
            formation_settings(self.parameters), self._code_biases, len(self.parameters.deputies)
        )

    def _sources_by_node(self, nodes: list[str]) -> dict[str, tuple[str, ...]]:
        """Return the sources that are complete once a node has finished the step, by node."""
        deputies = self.parameters.deputies
        if nodes and len(nodes) != len(self._crafts) + len(deputies):
            raise ParameterError(
                f"parameter 'source_nodes' names {len(nodes)} nodes; it must name the receiver "
                f"drivers of {', '.join(self._crafts)} and the relative navigation of "
                f"{', '.join(deputies)}"
            )
        sources = [*((craft, _fix(craft)) for craft in self._crafts), *map(_navigation, deputies)]
        return dict(zip(nodes, sources, strict=False))

    def _subscribe(self) -> None:
        for craft in self._crafts:
            self.subscribe(
                GnssObservations,
                f"{craft}/gnss/high_rate",
                functools.partial(self._on_observations, craft),
            )
            self.subscribe(
                GnssEphemeris, f"{craft}/gnss/ephemeris", self._on_ephemeris, latched=True
            )
            self.subscribe(GnssFix, f"{craft}/gnss/fix", functools.partial(self._add, _fix(craft)))
        for deputy in self.parameters.deputies:
            for message_type, topic, source in zip(
                (AmbiguityStatus, RelativeState),
                (f"{deputy}/ambiguities", f"{deputy}/relative_state"),
                _navigation(deputy),
                strict=True,
            ):
                self.subscribe(
                    message_type,
                    topic,
                    functools.partial(self._on_navigation, deputy, topic, source),
                )
        if self._sources_of_node and self.lockstep:
            self.subscribe(StepDone, "/sim/step_done", self._on_step_done)
        self.subscribe(Clock, "/clock", self._on_clock)

    # ---- input -------------------------------------------------------------------------------

    def _on_ephemeris(self, message: GnssEphemeris) -> None:
        self._formation.add_ephemeris(ephemeris_from_message(message))

    def _on_observations(self, craft: str, message: GnssObservations) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        self._follow(stamp)
        self._pending[craft].append(message)
        # Messages of a topic keep their order: with the last epoch of a second, all have arrived.
        if stamp % NANOSECONDS_PER_SECOND == 0:
            self._join.add(craft, stamp, True, time.monotonic())
            self._process_complete()

    def _add(self, source: str, message: Any) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        if stamp % NANOSECONDS_PER_SECOND == 0:
            self._follow(stamp)
            self._join.add(source, stamp, message, time.monotonic())
            self._process_complete()

    def _on_navigation(self, deputy: str, topic: str, source: str, message: Any) -> None:
        if self.is_of_deputy(message, deputy, topic):
            self._add(source, message)

    def _on_clock(self, message: Clock) -> None:
        stamp = to_nanoseconds(message.clock)
        if stamp % NANOSECONDS_PER_SECOND == 0:
            self._follow(stamp)
            self._join.expect(stamp, time.monotonic())
            self._process_complete()

    def _on_step_done(self, message: StepDone) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        for source in self._sources_of_node.get(message.node, ()):
            self._join.close(source, stamp, time.monotonic())
        self._process_complete()

    def _follow(self, stamp: int) -> None:
        """Start anew when time has jumped back, as in a log that begins again."""
        if stamp < self._newest - StampOrder.JUMP_BACK:
            self.get_logger().warning("time has jumped back: ionosphere processing starts anew")
            self._formation = self._new_formation()
            self._choice = NavigationChoice()
            self._join.restart()
            self._pending = {craft: [] for craft in self._crafts}
            self._newest = -1
        self._newest = max(self._newest, stamp)

    # ---- work --------------------------------------------------------------------------------

    def _process_complete(self) -> None:
        while (epoch := self._join.take(time.monotonic())) is not None:
            self._process(epoch)

    def _process(self, epoch: JoinedEpoch) -> None:
        started = time.perf_counter()
        result = self._formation.process(self._second(epoch))
        self._result = result
        self._counts["seconds"] += 1
        self._counts["seconds with density"] += any(result.density)
        self._publish(result)
        self._compute_time = time.perf_counter() - started
        self.acknowledge_step(to_stamp(epoch.stamp_nanoseconds), started)

    def _second(self, epoch: JoinedEpoch) -> FormationSecond:
        blocks = []
        for craft in self._crafts:
            pending = self._pending[craft]
            # Epochs of the next second may have arrived already.
            count = sum(
                to_nanoseconds(message.header.stamp) <= epoch.stamp_nanoseconds
                for message in pending
            )
            blocks.append(block_from_messages(pending[:count]))
            self._pending[craft] = pending[count:]
            self._counts["samples"] += count
        measured = epoch.measured
        navigation = [_navigation(deputy) for deputy in self.parameters.deputies]
        return second_from_messages(
            GpsTime.from_unix_nanoseconds(epoch.stamp_nanoseconds),
            blocks,
            [measured.get(relative_state) for _, relative_state in navigation],
            [measured.get(ambiguities) for ambiguities, _ in navigation],
            [measured.get(_fix(craft)) for craft in self._crafts],
            self._choice,
        )

    def _publish(self, result: FormationResult) -> None:
        parameters: IonosphereProcessorParameters = self.parameters
        for number, craft in enumerate(self._crafts):
            of_craft = result.spacecraft[number]
            if of_craft.epoch is not None:
                self._tec_publishers[number].publish(slant_tec_to_message(of_craft.epoch, craft))
            for window, roti in of_craft.scintillation:
                self._scintillation_publishers[number].publish(
                    scintillation_to_message(
                        window, roti, parameters.window, parameters.roti_interval, craft
                    )
                )
        for number, deputy in enumerate(parameters.deputies):
            for density in result.density[number]:
                self._density_publishers[number].publish(density_to_message(density, deputy))
            for boundary in result.boundaries[number]:
                craft = deputy if boundary.spacecraft else parameters.chief
                self._boundary_publishers[number].publish(
                    boundary_to_message(boundary, craft, deputy)
                )

    # ---- health ------------------------------------------------------------------------------

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report whether there are contents and densities, and the receiver biases."""
        return [self._ionosphere_status(), self._receiver_bias_status()]

    def _ionosphere_status(self) -> diagnostics.DiagnosticStatus:
        level, text = diagnostics.OK, "contents and density"
        if self._result is None:
            level, text = diagnostics.WARN, "no observations yet"
        elif not all(self._result.density):
            without = [
                deputy
                for deputy, density in zip(
                    self.parameters.deputies, self._result.density, strict=True
                )
                if not density
            ]
            level = diagnostics.WARN
            text = f"no density with {', '.join(without)}: no integers on two signals in common"
        return diagnostics.status(
            f"{self.get_name()}: ionosphere",
            level,
            text,
            {
                **self._counts,
                **{f"seconds without {k}": n for k, n in self._join.incomplete.items()},
                "messages too late": self._join.late,
                "compute time of the last second": self._compute_time,
            },
            hardware_id=self.parameters.chief,
        )

    def _receiver_bias_status(self) -> diagnostics.DiagnosticStatus:
        """Report the receiver biases, and why one is missing or old."""
        spacecraft = dict(zip(self._crafts, self._formation.spacecraft, strict=True))
        level, text = describe_receiver_biases(spacecraft, self.parameters.bias_delay)
        biases = {
            f"receiver bias {craft} {first}-{second} (TECU)": round(bias.bias_tecu, 3)
            for craft, ionosphere in spacecraft.items()
            for (_, first, second), bias in ionosphere.receiver_biases.items()
        }
        return diagnostics.status(
            f"{self.get_name()}: receiver bias",
            level,
            text,
            biases,
            hardware_id=self.parameters.chief,
        )


def describe_receiver_biases(
    spacecraft: Mapping[str, SpacecraftIonosphere], bias_delay: float
) -> tuple[bytes, str]:
    """Return level and text of a diagnostic status of the receiver biases.

    Parameters
    ----------
    spacecraft : mapping of str to SpacecraftIonosphere
        The processing of each spacecraft, by its name.
    bias_delay : float
        Time from the first observation to the first estimate, s.
    """
    missing = [name for name, ionosphere in spacecraft.items() if not ionosphere.receiver_biases]
    errors = [
        f"{name} has {'no receiver bias' if name in missing else 'an old receiver bias'} "
        f"({ionosphere.bias_error})"
        for name, ionosphere in spacecraft.items()
        if ionosphere.bias_error is not None
    ]
    if errors:
        return diagnostics.WARN, "; ".join(errors)
    if missing:
        return diagnostics.OK, (
            f"no receiver bias of {' and '.join(missing)} yet: the first estimate follows "
            f"{bias_delay:g} s after the first observation (parameter 'bias_delay')"
        )
    return diagnostics.OK, "receiver biases estimated"


def _fix(craft: str) -> str:
    return f"{craft} fix"


def _navigation(deputy: str) -> tuple[str, str]:
    """Return the sources of the integers and of the relative state of a deputy."""
    return f"{deputy} ambiguities", f"{deputy} relative state"


NODE_CLASS = IonosphereProcessorNode


def main() -> None:
    """Run the node."""
    run_node(IonosphereProcessorNode)
