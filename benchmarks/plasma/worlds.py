"""The worlds of `bench_plasma.py`: orbits, plasma and receivers, drawn by seed."""

from __future__ import annotations

import dataclasses
import math
import pathlib
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.constants import GM_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.frames.rtn import relative_state_rtn
from vtff_dynamics.time.local_time import mean_solar_local_time_hours
from vtff_sim_bridge.atmosphere.density_models import Depletion, depleted_profile
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion
from vtff_sim_bridge.gnss.configuration import (
    BiasDriftModel,
    GnssConfiguration,
    MultipathModel,
    NoiseModel,
    load_gnss_configuration,
)
from vtff_sim_bridge.truth.scenario import Scenario, load_scenario, state_ahead_on_orbit

__all__ = ["Bubble", "PlasmaWorld", "draw_bubble_world", "quiet_worlds"]

CONFIG = pathlib.Path(__file__).resolve().parents[2] / "config"
_STREAM = 18
LEAD_IN = 150.0
"""Time from the start to the first wall, s: relative navigation starts, the constant settles."""
_FOLLOW_UP = 75.0
# s; the fluctuations begin where the chief is then: relative navigation needs quiet signals first.
_QUIET = 90.0


@dataclass(frozen=True)
class Bubble:
    """A layer of missing density in which signals scintillate.

    Parameters
    ----------
    altitude_bottom, altitude_top : float
        Middles of its walls, m.
    depth : float
        Part of the density that is missing.
    wall_width : float
        m.
    s4, decorrelation_time, correlation, drift_east : float
        As in `IrregularityRegion`; no fluctuations with an S4 of 0.
    """

    altitude_bottom: float
    altitude_top: float
    depth: float
    wall_width: float
    s4: float = 0.0
    decorrelation_time: float = 0.5
    correlation: float = 1.0
    drift_east: float = 0.0


@dataclass(frozen=True)
class PlasmaWorld:
    """What is flown.

    Parameters
    ----------
    name : str
    seed : int
        Of noise, constellation, node and epoch.
    seconds : int
    start_altitude : float
        Altitude of the chief at the start, m.
    perigee_altitude, apogee_altitude : float
        m.
    is_rising : bool
        Whether the chief rises at the start.
    vertical_separation : float
        By which the deputy is below the chief, m.
    background : float
        Factor of the densities of config/gnss/realistic.yaml.
    receivers : {"realistic", "cn0"}
        All errors of config/gnss/realistic.yaml, or only noise by C/N0, white, stated as it is.
    multipath_sigma : float or None
        Multipath of the phase, m, with 200 times it of the code; None: as `receivers` say.
    cn0_zenith_dbhz : tuple of float or None
        L1 and L2 at boresight; None: those of the file.
    satellite_bias_ns : float
        Sigma of what is not known of the satellite biases L1 - L2, ns.
    has_antenna_maps : bool
        Whether phase centres vary as in config/gnss/realistic.atx; without, antennas are ideal.
    bubble : Bubble or None
    """

    name: str
    seed: int
    seconds: int
    start_altitude: float = 236e3
    perigee_altitude: float = 200e3
    apogee_altitude: float = 805e3
    is_rising: bool = True
    vertical_separation: float = 1e3
    background: float = 1.0
    receivers: str = "realistic"
    multipath_sigma: float | None = None
    cn0_zenith_dbhz: tuple[float, float] | None = None
    satellite_bias_ns: float = 0.1
    has_antenna_maps: bool = False
    bubble: Bubble | None = None

    def scenario(self) -> Scenario:
        """Return orbits and epoch; the deputy keeps its first place, below and 15 km behind."""
        random = np.random.default_rng(np.random.SeedSequence((self.seed, _STREAM)))
        scenario = load_scenario(CONFIG / "scenario/esf.yaml")
        chief, deputy = scenario.spacecraft
        node, delay = 2.0 * math.pi * random.random(), math.floor(86400.0 * random.random())
        state = _state_on_ellipse(
            RADIUS_EARTH_JGM3 + self.perigee_altitude,
            RADIUS_EARTH_JGM3 + self.apogee_altitude,
            RADIUS_EARTH_JGM3 + self.start_altitude,
            self.is_rising,
            math.radians(10.0),
            node,
        )
        behind = state_ahead_on_orbit(state, -15e3)
        up = behind[:3] / np.linalg.norm(behind[:3])
        below = np.concatenate((behind[:3] - self.vertical_separation * up, behind[3:]))
        chief = dataclasses.replace(chief, state_gcrf=state)
        deputy = dataclasses.replace(
            deputy, state_gcrf=below, target_rtn=relative_state_rtn(state, below)
        )
        return dataclasses.replace(
            scenario,
            seed=self.seed,
            epoch=scenario.epoch + float(delay),
            duration=float(self.seconds),
            spacecraft=(chief, deputy),
        )

    def gnss(self) -> GnssConfiguration:
        """Return what the receivers are and suffer."""
        gnss = load_gnss_configuration(CONFIG / "gnss/realistic.yaml", self.seed)
        constellation = dataclasses.replace(
            gnss.constellation,
            seed=self.seed,
            inter_signal_sigma=0.299792458 * self.satellite_bias_ns / math.sqrt(2.0),
        )
        profile = gnss.profile
        assert profile is not None
        profile = profile.scaled(self.background)
        regions: tuple[IrregularityRegion, ...] = ()
        if self.bubble is not None:
            bubble = self.bubble
            profile = depleted_profile(
                profile,
                [
                    Depletion(
                        bubble.altitude_bottom,
                        bubble.altitude_top,
                        bubble.depth,
                        bubble.wall_width,
                    )
                ],
            )
            if bubble.s4 > 0.0:
                west_hours = self._local_time_hours(_QUIET)
                regions = (
                    IrregularityRegion(
                        name="bubble",
                        latitude_south=-0.5 * math.pi,
                        latitude_north=0.5 * math.pi,
                        local_time_start_hours=west_hours,
                        local_time_end_hours=(west_hours + 6.0) % 24.0,
                        altitude_bottom=bubble.altitude_bottom,
                        altitude_top=bubble.altitude_top,
                        s4=bubble.s4,
                        decorrelation_time=bubble.decorrelation_time,
                        correlation=bubble.correlation,
                        drift_east=bubble.drift_east,
                    ),
                )
        receivers = []
        for receiver in gnss.receivers:
            changes: dict[str, object] = {}
            signals = ("G1C", "G2W")
            strengths = self.cn0_zenith_dbhz or [receiver.cn0_zenith_dbhz[s] for s in signals]
            changes["cn0_zenith_dbhz"] = dict(zip(signals, strengths, strict=True))
            noise = receiver.noise
            if not self.has_antenna_maps:
                changes["phase_centre"] = None
            if self.receivers == "cn0":
                noise = NoiseModel("cn0")
                changes |= {"multipath": MultipathModel(), "bias_drift": BiasDriftModel()}
            elif self.cn0_zenith_dbhz is not None:
                noise = dataclasses.replace(noise, model="cn0")
            if self.multipath_sigma is not None:
                changes["multipath"] = MultipathModel(
                    phase_sigma=self.multipath_sigma, code_sigma=200.0 * self.multipath_sigma
                )
            changes["noise"] = noise
            receivers.append(dataclasses.replace(receiver, **changes))  # type: ignore[arg-type]
        structures = () if self.receivers == "cn0" else gnss.structures
        # A shell below the orbit would not be above the receivers.
        highest = self.apogee_altitude + 20e3
        structures = tuple(
            dataclasses.replace(structure, shell_altitude=max(structure.shell_altitude, highest))
            for structure in structures
        )
        return dataclasses.replace(
            gnss,
            constellation=constellation,
            profile=profile,
            regions=regions,
            receivers=tuple(receivers),
            structures=structures,
        )

    def _local_time_hours(self, elapsed: float) -> float:
        """Return the local time at the start of the run where the chief is later, h."""
        scenario = self.scenario()
        position, velocity = scenario.formation_truth().motion_itrf(scenario.chief.name)[:2]
        rate = position[0] * velocity[1] - position[1] * velocity[0]
        rate /= position[0] ** 2 + position[1] ** 2
        longitude = math.atan2(position[1], position[0]) + elapsed * rate
        return mean_solar_local_time_hours(scenario.epoch, longitude) % 24.0


def _state_on_ellipse(
    radius_perigee: float,
    radius_apogee: float,
    radius: float,
    is_rising: bool,
    inclination: float,
    node: float,
) -> np.ndarray:
    """Return the state (6,) in GCRF at a radius of an ellipse whose perigee is at the node, m."""
    axis = 0.5 * (radius_perigee + radius_apogee)
    eccentricity = (radius_apogee - radius_perigee) / (radius_apogee + radius_perigee)
    parameter = axis * (1.0 - eccentricity**2)
    anomaly = 0.0
    if eccentricity > 1e-9:
        anomaly = math.acos(np.clip((parameter / radius - 1.0) / eccentricity, -1.0, 1.0))
    if not is_rising:
        anomaly = -anomaly
    speed = math.sqrt(GM_EARTH / parameter)
    position = parameter / (1.0 + eccentricity * math.cos(anomaly))
    in_plane = np.array(
        [
            [position * math.cos(anomaly), position * math.sin(anomaly), 0.0],
            [-speed * math.sin(anomaly), speed * (eccentricity + math.cos(anomaly)), 0.0],
        ]
    )
    tilt = np.array(
        [
            [1.0, 0.0, 0.0],
            [0.0, math.cos(inclination), -math.sin(inclination)],
            [0.0, math.sin(inclination), math.cos(inclination)],
        ]
    )
    turn = np.array(
        [
            [math.cos(node), -math.sin(node), 0.0],
            [math.sin(node), math.cos(node), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    return np.asarray((in_plane @ (turn @ tilt).T).ravel())


def _vertical_speed(altitude: float) -> float:
    """Return the vertical speed at an altitude of the default ellipse, m/s."""
    defaults = PlasmaWorld("", 0, 0)
    perigee, apogee, radius = (
        RADIUS_EARTH_JGM3 + height
        for height in (defaults.perigee_altitude, defaults.apogee_altitude, altitude)
    )
    energy = 2.0 * GM_EARTH * (1.0 / radius - 1.0 / (perigee + apogee))
    momentum = math.sqrt(2.0 * GM_EARTH * perigee * apogee / (perigee + apogee))
    return math.sqrt(energy - (momentum / radius) ** 2)


def draw_bubble_world(seed: int, separation: float | None = None) -> PlasmaWorld:
    """Return the flight through a bubble drawn by seed, within the ranges of the table.

    `separation` is the vertical separation, m; by default it is drawn too.
    """
    random = np.random.default_rng(np.random.SeedSequence((seed, _STREAM, 1)))

    def between(low: float, high: float) -> float:
        return float(random.uniform(low, high))

    def log_between(low: float, high: float) -> float:
        return math.exp(between(math.log(low), math.log(high)))

    bottom = between(310e3, 420e3)
    wall_width = log_between(100.0, 20e3)
    top = bottom + max(between(25e3, 50e3), 1.5 * wall_width)
    bubble = Bubble(
        bottom,
        top,
        depth=between(0.2, 0.95),
        wall_width=wall_width,
        s4=between(0.2, 0.9),
        decorrelation_time=log_between(0.03, 2.0),
        correlation=between(0.5, 1.0),
        drift_east=between(0.0, 150.0),
    )
    drawn_separation = log_between(1e3, 10e3)
    is_rising = bool(random.random() < 0.5)
    # Vertical speeds are 200 to 300 m/s.
    speed = _vertical_speed(bottom if is_rising else top)
    margin = 0.5 * wall_width + LEAD_IN * speed
    below = separation or drawn_separation
    # The deputy is below the chief: rising the chief is the first, falling the deputy.
    start = bottom - margin if is_rising else top + below + margin
    seconds = LEAD_IN + (top - bottom + wall_width + below) / speed + _FOLLOW_UP
    return PlasmaWorld(
        f"bubble-{seed}" + ("" if separation is None else f"-{separation:.0f}m"),
        seed,
        round(seconds),
        start_altitude=start,
        is_rising=is_rising,
        vertical_separation=below,
        background=between(0.5, 2.0),
        bubble=bubble,
    )


def quiet_worlds(first_seed: int, count: int, seconds: int = 3600) -> list[PlasmaWorld]:
    """Return flights without bubbles, all conditions in turn."""
    conditions: list[dict[str, object]] = [
        {"name": "realistic"},
        {"name": "realistic, down", "is_rising": False, "start_altitude": 780e3},
        {"name": "C/N0 noise", "receivers": "cn0"},
        {"name": "C/N0 noise, background 0.1", "receivers": "cn0", "background": 0.1},
        {"name": "C/N0 noise, background 3", "receivers": "cn0", "background": 3.0},
        {"name": "multipath 3 mm", "multipath_sigma": 0.003},
        {"name": "weak, multipath 3 mm", "multipath_sigma": 0.003, "cn0_zenith_dbhz": (42.0, 32.0)},
        {
            "name": "circular, realistic",
            "perigee_altitude": 449e3,
            "apogee_altitude": 451e3,
            "start_altitude": 450e3,
        },
        {"name": "realistic, background 3, 3 km", "background": 3.0, "vertical_separation": 3e3},
        {"name": "realistic, background 0.3", "background": 0.3},
        {"name": "multipath 1 mm, perigee", "multipath_sigma": 0.001, "start_altitude": 213e3},
    ]
    return [
        PlasmaWorld(
            seed=first_seed + number, seconds=seconds, **conditions[number % len(conditions)]
        )  # type: ignore[arg-type]
        for number in range(count)
    ]
