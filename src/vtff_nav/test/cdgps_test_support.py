"""Runs of the relative filter on epochs of the emulated receivers.

The satellites are those of the built-in nominal constellations, so that the tests need no file.
"""

from __future__ import annotations

import dataclasses
import pathlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from cdgps_truth_support import TruthRecorder

from vtff_dynamics.frames.earth import kinematics_itrf, rotation_gcrf_to_itrf
from vtff_dynamics.frames.rtn import relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.novatel import ReceiverLogStream
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)
from vtff_gnss.rinex.navigation import read_rinex_navigation
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.common.dynamics import MotionNoise
from vtff_nav.relative.common.solution import SOLUTION_FIXED, LaserMeasurement, RelativeSolution
from vtff_sim_bridge.atmosphere.electron_density import ElectronDensityProfile
from vtff_sim_bridge.atmosphere.horizontal_structure import TravellingDisturbance
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion
from vtff_sim_bridge.gnss.configuration import (
    ConstellationConfiguration,
    GnssConfiguration,
    NoiseModel,
    TrackingModel,
    load_gnss_configuration,
)
from vtff_sim_bridge.gnss.faults import Fault
from vtff_sim_bridge.gnss.receiver_clock import ClockModel
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware
from vtff_sim_bridge.simgen.gnss_emulation import ReceiverSet
from vtff_sim_bridge.simremote.motion import MotionState, VehicleMotion

REPOSITORY = pathlib.Path(__file__).resolve().parents[3]
# Twelve GPS satellites of the nominal constellation are in view: one for each channel.
START = parse_epoch("2023-01-08T11:00:00 GPS")

# Initial states of paper 004 (Oh et al. 2016), m and m/s.
CHIEF = np.array([6930000.0, 0.0, 0.0, 0.0, 3810.947, 6600.754])
DEPUTY_250M = np.array([6930250.0, 0.0, 0.0, 0.0, 3810.815, 6600.525])
DEPUTY_5KM = np.array([6935000.0, 0.0, 0.0, 0.0, 3808.307, 6596.182])
J2 = ForceModel(degree=2, order=0)

# Seed of the noise of the laser in `fly`, a draw for each second.
LASER_SEED = 3

L1 = {0: (1,)}
L1_L2 = {0: (1, 2)}
BIASES = (
    {"G1C": 0.0, "G2W": 1.2, "G5Q": -0.8, "E1C": 0.4, "E5Q": -1.1},
    {"G1C": 0.0, "G2W": -0.9, "G5Q": 0.5, "E1C": -0.6, "E5Q": 0.9},
)
SIGNALS = {"G1C": 48.0, "G2W": 42.0}
NOMINAL = "nominal"


def broadcast_ephemerides(
    start: GpsTime, seconds: float, source: str = NOMINAL
) -> Sequence[BroadcastEphemeris]:
    """Return the ephemerides of GPS and Galileo satellites, or those of a navigation file."""
    if source != NOMINAL:
        return read_rinex_navigation(source).ephemerides
    end = start + seconds
    return (*nominal_gps_constellation(start, end), *nominal_galileo_constellation(start, end))


def configuration(**changes: object) -> CdgpsConfiguration:
    """Return a configuration for the orbits of this module, all of whose forces are known."""
    known = {"force_model": J2, "bands": L1_L2, "noise_relative": MotionNoise(5e-8)}
    return CdgpsConfiguration(**{**known, **changes})


@dataclass
class Scenario:
    """Epochs of two emulated receivers, and the truth; element k is that of second k."""

    start: GpsTime
    chief: dict[GpsTime, ObservationEpoch]
    deputy: dict[GpsTime, ObservationEpoch]
    chief_gcrf: np.ndarray
    deputy_gcrf: np.ndarray
    thrust_rtn: np.ndarray
    ephemerides: Sequence[BroadcastEphemeris]
    truth: TruthRecorder

    def until(self, seconds: int) -> Scenario:
        """Return the scenario of the first seconds only."""
        return dataclasses.replace(
            self, chief_gcrf=self.chief_gcrf[:seconds], deputy_gcrf=self.deputy_gcrf[:seconds]
        )

    def always_tracked(self) -> list[str]:
        """Return the satellites that the chief tracks from second 30 to the end, by name."""
        last = len(self.chief_gcrf) - 1
        ends = (self.truth.slant_tec_tecu["chief", second] for second in (30, last))
        return sorted(set.intersection(*map(set, ends)))


def simulate(
    seconds: int,
    deputy: np.ndarray = DEPUTY_250M,
    seed: int = 1,
    profile: ElectronDensityProfile | None = None,
    faults: Sequence[Fault] = (),
    thrust_rtn: Callable[[int], Sequence[float]] | None = None,
    signals: dict[str, float] = SIGNALS,
    empirical_sigma: tuple[float, float] = (0.0, 0.0),
    regions: Sequence[IrregularityRegion] = (),
    constellation: str = NOMINAL,
    start: GpsTime = START,
    receiver_changes: Mapping[str, object] | None = None,
    structures: Sequence[TravellingDisturbance] = (),
) -> Scenario:
    """Simulate both receivers at 1 Hz: 1 mm and 0.3 m noise, steered clocks, receiver biases.

    Parameters
    ----------
    seconds : int
        Number of epochs.
    deputy : ndarray, shape (6,)
    seed : int
    profile : ElectronDensityProfile, optional
    faults : sequence of Fault
    thrust_rtn : callable, optional
        Thrust of the deputy over the second k, m/s2.
    signals : dict
        See `ReceiverConfiguration.cn0_zenith_dbhz`.
    empirical_sigma : tuple of 2 float
        Gauss-Markov accelerations of the chief and of the difference, m/s2, 900 s.
    regions : sequence of IrregularityRegion
        Where signals scintillate.
    constellation : str
        See `ConstellationConfiguration.source`.
    start : GpsTime
        Time of the initial states.
    receiver_changes : mapping, optional
        Fields of `ReceiverConfiguration` that both receivers have instead.
    structures : sequence of TravellingDisturbance
        Waves of the plasma.
    """
    random = np.random.default_rng(1000 + seed)
    crafts = [Propagator(start, state, J2) for state in (CHIEF, deputy)]
    empirical = [sigma * random.standard_normal(3) for sigma in empirical_sigma]
    decay = np.exp(-1.0 / 900.0)
    motions, states, thrusts = [], ([], []), []
    for second in range(seconds):
        to_gcrf = rotation_gcrf_to_rtn(crafts[0].state_gcrf).T
        thrust = np.zeros(3) if thrust_rtn is None else np.asarray(thrust_rtn(second), float)
        accelerations = [to_gcrf @ empirical[0], to_gcrf @ (thrust + empirical[0] + empirical[1])]
        step = []
        for craft, acceleration, kept in zip(crafts, accelerations, states, strict=True):
            state = craft.state_gcrf
            kept.append(state)
            total = craft.acceleration_gcrf() + acceleration
            motion = kinematics_itrf(craft.time, state[:3], state[3:], total, craft.jerk_gcrf())
            step.append(MotionState(*(tuple(row.tolist()) for row in motion)))
            craft.advance(acceleration if acceleration.any() else None)
        motions.append(step)
        thrusts.append(thrust)
        for craft, sigma in enumerate(empirical_sigma):
            noise = sigma * np.sqrt(1.0 - decay**2) * random.standard_normal(3)
            empirical[craft] = decay * empirical[craft] + noise
    truth = TruthRecorder()
    emulation = ReceiverEmulation(
        seed, profile, faults, signals, regions, constellation, receiver_changes or {}, structures
    )
    chief, deputy_epochs = emulation.receive(motions, start, truth)
    return Scenario(
        start=start,
        chief=chief,
        deputy=deputy_epochs,
        chief_gcrf=np.array(states[0]),
        deputy_gcrf=np.array(states[1]),
        thrust_rtn=np.array(thrusts),
        ephemerides=broadcast_ephemerides(start, seconds, constellation),
        truth=truth,
    )


@dataclass(frozen=True)
class ReceiverEmulation:
    """Settings of both emulated receivers; see `simulate`."""

    seed: int
    profile: ElectronDensityProfile | None
    faults: Sequence[Fault]
    signals: dict[str, float]
    regions: Sequence[IrregularityRegion]
    constellation: str
    receiver_changes: Mapping[str, object]
    structures: Sequence[TravellingDisturbance]

    def receive(
        self, motions: list[list[MotionState]], start: GpsTime, truth: TruthRecorder
    ) -> list[dict[GpsTime, ObservationEpoch]]:
        """Return the epochs that a decoder reads from the bytes of both receivers."""
        configuration = self._configuration()
        emulated = {
            receiver.name: ReceiverFirmware(settings=HeaderSettings(generation=receiver.generation))
            for receiver in configuration.receivers
        }
        for receiver in emulated.values():
            receiver.receive(b"LOG RANGEB ONTIME 1\r\n")
        first = np.array(motions[0][0].position_itrf + motions[0][0].velocity_itrf)
        end = start + float(len(motions) - 1)
        receiver_set = ReceiverSet(configuration, emulated, start, end, first, truth)
        content = {name: bytearray() for name in emulated}
        vehicles = {"v1_m1": VehicleMotion(), "v2_m1": VehicleMotion()}
        for second, step in enumerate(motions):
            time = second * 10**9
            for vehicle, state in zip(vehicles.values(), step, strict=True):
                vehicle.command(time, state)
            receiver_set.advance(
                time, vehicles.__getitem__, lambda name, sent: content[name].extend(sent)
            )
            for vehicle in vehicles.values():
                vehicle.forget_before(time)
        return [epochs_of(bytes(content[name])) for name in ("chief", "deputy")]

    def _configuration(self) -> GnssConfiguration:
        loaded = load_gnss_configuration(REPOSITORY / "config/gnss/noise_free.yaml")
        receivers = tuple(
            dataclasses.replace(
                receiver,
                **{
                    "cn0_zenith_dbhz": self.signals,
                    "noise": NoiseModel(
                        model="fixed", code_sigma=0.3, phase_sigma=0.001, doppler_sigma=0.01
                    ),
                    "clock": ClockModel(oscillator="TCXO", initial_offset=offset, is_steered=True),
                    "tracking": TrackingModel(
                        channels=12, threshold_dbhz=0.0, elevation_mask_deg=5.0
                    ),
                    "biases": {name: bias for name, bias in biases.items() if name in self.signals},
                    **self.receiver_changes,
                },
            )
            for receiver, offset, biases in zip(
                loaded.receivers, (-3e-8, 3e-8), BIASES, strict=True
            )
        )
        return dataclasses.replace(
            loaded,
            seed=self.seed,
            receivers=receivers,
            constellation=ConstellationConfiguration(source=self.constellation),
            profile=self.profile,
            regions=tuple(self.regions),
            structures=tuple(self.structures),
            faults=tuple(self.faults),
        )


def epochs_of(content: bytes) -> dict[GpsTime, ObservationEpoch]:
    """Return the observations in the bytes of a receiver by their time tag."""
    events = ReceiverLogStream().feed(content)
    return {event.time: event for event in events if isinstance(event, ObservationEpoch)}


@dataclass
class Flight:
    """Solutions of a run and their errors, one row for each second."""

    solutions: list[RelativeSolution]
    error_itrf: np.ndarray
    error_rtn: np.ndarray
    error_chief: np.ndarray

    @property
    def error(self) -> np.ndarray:
        """3-D position errors, m."""
        return np.linalg.norm(self.error_itrf, axis=1)

    def rms(self, first: int = 60) -> float:
        """3-D RMS from a second on, m."""
        return float(np.sqrt(np.mean(self.error[first:] ** 2)))

    def velocity_rms(self, first: int = 60) -> float:
        """3-D RMS of the relative velocity from a second on, m/s."""
        return float(np.sqrt(np.mean(np.sum(self.error_rtn[first:, 3:] ** 2, axis=1))))

    @property
    def is_fixed(self) -> np.ndarray:
        """Whether each epoch is a fixed solution."""
        return np.array([s.solution == SOLUTION_FIXED for s in self.solutions])

    def until(self, seconds: int) -> Flight:
        """Return the flight of the first seconds only."""
        return Flight(
            self.solutions[:seconds],
            self.error_itrf[:seconds],
            self.error_rtn[:seconds],
            self.error_chief[:seconds],
        )

    def normalised_squares(self) -> np.ndarray:
        """e' P^-1 e of the position of each epoch."""
        return np.array(
            [
                e @ np.linalg.solve(s.covariance_position_itrf, e)
                for e, s in zip(self.error_itrf, self.solutions, strict=True)
            ]
        )


@dataclass(frozen=True)
class Laser:
    """An emulated laser between the spacecraft: sigma (m) and latency (s)."""

    sigma: float
    latency: float = -5.15e-3

    def measure(
        self, time: GpsTime, difference: np.ndarray, random: np.random.Generator
    ) -> LaserMeasurement:
        """Return the range of a relative state (6,), late and noisy."""
        distance = float(np.linalg.norm(difference[:3]))
        rate = float(difference[:3] @ difference[3:]) / distance
        noise = self.sigma * float(random.standard_normal())
        return LaserMeasurement(time, distance + self.latency * rate + noise, self.sigma)


def fly(
    scenario: Scenario,
    parameters: CdgpsConfiguration,
    knows_thrust: bool = True,
    laser: Laser | None = None,
) -> Flight:
    """Run the filter over a scenario."""
    random = np.random.default_rng(LASER_SEED)
    estimator = CdgpsEstimator(parameters, scenario.ephemerides)
    solutions, itrf, rtn, chief_errors = [], [], [], []
    for second in range(len(scenario.chief_gcrf)):
        time = scenario.start + float(second)
        chief, deputy = scenario.chief_gcrf[second], scenario.deputy_gcrf[second]
        measurement = None if laser is None else laser.measure(time, deputy - chief, random)
        solution = estimator.process(
            time, scenario.chief.get(time), scenario.deputy.get(time), measurement
        )
        if knows_thrust:
            estimator.add_thrust(time, 1.0, scenario.thrust_rtn[second])
        truth = relative_state_rtn(chief, deputy)
        solutions.append(solution)
        to_itrf = rotation_gcrf_to_itrf(time)
        itrf.append(solution.position_itrf - to_itrf @ (deputy - chief)[:3])
        estimate = np.concatenate((solution.position_rtn, solution.velocity_rtn))
        rtn.append(estimate - truth)
        chief_errors.append(solution.position_chief_gcrf - chief[:3])
    return Flight(solutions, np.array(itrf), np.array(rtn), np.array(chief_errors))
