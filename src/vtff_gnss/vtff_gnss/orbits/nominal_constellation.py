"""Built-in nominal constellations of GPS and Galileo as broadcast ephemerides for any time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.constants import J2_EARTH, NANOSECONDS_PER_SECOND, RADIUS_EARTH_JGM3
from vtff_dynamics.frames.earth import earth_rotation_angle
from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_gnss.constants import (
    EARTH_ROTATION_RATE_BROADCAST,
    EPHEMERIS_SOURCE_INAV,
    EPHEMERIS_SOURCE_LNAV,
    GRAVITATIONAL_PARAMETER_BROADCAST,
    SYSTEM_GALILEO,
    SYSTEM_GPS,
)
from vtff_gnss.ephemeris import (
    DEFAULT_FIT_INTERVAL,
    BroadcastEphemeris,
    galileo_accuracy,
    lnav_accuracy,
)
from vtff_gnss.orbits.message_lattice import (
    ANGLE_STEP,
    RATE_STEP,
    SET_INTERVAL,
    LatticeMotion,
    clock_steps,
    lattice_motion,
    node_rate_steps,
)

__all__ = ["nominal_galileo_constellation", "nominal_gps_constellation"]

_SETS_PER_WEEK = 604800 // SET_INTERVAL
_ANGLE_STEPS_PER_TURN = 2**32

# GPS reference slots at 1993-07-01 00:00 UTC: right ascension of the ascending node and arguments
# of latitude, deg (GPS SPS Performance Standard 2001, table 3-1). The arguments after the fourth
# are auxiliary satellites, placed for the largest least number in view in low Earth orbit: there
# is no published slot for them.
_GPS_EPOCH = "1993-07-01T00:00:00 UTC"
_GPS_PLANES_DEG = (
    (272.847, (268.126, 161.786, 11.676, 41.806, 132.0)),
    (332.847, (80.956, 173.336, 309.976, 204.376, 36.0)),
    (32.847, (111.876, 11.796, 339.666, 241.556, 294.0)),
    (92.847, (135.226, 265.446, 35.156, 167.356, 192.0, 84.0)),
    (152.847, (197.046, 302.596, 66.066, 333.686, 18.0)),
    (212.847, (238.886, 345.226, 105.206, 135.346, 276.0)),
)
_GPS_INCLINATION_DEG = 55.0

# Galileo reference constellation at 2016-11-21 00:00 UTC, Walker 24/3/1 (European GNSS Service
# Centre, orbital and technical parameters).
_GALILEO_EPOCH = "2016-11-21T00:00:00 UTC"
_GALILEO_NODES_DEG = (317.632, 77.632, 197.632)
_GALILEO_FIRST_LATITUDE_DEG = 225.153
_GALILEO_SLOTS_PER_PLANE = 8
_GALILEO_INCLINATION_DEG = 56.0
_GALILEO_SEMI_MAJOR_AXIS = 29599.8e3

# Typical sizes of the harmonic terms of broadcast ephemerides, rad and m. The mean of crc is the
# second zonal harmonic's and is added per system.
_HARMONIC_ANGLE_SIGMAS = {"cuc": 2e-6, "cus": 3e-6, "cic": 1e-7, "cis": 1e-7}
_HARMONIC_RADIUS_SIGMAS = {"crc": 30.0, "crs": 50.0}
_HARMONIC_ANGLE_STEP = 2.0**-29
_HARMONIC_RADIUS_STEP = 2.0**-5


@dataclass(frozen=True)
class _System:
    """Differences between the two constellations and their messages."""

    number: int
    source: int
    reference: GpsTime
    motion: LatticeMotion
    node_rate: float
    inclination: float
    inclination_sigma: float
    eccentricities: tuple[float, float]
    clock_offset_step: float
    clock_drift_multiples: tuple[int, ...]
    clock_offset_limit: float
    group_delay_step: float
    group_delay_limits: tuple[float, float]
    accuracy: float


@dataclass(frozen=True)
class _Satellite:
    """A satellite in numbers that do not change from set to set; angles in `ANGLE_STEP`."""

    prn: int
    mean_anomaly_at_reference: int
    node_longitude_at_reference: float
    argument_of_perigee: int
    inclination: int
    eccentricity: float
    harmonics: dict[str, float]
    clock_offset_steps: int
    clock_drift_multiple: int
    clock_phase: int
    group_delay: float
    group_delay_secondary: float


def nominal_gps_constellation(
    start: GpsTime, end: GpsTime, seed: int = 0
) -> tuple[BroadcastEphemeris, ...]:
    """Return the ephemerides of a 31-satellite GPS constellation for a time span.

    24 reference slots in six planes and seven auxiliary satellites, PRN 1 to 31 plane by plane,
    with seeded eccentricities (0.001 to 0.018), inclinations, clocks and TGD.

    Parameters
    ----------
    start, end : GpsTime
        The sets are valid (`vtff_gnss.orbits.ephemeris_selection`) all through this span.
    seed : int
        Seed of everything that the reference slots leave open. The satellites do not depend on the
        span: sets of one time are the same whatever the span asked for.

    Returns
    -------
    tuple of BroadcastEphemeris
        A set of each satellite every two hours, by time, then PRN. All values are exact numbers
        of the LNAV message, and orbit and clock run on continuously (1e-5 m) from set to set but
        for the turn of the GPS week, where rounding moves the node by up to 20 mm.

    Raises
    ------
    ValueError
        If `end` is before `start`.

    Notes
    -----
    Ground tracks repeat each sidereal day as those of the real satellites are kept to.
    """
    reference = parse_epoch(_GPS_EPOCH)
    gm = GRAVITATIONAL_PARAMETER_BROADCAST[SYSTEM_GPS]
    inclination = math.radians(_GPS_INCLINATION_DEG)
    # The period of two revolutions is that of the Earth below the turning node.
    keplerian = 2.0 * EARTH_ROTATION_RATE_BROADCAST
    node_rate, excess = _secular_rates(gm, keplerian, inclination)
    mean_motion = 2.0 * (EARTH_ROTATION_RATE_BROADCAST - node_rate)
    system = _System(
        number=SYSTEM_GPS,
        source=EPHEMERIS_SOURCE_LNAV,
        reference=reference,
        motion=lattice_motion(gm, mean_motion, excess),
        node_rate=node_rate,
        inclination=inclination,
        inclination_sigma=math.radians(0.5),
        eccentricities=(0.001, 0.018),
        clock_offset_step=2.0**-31,
        clock_drift_multiples=(-1, 0, 1),
        clock_offset_limit=4e-4,
        group_delay_step=2.0**-31,
        group_delay_limits=(-20e-9, 6e-9),
        accuracy=lnav_accuracy(0),
    )
    slots = [(node, u) for node, arguments in _GPS_PLANES_DEG for u in arguments]
    return _constellation(system, slots, start, end, seed)


def nominal_galileo_constellation(
    start: GpsTime, end: GpsTime, seed: int = 0
) -> tuple[BroadcastEphemeris, ...]:
    """Return the ephemerides of the 24-satellite Galileo Walker constellation for a time span.

    As `nominal_gps_constellation`, with PRN 1 to 24 plane by plane, I/NAV sets (the E1/E5b
    clock) whose BGDs of E5a and E5b are seeded, and nearly circular orbits.

    Raises
    ------
    ValueError
        If `end` is before `start`.
    """
    gm = GRAVITATIONAL_PARAMETER_BROADCAST[SYSTEM_GALILEO]
    inclination = math.radians(_GALILEO_INCLINATION_DEG)
    keplerian = math.sqrt(gm / _GALILEO_SEMI_MAJOR_AXIS**3)
    node_rate, excess = _secular_rates(gm, keplerian, inclination)
    system = _System(
        number=SYSTEM_GALILEO,
        source=EPHEMERIS_SOURCE_INAV,
        reference=parse_epoch(_GALILEO_EPOCH),
        motion=lattice_motion(gm, keplerian + excess, excess),
        node_rate=node_rate,
        inclination=inclination,
        inclination_sigma=math.radians(0.3),
        eccentricities=(0.0001, 0.0005),
        clock_offset_step=2.0**-34,
        clock_drift_multiples=(-4, -3, -2, -1, 0, 1, 2, 3, 4),
        clock_offset_limit=4e-4,
        group_delay_step=2.0**-32,
        group_delay_limits=(-10e-9, 10e-9),
        accuracy=galileo_accuracy(107),
    )
    planes, slots_per_plane = len(_GALILEO_NODES_DEG), _GALILEO_SLOTS_PER_PLANE
    between_slots = 360.0 / slots_per_plane
    # Walker phasing F = 1: one 24th of a turn from plane to plane.
    between_planes = 360.0 / (planes * slots_per_plane)
    slots = [
        (node, _GALILEO_FIRST_LATITUDE_DEG + plane * between_planes + slot * between_slots)
        for plane, node in enumerate(_GALILEO_NODES_DEG)
        for slot in range(slots_per_plane)
    ]
    return _constellation(system, slots, start, end, seed)


def _secular_rates(gm: float, mean_motion: float, inclination: float) -> tuple[float, float]:
    """Return the rates of node and of mean argument of latitude beyond Kepler by J2, rad/s.

    References
    ----------
    Vallado, Fundamentals of Astrodynamics and Applications, 4th edition, section 9.6.
    """
    axis = (gm / mean_motion**2) ** (1.0 / 3.0)
    factor = 0.75 * mean_motion * J2_EARTH * (RADIUS_EARTH_JGM3 / axis) ** 2
    sine_squared = math.sin(inclination) ** 2
    node_rate = -2.0 * factor * math.cos(inclination)
    # The rate that the messages will hold, for the mean motion of GPS follows from it.
    node_rate = node_rate_steps(node_rate)[0] * RATE_STEP
    return node_rate, factor * (6.0 - 8.0 * sine_squared)


def _constellation(
    system: _System,
    slots_deg: list[tuple[float, float]],
    start: GpsTime,
    end: GpsTime,
    seed: int,
) -> tuple[BroadcastEphemeris, ...]:
    if end < start:
        raise ValueError(f"end {end}: before start {start}")
    generator = np.random.default_rng((seed, system.number))
    satellites = [
        _satellite(system, prn, slot, generator) for prn, slot in enumerate(slots_deg, start=1)
    ]
    interval = SET_INTERVAL * NANOSECONDS_PER_SECOND
    first, last = start.nanoseconds // interval, end.nanoseconds // interval
    if system.number == SYSTEM_GPS:
        # A set is in use during the two hours before its reference time.
        first, last = first + 1, last + 1
    return tuple(
        _ephemeris(system, satellite, index)
        for index in range(first, last + 1)
        for satellite in satellites
    )


def _satellite(
    system: _System, prn: int, slot_deg: tuple[float, float], generator: np.random.Generator
) -> _Satellite:
    node_deg, latitude_argument_deg = slot_deg
    perigee = round(generator.uniform(-math.pi, math.pi) / ANGLE_STEP)
    drifts = system.clock_drift_multiples
    offset_limit = round(system.clock_offset_limit / system.clock_offset_step)
    drift_multiple = drifts[int(generator.integers(len(drifts)))]
    harmonics = {
        name: _on_grid(generator.normal(0.0, sigma), _HARMONIC_ANGLE_STEP)
        for name, sigma in _HARMONIC_ANGLE_SIGMAS.items()
    }
    for name, sigma in _HARMONIC_RADIUS_SIGMAS.items():
        mean = _mean_crc(system) if name == "crc" else 0.0
        harmonics[name] = _on_grid(generator.normal(mean, sigma), _HARMONIC_RADIUS_STEP)
    delay = _on_grid(generator.uniform(*system.group_delay_limits), system.group_delay_step)
    # The group delays of E5a and E5b of a satellite are nearly the same.
    second = _on_grid(delay + generator.normal(0.0, 0.5e-9), system.group_delay_step)
    greenwich = earth_rotation_angle(system.reference)
    return _Satellite(
        prn=prn,
        mean_anomaly_at_reference=round(math.radians(latitude_argument_deg) / ANGLE_STEP) - perigee,
        node_longitude_at_reference=math.radians(node_deg) - greenwich,
        argument_of_perigee=perigee,
        inclination=round(
            generator.normal(system.inclination, system.inclination_sigma) / ANGLE_STEP
        ),
        eccentricity=_on_grid(generator.uniform(*system.eccentricities), 2.0**-33),
        harmonics=harmonics,
        clock_offset_steps=0
        if drift_multiple
        else int(generator.integers(-offset_limit, offset_limit)),
        clock_drift_multiple=drift_multiple,
        clock_phase=int(generator.integers(100_000)),
        group_delay=delay,
        group_delay_secondary=second if system.number == SYSTEM_GALILEO else 0.0,
    )


def _ephemeris(system: _System, satellite: _Satellite, index: int) -> BroadcastEphemeris:
    """Return the set whose reference time is `index` set intervals after the GPS epoch."""
    week, set_of_week = divmod(index, _SETS_PER_WEEK)
    toe = float(set_of_week * SET_INTERVAL)
    is_gps = system.number == SYSTEM_GPS
    reference_index = system.reference.nanoseconds // (SET_INTERVAL * NANOSECONDS_PER_SECOND)
    mean_anomaly = (
        satellite.mean_anomaly_at_reference
        + (index - reference_index) * system.motion.steps_per_set
    )
    rate_steps, gained_steps = node_rate_steps(system.node_rate)
    node = _node_at_week_start(system, satellite, week, rate_steps) + set_of_week * gained_steps
    offset_steps, drift_steps = clock_steps(
        index, satellite.clock_phase, satellite.clock_drift_multiple, is_gps
    )
    reference = GpsTime.from_week_tow(week, toe)
    axis_root = system.motion.square_root_of_semi_major_axis
    return BroadcastEphemeris(
        time=reference - DEFAULT_FIT_INTERVAL / 2 if is_gps else reference,
        system=system.number,
        prn=satellite.prn,
        source=system.source,
        # IODC 0 to 239: the others tell of longer fit intervals (IS-GPS-200, table 20-XII).
        issue_of_data_ephemeris=index % 240 if is_gps else index % 1024,
        issue_of_data_clock=index % 240 if is_gps else index % 1024,
        health=0,
        gps_week=week,
        toe=toe,
        toc=toe,
        af0=(satellite.clock_offset_steps + offset_steps) * system.clock_offset_step,
        # Drift has 2^-12 of the resolution of the offset in both messages.
        af1=drift_steps * system.clock_offset_step * 2.0**-12,
        af2=0.0,
        semi_major_axis=axis_root * axis_root,
        eccentricity=satellite.eccentricity,
        inclination=satellite.inclination * ANGLE_STEP,
        inclination_rate=0.0,
        longitude_of_ascending_node=_angle(node),
        right_ascension_rate=rate_steps * RATE_STEP,
        argument_of_perigee=_angle(satellite.argument_of_perigee),
        mean_anomaly=_angle(mean_anomaly),
        mean_motion_difference=system.motion.mean_motion_difference,
        **satellite.harmonics,
        group_delay=satellite.group_delay,
        group_delay_secondary=satellite.group_delay_secondary,
        accuracy=system.accuracy,
        fit_interval=DEFAULT_FIT_INTERVAL,
    )


def _node_at_week_start(system: _System, satellite: _Satellite, week: int, rate_steps: int) -> int:
    """Return the longitude of the node at the start of a week, in `ANGLE_STEP`."""
    since_reference = GpsTime.from_week_tow(week, 0) - system.reference
    rate = rate_steps * RATE_STEP - EARTH_ROTATION_RATE_BROADCAST
    longitude = satellite.node_longitude_at_reference + rate * since_reference
    return round(math.remainder(longitude, 2.0 * math.pi) / ANGLE_STEP)


def _mean_crc(system: _System) -> float:
    """Return the radial harmonic that J2 makes, m (Kaula 1966, first order, circular orbit)."""
    axis = system.motion.square_root_of_semi_major_axis**2
    factor = J2_EARTH * RADIUS_EARTH_JGM3**2 / (4.0 * axis)
    return factor * math.sin(system.inclination) ** 2


def _on_grid(value: float, step: float) -> float:
    """Return the multiple of a step nearest to a value."""
    return round(value / step) * step


def _angle(steps: int) -> float:
    """Return an angle in `ANGLE_STEP` as rad in [-pi, pi)."""
    half = _ANGLE_STEPS_PER_TURN // 2
    return ((steps + half) % _ANGLE_STEPS_PER_TURN - half) * ANGLE_STEP
