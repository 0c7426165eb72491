"""The worlds of `bench_realism.py`: what flies, what receivers see, and what runs must show."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import pathlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from plasma.worlds import PlasmaWorld, draw_bubble_world

from vtff_analysis.studies.navigation_bound import PhaseNoise
from vtff_dynamics.frames.rtn import relative_state_rtn
from vtff_gnss.antex import PhaseCentre, PhaseCentreMap, read_antex
from vtff_gnss.constants import SYSTEM_GPS
from vtff_gnss.orbits.line_of_sight import ellipsoid_normal
from vtff_nav.relative.common.antenna_correction import Antenna, AntennaPair
from vtff_nav.relative.common.estimator_setting import EstimatorSetting
from vtff_sim_bridge.atmosphere.horizontal_structure import HorizontalGradient
from vtff_sim_bridge.gnss.configuration import (
    GnssConfiguration,
    MultipathModel,
    NoiseModel,
    load_gnss_configuration,
)
from vtff_sim_bridge.gnss.faults import Fault
from vtff_sim_bridge.truth.drawn_geometry import GeometryDraw
from vtff_sim_bridge.truth.scenario import Scenario, load_scenario, state_ahead_on_orbit
from vtff_sim_bridge.truth.thruster_errors import ThrusterErrorModel

__all__ = ["FIRST_SECOND", "KEEPING_SECOND", "WORLDS", "Must", "RangeErrors", "World"]

CONFIG = pathlib.Path(__file__).resolve().parents[2] / "config"
KEEPING_SECOND = 600
"""Keeping counts from here on, s."""
FIRST_SECOND = 60
"""Errors count from here on, s: before, the filter starts."""

_FIRST_BUBBLE, _DEEP_S4 = 901, 0.7

Change = Callable[[GnssConfiguration], GnssConfiguration]
Motion = Literal["scenario", "kept", "free", "closed_loop"]

_DRAW = GeometryDraw(epoch_days=1.0, node=True, place_on_orbit=True)
# Galileo is not tracked in reference.yaml, so that the seed of the constellation draws GPS alone.
_NEES_OK = (0.5, 1.5)


@dataclass(frozen=True)
class Must:
    """What the flights of a world must show together.

    Parameters
    ----------
    rms_mm : float or None
        Largest RMS of the error of position, 3-D, mm.
    worst_rms_mm : float or None
        Largest RMS of a single flight, mm; `rms_mm` then holds for the median of the flights.
    fixed_percent : float or None
        Smallest share of fixed solutions.
    nees : tuple of 2 float or None
        Interval of the mean NEES, of position and velocity each.
    degraded_percent : float or None
        Largest share of solutions that say that something is wrong.
    recovery_s : float or None
        Longest time from the end of an outage to a fixed solution, s.
    keeping_mm : float or None
        Largest RMS distance from the target from `KEEPING_SECOND` on, each axis, mm.
    keeping_dv_per_hour : float or None
        Largest sum of velocity changes, all axes, from then on, m/s per hour.
    closest : float or None
        Smallest distance from the chief, m.
    dv : float or None
        Largest sum of velocity changes of a flight, all axes, m/s.
    last_minute : float or None
        Largest distance from the target in the last minute, m.
    has_true_integers : bool
        Whether no integer may be wrong for long; False where the emulated phases themselves wind up
        cycles in fades.
    is_honest_in_outages : bool
        Whether `nees` holds in outages, too. With exact thrust a prediction through a burn is far
        better than a filter may state that allows for errors of thrust.
    """

    rms_mm: float | None = None
    worst_rms_mm: float | None = None
    fixed_percent: float | None = None
    nees: tuple[float, float] | None = _NEES_OK
    degraded_percent: float | None = 5.0
    recovery_s: float | None = None
    keeping_mm: float | None = None
    keeping_dv_per_hour: float | None = None
    closest: float | None = None
    dv: float | None = None
    last_minute: float | None = None
    has_true_integers: bool = True
    is_honest_in_outages: bool = False


@dataclass(frozen=True)
class RangeErrors:
    """Errors of the chief's ranges in a covariance bound.

    Parameters
    ----------
    code_sigma : float
        White noise of a code, m.
    signal_bias_sigma : float
        Ionosphere-free bias of the codes of a satellite, m.
    broadcast_sigma : float
        Broadcast orbits (each axis) and clocks, m.
    broadcast_time : float
        Their correlation time, s.
    """

    code_sigma: float = 0.3
    signal_bias_sigma: float = 0.25
    broadcast_sigma: float = 0.0
    broadcast_time: float = 21600.0


@dataclass(frozen=True)
class WhiteNoise:
    """White noise of one receiver, m; both receivers have the same, and nothing slower.

    Parameters
    ----------
    phase_sigma, code_sigma : float
        Of phases and codes.
    broadcast_sigma : float
        Errors of the positions of satellites on each axis.
    """

    phase_sigma: float = 0.001
    code_sigma: float = 0.3
    broadcast_sigma: float = 0.0


@dataclass(frozen=True)
class World:
    """What is flown: files in config/, changes to what they hold, and what the flights must show.

    Parameters
    ----------
    scenario, gnss : str
        Names of files in config/scenario and config/gnss.
    distance : float or None
        The deputy is that far ahead on the orbit of the chief, m; None: as the scenario says.
    motion : {"scenario", "kept", "free", "closed_loop"}
        The controller, fed with truth, flies to the target of the scenario or keeps the first
        relative position; or there is no thrust; or the controller of the shipped systems flies to
        the target of the scenario, fed by the filter.
    draws_geometry : bool
        Epoch, node, place on the orbit and constellation come from the seed.
    seconds : int
        Length of a flight, s.
    interval : int
        Time between the epochs that the filter gets, s.
    change_scenario, change_gnss : callable
        Applied to the contents of the files.
    gradient_tecu_per_deg : float
        Growth of the vertical TEC along the track of the chief, for each degree over ground.
    change_setting : callable
        Applied to the parameters of the filter. By default antennas are stated to be ideal, as in
        config/system/reference.yaml.
    outages : tuple of (float, float)
        Times between which there are no measurements, and 30 s after: their errors do not count
        in the RMS, and NEES within is printed apart.
    phase_noise : PhaseNoise or None
        Noise for which the covariance bound is computed.
    ranges : RangeErrors
        Errors of the chief's ranges in that bound.
    white_noise : WhiteNoise or None
        Noise for which the NEES is predicted, where that is all the noise there is.
    must : Must
    """

    scenario: str = "reference"
    gnss: str = "reference"
    distance: float | None = 250.0
    motion: Motion = "kept"
    draws_geometry: bool = True
    seconds: int = 900
    interval: int = 1
    change_scenario: Callable[[Scenario], Scenario] = lambda scenario: scenario
    change_gnss: Change = lambda gnss: gnss
    gradient_tecu_per_deg: float = 0.0
    change_setting: Callable[[EstimatorSetting], EstimatorSetting] = lambda setting: (
        dataclasses.replace(setting, antennas=None)
    )
    outages: tuple[tuple[float, float], ...] = ()
    phase_noise: PhaseNoise | None = None
    ranges: RangeErrors = RangeErrors()
    white_noise: WhiteNoise | None = None
    must: Must = field(default_factory=Must)

    @property
    def has_real_gravity(self) -> bool:
        """Whether gravity acts beyond the degree that the filter knows."""
        return self.scenario.startswith("realistic")

    def make(self, seed: int, seconds: int | None) -> tuple[Scenario, GnssConfiguration]:
        """Return scenario and receivers of a flight; `seconds` replaces its length."""
        scenario = load_scenario(CONFIG / f"scenario/{self.scenario}.yaml")
        scenario = dataclasses.replace(scenario, seed=seed, duration=float(seconds or self.seconds))
        scenario = self.change_scenario(scenario)
        chief, *deputies = scenario.spacecraft
        if self.distance is not None:
            state = state_ahead_on_orbit(chief.state_gcrf, self.distance)
            deputies = [dataclasses.replace(craft, state_gcrf=state) for craft in deputies]
        gnss = load_gnss_configuration(CONFIG / f"gnss/{self.gnss}.yaml")
        gnss = self.change_gnss(dataclasses.replace(gnss, seed=seed))
        if self.draws_geometry:
            drawn, first = _DRAW.draw(seed), chief.state_gcrf
            chief, *deputies = (
                dataclasses.replace(craft, state_gcrf=drawn.turned(craft.state_gcrf, first))
                for craft in (chief, *deputies)
            )
            scenario = dataclasses.replace(scenario, epoch=scenario.epoch + float(drawn.delay))
            constellation = dataclasses.replace(gnss.constellation, seed=seed)
            gnss = dataclasses.replace(gnss, constellation=constellation)
        if self.motion == "kept":
            deputies = [
                dataclasses.replace(
                    craft, target_rtn=relative_state_rtn(chief.state_gcrf, craft.state_gcrf)
                )
                for craft in deputies
            ]
        scenario = dataclasses.replace(scenario, spacecraft=(chief, *deputies))
        if self.gradient_tecu_per_deg:
            gnss = along_track_gradient(gnss, scenario, self.gradient_tecu_per_deg)
        return scenario, gnss


def thrust_errors(scale: float) -> Callable[[Scenario], Scenario]:
    """Return a change that gives the deputy a thruster with errors."""
    model = ThrusterErrorModel(scale, 2.0, 0.01)

    def change(scenario: Scenario) -> Scenario:
        chief, *deputies = scenario.spacecraft
        erring = [dataclasses.replace(deputy, thruster_errors=model) for deputy in deputies]
        return dataclasses.replace(scenario, spacecraft=(chief, *erring))

    return change


def drawn_thrust_errors(scenario: Scenario) -> Scenario:
    """Return a scenario whose thruster has errors drawn with the sigmas that the filter states."""
    stated = EstimatorSetting()
    random = np.random.default_rng(np.random.SeedSequence((scenario.seed, 15)))
    model = ThrusterErrorModel(
        scale=1.0 + stated.thrust_scale_sigma * float(random.standard_normal()),
        # About a drawn axis: each component of the rotation has the stated sigma.
        misalignment_deg=stated.thrust_misalignment_sigma_deg
        * float(np.linalg.norm(random.standard_normal(3))),
        noise=stated.thrust_sigma,
    )
    chief, deputy = scenario.spacecraft
    deputy = dataclasses.replace(deputy, thruster_errors=model)
    return dataclasses.replace(scenario, spacecraft=(chief, deputy))


def drawn_spacecraft(scenario: Scenario) -> Scenario:
    """Return a scenario with drawn thrust errors and a deputy unlike the chief.

    Its drag differs by some 50 %, the radiation on it by some 20 % (one sigma each).
    """
    random = np.random.default_rng(np.random.SeedSequence((scenario.seed, 16)))
    forces = scenario.force_model
    own = dataclasses.replace(
        forces,
        drag_coefficient=forces.drag_coefficient * math.exp(0.4 * random.standard_normal()),
        radiation_coefficient=forces.radiation_coefficient
        * math.exp(0.2 * random.standard_normal()),
    )
    scenario = drawn_thrust_errors(scenario)
    chief, deputy = scenario.spacecraft
    return dataclasses.replace(
        scenario, spacecraft=(chief, dataclasses.replace(deputy, force_model=own))
    )


@functools.cache
def deep_bubble(number: int) -> PlasmaWorld:
    """Return one of the drawn bubbles in which all signals fade, counted from 1."""
    drawn = map(draw_bubble_world, itertools.count(_FIRST_BUBBLE))
    deep = (world for world in drawn if world.bubble and world.bubble.s4 >= _DEEP_S4)
    return next(itertools.islice(deep, max(number, 1) - 1, None))


def exact_thrust(scenario: Scenario) -> Scenario:
    """Return a scenario whose thrusters give what they report."""
    spacecraft = tuple(
        dataclasses.replace(craft, thruster_errors=None) for craft in scenario.spacecraft
    )
    return dataclasses.replace(scenario, spacecraft=spacecraft)


def receivers(**changes: object) -> Change:
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


def multipath(phase_sigma: float, code_sigma: float) -> Change:
    """Return a change that adds Gauss-Markov multipath of 100 s."""
    return receivers(multipath=MultipathModel(code_sigma=code_sigma, phase_sigma=phase_sigma))


_GRADIENT_SHELL = 700e3  # m, altitude; the spacecraft are at 550 km
# From the chief to the point where a ray of 5 deg of elevation pierces that shell, with some more.
_LARGEST_PIERCE_ANGLE_DEG = 9.0


def along_track_gradient(
    gnss: GnssConfiguration, scenario: Scenario, tecu_per_deg: float
) -> GnssConfiguration:
    """Return receivers under a TEC that grows along the track of the chief, without end.

    The content above the chief at the start is such that no ray in view has less than no electrons:
    the emulator would cut that off, and the gradient would end between the satellites.
    """
    motion = scenario.formation_truth().motion_itrf(scenario.chief.name)
    up = ellipsoid_normal(motion[0])
    east = np.cross((0.0, 0.0, 1.0), up)
    east /= np.linalg.norm(east)
    azimuth = math.degrees(math.atan2(motion[1] @ east, motion[1] @ np.cross(up, east)))
    structure = HorizontalGradient(
        tecu_per_deg,
        azimuth,
        _GRADIENT_SHELL,
        extent_deg=90.0,
        content_tecu=tecu_per_deg * _LARGEST_PIERCE_ANGLE_DEG,
    )
    return dataclasses.replace(gnss, structures=(structure,))


def broadcast_errors(gnss: GnssConfiguration) -> GnssConfiguration:
    """Return a configuration with drifting errors of 1.5 m of orbits and clocks."""
    constellation = dataclasses.replace(
        gnss.constellation,
        orbit_error_sigma=1.5,
        clock_error_sigma=1.5,
        error_correlation_time=21600.0,
    )
    return dataclasses.replace(gnss, constellation=constellation)


_OUTAGE, _SILENCE = (600.0, 630.0), (720.0, 740.0)


def many_faults(gnss: GnssConfiguration) -> GnssConfiguration:
    """Return a configuration with slips, half cycles, an outage, a jump, silence and bad bytes.

    Slips and half cycles come to one satellite after the other, of which some ten are in view.
    """
    faults = []
    for prn in range(1, 33):
        satellite = f"G{prn:02d}"
        signal = ("G1C", "G2W", "G5Q")[prn % 3]
        craft = ("chief", "deputy")[prn % 2]
        cycles = float((1, -1, 3, 20)[prn % 4])
        faults += [
            Fault("slip", craft, 100.0 + 7.0 * prn, 0.0, satellite, signal, cycles, prn % 5 != 0),
            Fault("half_cycle", craft, 340.0 + 7.0 * prn, 0.0, satellite, "G1C"),
        ]
    faults += [
        Fault("outage", "deputy", _OUTAGE[0], _OUTAGE[1] - _OUTAGE[0]),
        Fault("clock_jump", "chief", 680.0, seconds=1e-3),
        Fault("silent", "deputy", _SILENCE[0], _SILENCE[1] - _SILENCE[0]),
        Fault("corrupted_bytes", "deputy", 790.0, 60.0, rate=2e-4),
        Fault("dropped_bytes", "chief", 790.0, 60.0, rate=1e-4),
    ]
    return dataclasses.replace(gnss, faults=tuple(faults))


def outage_of_approach(gnss: GnssConfiguration) -> GnssConfiguration:
    """Return a configuration without satellites at both receivers from 15 s to 55 s."""
    faults = tuple(Fault("outage", receiver.name, 15.0, 40.0) for receiver in gnss.receivers)
    return dataclasses.replace(gnss, faults=faults)


LEVER_ARM = (0.12, -0.1, -0.12)  # m, of the deputy; 0.2 m long
LEVER_ARM_SIGMA = 0.115
"""On each axis, m: 0.2 m in three axes."""
_CARRIERS = ("G01", "G02", "G05")


def phase_map(number: int, largest: float) -> PhaseCentre:
    """Return a phase centre whose variations, drawn by number, are at most so large, m."""
    random = np.random.default_rng(np.random.SeedSequence((number, 13)))
    zenith, azimuth = np.radians(np.arange(0.0, 91.0, 5.0)), np.radians(np.arange(0.0, 361.0, 10.0))
    maps = {}
    for carrier in _CARRIERS:
        variation = np.zeros((len(azimuth), len(zenith)))
        for turns in range(4):
            for waves in range(1, 4):
                # Without a value in the zenith, where all azimuths are the same direction.
                radial = np.sin(zenith) ** max(turns, 1) * np.cos(waves * zenith)
                around = np.cos(turns * azimuth + 2.0 * np.pi * random.random())
                variation += random.standard_normal() * np.outer(around, radial)
        variation *= largest / np.abs(variation).max()
        maps[carrier] = PhaseCentreMap(np.zeros(3), zenith, azimuth, variation)
    return PhaseCentre(f"MAP {number}", maps)


def sum_of_maps(first: PhaseCentre, second: PhaseCentre) -> PhaseCentre:
    """Return a phase centre with the variations of both."""
    maps = {
        carrier: dataclasses.replace(
            centre, variation=centre.variation + second.maps[carrier].variation
        )
        for carrier, centre in first.maps.items()
    }
    return PhaseCentre(first.antenna, maps)


def antennas(largest_variation: float, lever_arm: tuple[float, ...] | None) -> Change:
    """Return a change that gives each receiver a map, and the deputy's antenna a lever arm."""

    def change(gnss: GnssConfiguration) -> GnssConfiguration:
        chief, deputy = gnss.receivers
        maps = [
            phase_map(number, largest_variation) if largest_variation else None for number in (1, 2)
        ]
        return dataclasses.replace(
            gnss,
            receivers=(
                dataclasses.replace(chief, phase_centre=maps[0]),
                dataclasses.replace(deputy, phase_centre=maps[1], lever_arm_body=lever_arm),
            ),
        )

    return change


def drawn_lever_arm(sigma: float) -> Change:
    """Return a change that draws the lever arm of the deputy from the seed of the run, m."""

    def change(gnss: GnssConfiguration) -> GnssConfiguration:
        random = np.random.default_rng(np.random.SeedSequence((gnss.seed, 14)))
        lever_arm = tuple((sigma * random.standard_normal(3)).tolist())
        chief, deputy = gnss.receivers
        deputy = dataclasses.replace(deputy, lever_arm_body=lever_arm)
        return dataclasses.replace(gnss, receivers=(chief, deputy))

    return change


def uncalibrated_antennas(setting: EstimatorSetting) -> EstimatorSetting:
    """Return the setting as it is: by default nobody has calibrated the antennas."""
    return setting


def given_antennas(
    chief: Antenna, deputy: Antenna
) -> Callable[[EstimatorSetting], EstimatorSetting]:
    """Return a change that gives the filter its antennas."""
    pair, bands = AntennaPair(chief, deputy), {SYSTEM_GPS: (1, 2, 5)}
    return lambda setting: dataclasses.replace(setting, antennas=pair, bands=bands)


def calibrated(number: int, lever_arm: tuple[float, float, float], error: float) -> Antenna:
    """Return the antenna of map `number`, of 6 mm, with an error of its calibration, m."""
    return Antenna(
        lever_arm,
        phase_centre=sum_of_maps(phase_map(number, 0.006), phase_map(number + 2, error)),
        phase_map_sigma=error,
    )


def calibrated_in_file(setting: EstimatorSetting) -> EstimatorSetting:
    """Return the setting of the filter in config/system/realistic.yaml."""
    return given_antennas(*_antennas_in_file())(setting)


def calibrated_without_lever_arm(sigma: float) -> Callable[[EstimatorSetting], EstimatorSetting]:
    """Return a change to that setting, where the deputy's lever arm has a sigma on each axis, m."""
    chief, deputy = _antennas_in_file()
    return given_antennas(chief, dataclasses.replace(deputy, lever_arm_sigma=sigma))


def _antennas_in_file() -> tuple[Antenna, Antenna]:
    path = CONFIG / "gnss/realistic_calibration.atx"
    chief, deputy = (
        Antenna(phase_centre=read_antex(path, f"VTFF PATCH {number} NONE"), phase_map_sigma=0.0003)
        for number in (1, 2)
    )
    return chief, deputy


SINUSOID = MultipathModel(code_amplitude=0.5, phase_amplitude=0.005, period=120.0)
OPTIMISTIC = NoiseModel("fixed", 0.6, 0.003, 0.01, stated_sigma_factor=1.0 / 3.0)


def with_stated_lever_arm(world: World) -> World:
    """Return a world with a drawn lever arm of the deputy, of which only the sigma is stated."""
    return dataclasses.replace(
        world,
        change_gnss=drawn_lever_arm(LEVER_ARM_SIGMA),
        change_setting=given_antennas(Antenna(), Antenna(lever_arm_sigma=LEVER_ARM_SIGMA)),
        white_noise=WhiteNoise(),
        must=Must(fixed_percent=100.0),
    )


WORLDS: dict[str, World] = {
    # The shipped approach from 1000 m to 100 m, in the geometry of the file.
    "ideal": World(
        distance=None,
        motion="scenario",
        draws_geometry=False,
        phase_noise=PhaseNoise(0.001),
        white_noise=WhiteNoise(),
        must=Must(0.35, fixed_percent=100.0),
    ),
    "ideal_geometries": World(
        phase_noise=PhaseNoise(0.001),
        white_noise=WhiteNoise(),
        must=Must(0.6, worst_rms_mm=1.0, fixed_percent=100.0),
    ),
    "ideal_5km": World(
        distance=5e3, phase_noise=PhaseNoise(0.001), white_noise=WhiteNoise(), must=Must(0.8)
    ),
    "thrust_1.05": World(
        distance=None,
        motion="scenario",
        change_scenario=thrust_errors(1.05),
        phase_noise=PhaseNoise(0.001),
        white_noise=WhiteNoise(),
        must=Must(0.7),
    ),
    "thrust_0.95": World(
        distance=None,
        motion="scenario",
        change_scenario=thrust_errors(0.95),
        phase_noise=PhaseNoise(0.001),
        white_noise=WhiteNoise(),
        must=Must(0.7),
    ),
    # What the covariance of thrust errors means: these are drawn with it, those above are fixed.
    "thrust_drawn": World(
        distance=None,
        motion="scenario",
        change_scenario=drawn_thrust_errors,
        white_noise=WhiteNoise(),
        must=Must(0.7),
    ),
    "forces": World(
        "realistic",
        change_scenario=exact_thrust,
        phase_noise=PhaseNoise(0.001),
        white_noise=WhiteNoise(),
        must=Must(0.45),
    ),
    "forces_5km": World(
        "realistic",
        distance=5e3,
        change_scenario=exact_thrust,
        phase_noise=PhaseNoise(0.001),
        white_noise=WhiteNoise(),
        must=Must(0.8),
    ),
    "forces_225km": World(
        "realistic",
        distance=225e3,
        motion="free",
        interval=10,
        change_scenario=exact_thrust,
        phase_noise=PhaseNoise(0.001),
        must=Must(3.0),
    ),
    # With the forces of an orbit: over 5 km a filter of real gravity errs in a world of degree 8.
    "broadcast": World(
        "realistic",
        change_scenario=exact_thrust,
        change_gnss=broadcast_errors,
        phase_noise=PhaseNoise(0.001),
        ranges=RangeErrors(broadcast_sigma=1.5),
        white_noise=WhiteNoise(broadcast_sigma=1.5),
        must=Must(0.45),
    ),
    "broadcast_5km": World(
        "realistic",
        distance=5e3,
        change_scenario=exact_thrust,
        change_gnss=broadcast_errors,
        phase_noise=PhaseNoise(0.001),
        ranges=RangeErrors(broadcast_sigma=1.5),
        white_noise=WhiteNoise(broadcast_sigma=1.5),
        must=Must(0.8),
    ),
    "multipath_1mm": World(
        change_gnss=multipath(0.001, 0.1),
        seconds=3600,
        phase_noise=PhaseNoise(0.001, 0.001),
        must=Must(2.2, fixed_percent=100.0),
    ),
    "multipath_2mm": World(
        change_gnss=multipath(0.002, 0.2),
        seconds=3600,
        phase_noise=PhaseNoise(0.001, 0.002),
        must=Must(4.2, fixed_percent=100.0),
    ),
    "multipath_5mm": World(
        change_gnss=multipath(0.005, 0.5),
        seconds=3600,
        phase_noise=PhaseNoise(0.001, 0.005),
        must=Must(9.5, fixed_percent=99.0),
    ),
    "multipath_sinusoid": World(
        change_gnss=receivers(multipath=SINUSOID), must=Must(8.0, fixed_percent=99.0, nees=None)
    ),
    "stated_third": World(
        change_gnss=receivers(noise=OPTIMISTIC),
        phase_noise=PhaseNoise(0.003),
        white_noise=WhiteNoise(0.003, 0.6),
        must=Must(1.2, fixed_percent=100.0),
    ),
    "antennas_given": World(
        change_gnss=antennas(0.006, LEVER_ARM),
        change_setting=given_antennas(calibrated(1, (0, 0, 0), 0.0), calibrated(2, LEVER_ARM, 0.0)),
        must=Must(0.5, fixed_percent=100.0),
    ),
    "lever_arm_sigma": with_stated_lever_arm(World()),
    # The same under the forces of an orbit. What tells the arm from the position is the motion, as
    # well as accelerations are known: of those that the filter allows for only drag is there.
    "lever_arm_forces": with_stated_lever_arm(World("realistic", change_scenario=exact_thrust)),
    # With thrust errors of the sigmas that the filter states and other spacecraft, too: all that
    # the filter counts is drawn.
    "lever_arm_drawn": with_stated_lever_arm(World("realistic", change_scenario=drawn_spacecraft)),
    # The realistic world, with thrust errors, too.
    "realistic_lever_arm": World(
        "realistic",
        "realistic",
        distance=None,
        motion="scenario",
        change_gnss=drawn_lever_arm(LEVER_ARM_SIGMA),
        change_setting=calibrated_without_lever_arm(LEVER_ARM_SIGMA),
        must=Must(fixed_percent=100.0),
    ),
    # What antennas without calibration may have, stated: 1.8 mm in the mean.
    "maps_stated": World(
        change_gnss=antennas(0.006, None),
        change_setting=given_antennas(
            Antenna(phase_map_sigma=0.0018), Antenna(phase_map_sigma=0.0018)
        ),
        must=Must(fixed_percent=100.0),
    ),
    "maps_not_given": World(
        change_gnss=antennas(0.006, None),
        change_setting=uncalibrated_antennas,
        must=Must(nees=(0.0, 3.0), degraded_percent=None),
    ),
    "gradient_0.5_5km": World(
        distance=5e3,
        gradient_tecu_per_deg=0.5,
        phase_noise=PhaseNoise(0.001),
        must=Must(1.0, fixed_percent=100.0),
    ),
    "gradient_2_5km": World(
        distance=5e3,
        gradient_tecu_per_deg=2.0,
        phase_noise=PhaseNoise(0.001),
        must=Must(2.0, fixed_percent=100.0),
    ),
    "realistic": World(
        "realistic",
        "realistic",
        distance=None,
        motion="scenario",
        seconds=3600,
        change_setting=calibrated_in_file,
        phase_noise=PhaseNoise(0.001, 0.0015),
        must=Must(2.5, None, 100.0),
    ),
    "realistic_5km": World(
        "realistic_5km",
        "realistic",
        distance=None,
        motion="scenario",
        change_setting=calibrated_in_file,
        must=Must(None, None, 99.0),
    ),
    "realistic_loop": World(
        "realistic",
        "realistic",
        distance=None,
        motion="closed_loop",
        seconds=3600,
        change_setting=calibrated_in_file,
        must=Must(2.5, None, 100.0, keeping_mm=3.0, keeping_dv_per_hour=0.03),
    ),
    "outage_loop": World(
        distance=None,
        motion="closed_loop",
        seconds=420,
        change_gnss=outage_of_approach,
        outages=((15.0, 55.0),),
        white_noise=WhiteNoise(),
        must=Must(degraded_percent=None, closest=60.0, dv=75.0, last_minute=1.0),
    ),
    "outage_thrust_loop": World(
        distance=None,
        motion="closed_loop",
        seconds=420,
        change_scenario=thrust_errors(1.05),
        change_gnss=outage_of_approach,
        outages=((15.0, 55.0),),
        white_noise=WhiteNoise(),
        must=Must(degraded_percent=None, closest=60.0, dv=75.0, last_minute=1.0),
    ),
    # A bubble in which the whole sky fades: after 90 s, for some minutes; kilometres apart.
    "deep_bubble": World(
        distance=None,
        motion="scenario",
        draws_geometry=False,
        change_scenario=lambda scenario: deep_bubble(scenario.seed).scenario(),
        change_gnss=lambda gnss: deep_bubble(gnss.seed).gnss(),
        must=Must(degraded_percent=None, has_true_integers=False),
    ),
    "faults": World(
        "realistic",
        "realistic",
        distance=None,
        motion="scenario",
        change_gnss=many_faults,
        change_setting=calibrated_in_file,
        outages=(_OUTAGE, _SILENCE),
        must=Must(3.0, degraded_percent=None, recovery_s=30.0, is_honest_in_outages=True),
    ),
}
