"""Two receivers at rest, in a car, in a street, and in orbit; phases that jump without a word.

The geometry is exact, the noise white; what is drawn is the jump. It is that of a car's receiver
in which both carriers of a satellite moved by 129 mm without a loss of lock being told.
"""

from __future__ import annotations

import copy
import functools
import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import itrf_from_geodetic, rotation_itrf_to_enu
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_gnss import constants as c
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)
from vtff_gnss.signals import carrier_frequency_hz
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.common.dynamics import MotionNoise
from vtff_nav.relative.common.measurements import MeasurementNoise
from vtff_nav.relative.common.solution import SOLUTION_FIXED

START = parse_epoch("2023-01-08T11:00:00 GPS")
MOTIONS = ("static", "car", "street", "orbit")
#: In a street of high houses a car sees so many satellites.
SATELLITES_IN_STREET = 7
SECONDS = 60
#: Until here the filter has found its integers; jumps come later.
CONVERGED = 30
SIGNALS = ((c.SYSTEM_GPS, 1, "C"), (c.SYSTEM_GPS, 2, "W"),
           (c.SYSTEM_GALILEO, 1, "C"), (c.SYSTEM_GALILEO, 5, "Q"))  # fmt: skip
PHASE_SIGMA = {"static": 0.002, "car": 0.003, "street": 0.003, "orbit": 0.001}
CODE_SIGMA = {"static": 0.5, "car": 0.8, "street": 0.8, "orbit": 0.3}
MASK = {"static": 10.0, "car": 10.0, "street": 10.0, "orbit": 5.0}
BASE = itrf_from_geodetic((math.radians(48.0), math.radians(11.0), 500.0))


@dataclass
class World:
    """Epochs of base and rover, element k that of second k, and the truth.

    Parameters
    ----------
    motion : str
    epochs : list of tuple
        Base and rover.
    baseline_itrf : ndarray, shape (n, 3)
        Rover less base at the time tags, m.
    estimator : CdgpsEstimator
        After second `CONVERGED`.
    """

    motion: str
    epochs: list[tuple[ObservationEpoch, ObservationEpoch]]
    baseline_itrf: np.ndarray
    estimator: CdgpsEstimator


@functools.lru_cache(maxsize=4)
def world(motion: str, seed: int = 1, seconds: int = SECONDS) -> World:
    """Return the world of a motion, with a filter that has converged."""
    generator = np.random.default_rng(seed)
    end = START + seconds
    ephemerides = (
        *nominal_gps_constellation(START, end), *nominal_galileo_constellation(START, end)
    )  # fmt: skip
    table = EphemerisStore(ephemerides).table(START)
    states = _states(motion, seconds)
    offsets = np.arange(seconds, dtype=float)
    ranges, elevations = [], []
    for states_of_receiver in states:
        sight = lines_of_sight(
            table, START, offsets, states_of_receiver[:, :3], states_of_receiver[:, 3:]
        )
        ranges.append(sight.range - SPEED_OF_LIGHT * sight.clock_offset_satellite)
        elevations.append(sight.elevation)
    ambiguity = generator.integers(-1000, 1000, (2, len(table), 3))
    in_view = np.min(elevations, axis=(0, 1)) > math.radians(MASK[motion])
    if motion == "street":
        highest = np.argsort(-np.min(elevations, axis=(0, 1)))[:SATELLITES_IN_STREET]
        in_view &= np.isin(np.arange(len(table)), highest)
    epochs = [
        tuple(
            _epoch(table, START + float(k), ranges[r][k], in_view, ambiguity[r], motion, generator)
            for r in range(2)
        )
        for k in range(seconds)
    ]
    estimator = CdgpsEstimator(_configuration(motion), ephemerides)
    for k in range(CONVERGED):
        solution = estimator.process(START + float(k), *epochs[k])
    assert solution.solution == SOLUTION_FIXED, (motion, solution.degraded)
    return World(motion, epochs, states[1][:, :3] - states[0][:, :3], estimator)


def _configuration(motion: str) -> CdgpsConfiguration:
    noise = MeasurementNoise(CODE_SIGMA[motion], PHASE_SIGMA[motion], use_receiver_sigmas=False)
    if motion == "orbit":
        return CdgpsConfiguration(
            force_model=ForceModel(degree=2, order=0),
            noise_relative=MotionNoise(5e-8),
            bands={c.SYSTEM_GPS: (1, 2), c.SYSTEM_GALILEO: (1, 5)},
            measurement_noise=noise,
        )
    return CdgpsConfiguration(
        dynamics="static" if motion == "static" else "kinematic",
        position_chief_itrf=tuple(BASE.tolist()),
        measurement_noise=noise,
        bands={c.SYSTEM_GPS: (1, 2), c.SYSTEM_GALILEO: (1, 5)},
        elevation_mask_deg=MASK[motion],
        troposphere=False,
    )


def _states(motion: str, seconds: int) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and Earth-fixed velocities of base and rover, each (n, 6)."""
    time = np.arange(seconds, dtype=float)
    if motion == "orbit":
        initial = (
            np.array([6930000.0, 0.0, 0.0, 0.0, 3810.947, 6600.754]),
            np.array([6935000.0, 0.0, 0.0, 0.0, 3808.307, 6596.182]),
        )
        result = []
        for state in initial:
            craft = Propagator(START, state, ForceModel(degree=2, order=0))
            rows = []
            for _ in range(seconds):
                rows.append(state_gcrf_to_itrf(craft.time, craft.state_gcrf))
                craft.advance()
            result.append(np.array(rows))
        return result[0], result[1]
    rest = np.tile(np.concatenate((BASE, np.zeros(3))), (seconds, 1))
    enu = rotation_itrf_to_enu(BASE)
    east, north = (3000.0, 1200.0) if motion == "static" else (4000.0, 3400.0)
    local = np.tile([east, north, 5.0, 0.0, 0.0, 0.0], (seconds, 1))
    if motion != "static":
        # 12 m/s, and a curve every 20 s.
        heading = 0.6 * np.sin(2.0 * np.pi * time / 20.0)
        local[:, 3], local[:, 4] = 12.0 * np.cos(heading), 12.0 * np.sin(heading)
        fine = np.linspace(0.0, seconds, 100 * seconds, endpoint=False)
        angle = 0.6 * np.sin(2.0 * np.pi * fine / 20.0)
        for axis, component in enumerate((np.cos(angle), np.sin(angle))):
            path = np.concatenate(([0.0], np.cumsum(0.12 * component)))
            local[:, axis] += np.interp(time, np.arange(len(path)) * 0.01, path)
    rover = np.hstack((BASE + local[:, :3] @ enu, local[:, 3:] @ enu))
    return rest, rover


def _epoch(
    table, time: GpsTime, geometric, in_view, ambiguity, motion, generator
) -> ObservationEpoch:  # fmt: skip
    parts: dict[str, list[np.ndarray]] = {name: [] for name in OBSERVATION_COLUMNS}
    for number, (system, band, attribute) in enumerate(SIGNALS):
        rows = np.flatnonzero((table.system == system) & in_view)
        count = len(rows)
        wavelength = SPEED_OF_LIGHT / float(carrier_frequency_hz([system], [band])[0])
        code = geometric[rows] + CODE_SIGMA[motion] * generator.standard_normal(count)
        phase = geometric[rows] + PHASE_SIGMA[motion] * generator.standard_normal(count)
        values = {
            "system": np.full(count, system),
            "prn": table.prn[rows],
            "band": np.full(count, band),
            "attribute": np.full(count, ord(attribute)),
            "pseudorange": code,
            "carrier_phase_cycles": phase / wavelength + ambiguity[rows, number % 2],
            "lock_time": np.full(count, 1000.0 + (time - START)),
            "cn0_dbhz": np.full(count, 45.0),
            "flags": np.full(count, c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID | c.FLAG_PARITY_KNOWN),
        }
        for name in OBSERVATION_COLUMNS:
            fill = 0 if name == "glonass_channel" else np.nan
            parts[name].append(np.asarray(values.get(name, np.full(count, fill))))
    columns = {
        name: np.concatenate(values).astype(OBSERVATION_COLUMNS[name])
        for name, values in parts.items()
    }
    return ObservationEpoch(
        time=time, time_status=180, receiver_status=0, log_name="RANGE", **columns
    )


@dataclass(frozen=True)
class Jump:
    """Phases of some satellites of the rover that move by some metres from an epoch on."""

    motion: str
    epoch: int
    sizes: tuple[tuple[int, int, float], ...]

    def __str__(self) -> str:
        """Return for example ``car at 35 s: G05 +0.129 m``."""
        moved = ", ".join(
            f"{c.SYSTEM_LETTERS[s]}{prn:02d} {size:+.3f} m" for s, prn, size in self.sizes
        )
        return f"{self.motion} at {self.epoch} s: {moved}"


def draw_jump(generator: np.random.Generator, motion: str) -> Jump:
    """Draw one or two satellites of a world and jumps of 0.1 to 2 m."""
    rover = world(motion).epochs[0][1]
    satellites = sorted(set(zip(rover.system.tolist(), rover.prn.tolist(), strict=True)))
    count = int(generator.integers(1, 3))
    chosen = generator.choice(len(satellites), count, replace=False).tolist()
    sizes = 0.1 * 20.0 ** generator.random(count) * generator.choice([-1.0, 1.0], count)
    epoch = int(generator.integers(CONVERGED, CONVERGED + 10))
    return Jump(
        motion,
        epoch,
        tuple((*satellites[i], float(s)) for i, s in zip(chosen, sizes, strict=True)),
    )


def _moved(epoch: ObservationEpoch, jump: Jump) -> ObservationEpoch:
    phase = epoch.carrier_phase_cycles.copy()
    for system, prn, size in jump.sizes:
        rows = np.flatnonzero((epoch.system == system) & (epoch.prn == prn))
        frequency = carrier_frequency_hz(epoch.system[rows], epoch.band[rows])
        phase[rows] += size * frequency / SPEED_OF_LIGHT
    return epoch.__class__(**{**vars(epoch), "carrier_phase_cycles": phase})


@dataclass(frozen=True)
class Outcome:
    """What the filter made of a jump.

    Parameters
    ----------
    normalised : tuple of float
        Largest errors of the epochs that were called fixed, sigmas of the whole vector.
    fixed : int
        Epochs that were called fixed.
    epochs : int
    integers : int
        Integers of the last epoch.
    """

    normalised: tuple[float, ...]
    fixed: int
    epochs: int
    integers: int

    @property
    def largest(self) -> float:
        """Return the largest normalised error of a fixed epoch; 0 without one."""
        return max(self.normalised, default=0.0)


def fly_jump(jump: Jump, seconds: int = 16) -> Outcome:
    """Process the epochs from convergence on, with a jump, until so many s after it."""
    length = max(SECONDS, CONVERGED + 10 + seconds)
    scenario = world(jump.motion, seconds=length)
    estimator = copy.deepcopy(scenario.estimator)
    errors = []
    last = min(jump.epoch + seconds, length)
    for k in range(CONVERGED, last):
        base, rover = scenario.epochs[k]
        if k >= jump.epoch:
            rover = _moved(rover, jump)
        solution = estimator.process(START + float(k), base, rover)
        if solution.solution == SOLUTION_FIXED:
            error = solution.position_itrf - scenario.baseline_itrf[k]
            covariance = solution.covariance_position_itrf
            errors.append(float(np.sqrt(error @ np.linalg.solve(covariance, error))))
    return Outcome(tuple(errors), len(errors), last - CONVERGED, solution.ambiguities_fixed)
