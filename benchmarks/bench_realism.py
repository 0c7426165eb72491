"""Relative navigation in worlds that do not match the filter: RMS, NEES and fixed solutions.

Run with the workspace environment: ``python benchmarks/bench_realism.py [--seconds 900]
[--seeds 1] [--filter robust] [world ...]``; ``--list`` prints the worlds. Each flies
without ROS: truth, controller fed with truth, bytes of both emulated receivers, decoder, and the
filter of `relative_ekf` with its defaults (``robust``: with floors instead of the stated sigmas and
a thrust sigma of 0.05). Errors are 3-D, from 60 s on. NEES is e' P^-1 e over its degrees of
freedom, so 1 is honest; with one seed and slow errors it says little.
"""

from __future__ import annotations

import argparse
import dataclasses
import pathlib
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vtff_analysis.studies.closed_loop import simulate_closed_loop
from vtff_control.tracking.sdre import SdreDesign
from vtff_dynamics.frames.rtn import relative_state_rtn
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.novatel import ReceiverLogStream
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.observations import ObservationEpoch
from vtff_nav.relative.common.estimator_setting import EstimatorSetting
from vtff_nav.relative.common.measurements import MeasurementNoise
from vtff_nav.relative.common.solution import SOLUTION_FIXED, SOLUTION_NONE
from vtff_nav.relative.shipped_estimators import make_cdgps
from vtff_sim_bridge.atmosphere.horizontal_structure import HorizontalGradient
from vtff_sim_bridge.bridge.simgen_link import motion_state
from vtff_sim_bridge.gnss.configuration import (
    GnssConfiguration,
    MultipathModel,
    NoiseModel,
    load_gnss_configuration,
)
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware
from vtff_sim_bridge.receiver.truth_file import TruthFile
from vtff_sim_bridge.simgen.gnss_emulation import ReceiverSet
from vtff_sim_bridge.simremote.motion import VehicleMotion
from vtff_sim_bridge.truth.scenario import Scenario, load_scenario
from vtff_sim_bridge.truth.thruster_errors import ThrusterErrorModel

CONFIG = pathlib.Path(__file__).resolve().parents[1] / "config"
LOGS = b"LOG RANGEB ONTIME 1\r\nLOG GPSEPHEMB ONCHANGED\r\n"
FIRST_SECOND = 60

FILTERS = {
    "default": EstimatorSetting(),
    "robust": EstimatorSetting(
        measurement_noise=MeasurementNoise(0.6, 0.004, False), thrust_sigma=0.05
    ),
}


@dataclass(frozen=True)
class World:
    """World that is flown: files in config/, and changes of their contents."""

    scenario: str = "reference"
    gnss: str = "reference"
    change_scenario: Callable[[Scenario], Scenario] = lambda scenario: scenario
    change_gnss: Callable[[GnssConfiguration], GnssConfiguration] = lambda gnss: gnss


def thrust_errors(scale: float) -> Callable[[Scenario], Scenario]:
    """Return a change that gives the deputy a thruster with errors."""
    model = ThrusterErrorModel(scale, 2.0, 0.01)

    def change(scenario: Scenario) -> Scenario:
        chief, *deputies = scenario.spacecraft
        return dataclasses.replace(
            scenario,
            spacecraft=(
                chief,
                *(dataclasses.replace(deputy, thruster_errors=model) for deputy in deputies),
            ),
        )

    return change


def exact_thrust(scenario: Scenario) -> Scenario:
    """Return a scenario whose thrusters give what they report."""
    spacecraft = tuple(
        dataclasses.replace(craft, thruster_errors=None) for craft in scenario.spacecraft
    )
    return dataclasses.replace(scenario, spacecraft=spacecraft)


def receivers(**changes: object) -> Callable[[GnssConfiguration], GnssConfiguration]:
    """Return a change of fields of every receiver."""

    def change(gnss: GnssConfiguration) -> GnssConfiguration:
        return dataclasses.replace(
            gnss,
            receivers=tuple(
                dataclasses.replace(receiver, **changes)  # type: ignore[arg-type]
                for receiver in gnss.receivers
            ),
        )

    return change


def multipath(phase_sigma: float, code_sigma: float) -> Callable[..., GnssConfiguration]:
    """Return a change that adds Gauss-Markov multipath of 100 s."""
    return receivers(multipath=MultipathModel(code_sigma=code_sigma, phase_sigma=phase_sigma))


def gradient(tecu_per_deg: float) -> Callable[[GnssConfiguration], GnssConfiguration]:
    """Return a change that adds a gradient along the first track, towards north-east."""
    structure = HorizontalGradient(tecu_per_deg, 30.0, 700e3, extent_deg=60.0)
    return lambda gnss: dataclasses.replace(gnss, structures=(structure,))


def broadcast_errors(gnss: GnssConfiguration) -> GnssConfiguration:
    """Return a configuration with drifting errors of 1.5 m of orbits and clocks."""
    constellation = dataclasses.replace(
        gnss.constellation,
        orbit_error_sigma=1.5,
        clock_error_sigma=1.5,
        error_correlation_time=21600.0,
    )
    return dataclasses.replace(gnss, constellation=constellation)


def at_5km(scenario: Scenario) -> Scenario:
    """Return the reference scenario with the orbits and the target of realistic_5km."""
    far = load_scenario(CONFIG / "scenario/realistic_5km.yaml")
    spacecraft = tuple(
        dataclasses.replace(craft, force_model=None, thruster_errors=None)
        for craft in far.spacecraft
    )
    return dataclasses.replace(scenario, spacecraft=spacecraft)


SINUSOID = MultipathModel(code_amplitude=0.5, phase_amplitude=0.005, period=120.0)
OPTIMISTIC = NoiseModel("fixed", 0.6, 0.003, 0.01, stated_sigma_factor=1.0 / 3.0)
WORLDS = {
    "ideal": World(),
    "ideal_5km": World(change_scenario=at_5km),
    "thrust_1.05": World(change_scenario=thrust_errors(1.05)),
    "thrust_0.95": World(change_scenario=thrust_errors(0.95)),
    "forces": World("realistic", change_scenario=exact_thrust),
    "forces_5km": World("realistic_5km", change_scenario=exact_thrust),
    "broadcast": World(change_gnss=broadcast_errors),
    "broadcast_5km": World(change_scenario=at_5km, change_gnss=broadcast_errors),
    "multipath_1mm": World(change_gnss=multipath(0.001, 0.1)),
    "multipath_2mm": World(change_gnss=multipath(0.002, 0.2)),
    "multipath_5mm": World(change_gnss=multipath(0.005, 0.5)),
    "multipath_sinusoid": World(change_gnss=receivers(multipath=SINUSOID)),
    "stated_third": World(change_gnss=receivers(noise=OPTIMISTIC)),
    "gradient_0.5_5km": World(change_scenario=at_5km, change_gnss=gradient(0.5)),
    "gradient_2_5km": World(change_scenario=at_5km, change_gnss=gradient(2.0)),
    "realistic": World("realistic", "realistic"),
    "realistic_5km": World("realistic_5km", "realistic"),
}


@dataclass(frozen=True)
class Flight:
    """Errors of a flight from `FIRST_SECOND` on, one row a second."""

    error: FloatArray
    sigma: FloatArray
    nees_position: FloatArray
    nees_velocity: FloatArray
    is_fixed: FloatArray
    has_solution: FloatArray


def fly(world: World, seconds: int, seed: int, setting: EstimatorSetting) -> Flight:
    """Fly a world with a filter."""
    scenario = dataclasses.replace(
        world.change_scenario(load_scenario(CONFIG / f"scenario/{world.scenario}.yaml")),
        seed=seed,
        duration=float(seconds),
    )
    gnss = load_gnss_configuration(CONFIG / f"gnss/{world.gnss}.yaml")
    gnss = dataclasses.replace(world.change_gnss(gnss), seed=seed)
    design = SdreDesign("delay_aware", acceleration_cap=1.4)
    thrust_rtn = simulate_closed_loop(scenario, design).deputy().applied_rtn
    chief, deputy = scenario.spacecraft[0].name, scenario.spacecraft[1].name
    truth, rig = scenario.formation_truth(), Receivers(gnss, scenario)
    estimator = make_cdgps(setting)
    rows = []
    for second in range(seconds):
        for name, motion in zip((chief, deputy), rig.vehicles.values(), strict=True):
            applied = thrust_rtn[second] if name == deputy else None
            motion.command(second * 10**9, motion_state(truth.motion_itrf(name, applied)))
        chief_epoch, deputy_epoch = rig.advance(second, estimator.add_ephemeris)
        solution = estimator.process(truth.time, chief_epoch, deputy_epoch)
        estimator.add_thrust(truth.time, 1.0, thrust_rtn[second])
        states = truth.state_gcrf(chief), truth.state_gcrf(deputy)
        if second >= FIRST_SECOND:
            estimate = np.concatenate((solution.position_rtn, solution.velocity_rtn))
            error, covariance = estimate - relative_state_rtn(*states), solution.covariance_rtn
            has_solution = solution.solution != SOLUTION_NONE and bool(np.isfinite(error).all())
            nees = [
                error[axes] @ np.linalg.solve(covariance[axes, axes], error[axes]) / 3.0
                if has_solution
                else np.nan
                for axes in (slice(0, 3), slice(3, 6))
            ]
            sigma = float(np.sqrt(np.trace(covariance[:3, :3])))
            is_fixed = solution.solution == SOLUTION_FIXED
            rows.append((np.linalg.norm(error[:3]), sigma, *nees, is_fixed, has_solution))
        truth.advance({deputy: thrust_rtn[second]})
    return Flight(*np.array(rows, dtype=float).T)


class Receivers:
    """Both emulated receivers, and decoders of what they send."""

    def __init__(self, gnss: GnssConfiguration, scenario: Scenario) -> None:
        firmware = {
            receiver.name: ReceiverFirmware(settings=HeaderSettings(generation=receiver.generation))
            for receiver in gnss.receivers
        }
        for emulated in firmware.values():
            emulated.receive(LOGS)
        motion = scenario.formation_truth().motion_itrf(scenario.chief.name)
        end = scenario.epoch + scenario.duration
        self._set = ReceiverSet(
            gnss, firmware, scenario.epoch, end, motion[:2].ravel(), TruthFile(None)
        )
        self._streams = {name: ReceiverLogStream() for name in firmware}
        self.vehicles = {receiver.vehicle: VehicleMotion() for receiver in gnss.receivers}

    def advance(
        self, second: int, add_ephemeris: Callable[[BroadcastEphemeris], None]
    ) -> list[ObservationEpoch | None]:
        """Return the epochs of a second; ephemerides go to `add_ephemeris`."""
        sent: dict[str, bytearray] = {name: bytearray() for name in self._streams}
        self._set.advance(
            second * 10**9, self.vehicles.__getitem__, lambda name, new: sent[name].extend(new)
        )
        for motion in self.vehicles.values():
            motion.forget_before(second * 10**9)
        epochs: list[ObservationEpoch | None] = []
        for name, stream in self._streams.items():
            epoch = None
            for event in stream.feed(bytes(sent[name])):
                if isinstance(event, ObservationEpoch):
                    epoch = event
                elif isinstance(event, BroadcastEphemeris):
                    add_ephemeris(event)
            epochs.append(epoch)
        return epochs


def describe(flights: list[Flight]) -> str:
    """Return the figures of flights of one world."""
    error = np.concatenate([flight.error for flight in flights])
    rms, largest = np.sqrt(np.nanmean(error**2)) * 1e3, np.nanmax(error) * 1e3
    sigma = np.sqrt(np.nanmean(np.concatenate([f.sigma for f in flights]) ** 2)) * 1e3
    position = np.nanmean([np.nanmean(flight.nees_position) for flight in flights])
    velocity = np.nanmean([np.nanmean(flight.nees_velocity) for flight in flights])
    fixed = 100.0 * np.mean([flight.is_fixed.mean() for flight in flights])
    absent = 100.0 * np.mean([1.0 - flight.has_solution.mean() for flight in flights])
    return (
        f"{rms:9.2f} {largest:9.2f} {sigma:9.2f} {position:8.2f} {velocity:8.2f} {fixed:7.1f} "
        f"{absent:6.1f}"
    )


def main() -> int:
    """Fly the worlds and print their figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("worlds", nargs="*", help="worlds to fly, all by default; see --list")
    parser.add_argument("--seconds", type=int, default=900, help="length of a flight (900)")
    parser.add_argument("--seeds", type=int, default=1, help="flights of each world (1)")
    parser.add_argument("--filter", action="append", choices=FILTERS, help="default or robust")
    parser.add_argument("--list", action="store_true", help="print the worlds and end")
    given = parser.parse_args()
    if given.list:
        print("\n".join(WORLDS))
        return 0
    unknown = sorted(set(given.worlds) - set(WORLDS))
    if unknown or given.seconds <= FIRST_SECOND or given.seeds < 1:
        wrong = f"world {unknown[0]!r}" if unknown else "--seconds above 60 and --seeds above 0"
        print(f"bench_realism.py: {wrong}: see --list and --help", file=sys.stderr)
        return 2
    print(
        f"{given.seconds} s, {given.seeds} seed(s), errors in mm from {FIRST_SECOND} s on\n"
        f"{'world':<20} {'filter':<8} {'RMS':>9} {'largest':>9} {'sigma':>9} {'NEES r':>8} "
        f"{'NEES v':>8} {'fixed %':>7} {'none %':>6}"
    )
    for name in given.worlds or WORLDS:
        for label in given.filter or ["default"]:
            flights = [
                fly(WORLDS[name], given.seconds, seed, FILTERS[label])
                for seed in range(1, given.seeds + 1)
            ]
            print(f"{name:<20} {label:<8} {describe(flights)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
