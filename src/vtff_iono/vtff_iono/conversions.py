"""Between the ionosphere algorithms and the messages of vtff_msgs."""

from __future__ import annotations

import array
import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vtff_dynamics.frames.frames import (
    deputy_state_gcrf,
    geodetic_from_itrf,
    mean_solar_local_time_hours,
    state_gcrf_to_itrf,
)
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.observations import OBSERVATION_COLUMNS
from vtff_iono.density.formation_density import DensityResult
from vtff_iono.edges.formation_boundaries import Boundary
from vtff_iono.scintillation.indices import ScintillationWindow
from vtff_iono.spacecraft.formation_second import FormationSecond, Group
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock, SlantTecEpoch
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
)
from vtff_node.stamps import to_nanoseconds, to_stamp

__all__ = [
    "COMBINED_SYSTEM",
    "block_from_messages",
    "boundary_to_message",
    "density_to_message",
    "ephemeris_from_message",
    "scintillation_to_message",
    "second_from_messages",
    "slant_tec_to_message",
]

EARTH_FRAME = "earth"
COMBINED_SYSTEM = 255
"""System of the row that combines all satellites."""

# Beyond any error of a receiver's own solution, m; that of a relative state is far smaller.
_LARGEST_CONTRADICTION = 50.0

_EPHEMERIS_FIELDS = tuple(
    field.name for field in dataclasses.fields(BroadcastEphemeris) if field.name != "time"
)


def block_from_messages(messages: Sequence[GnssObservations]) -> ObservationBlock:
    """Return the observations of epochs, in the order of the messages."""
    counts = [len(message.prn) for message in messages]
    times = [
        GpsTime.from_week_tow(message.gps_week, message.gps_time_of_week).nanoseconds
        for message in messages
    ]
    columns = {
        name: np.concatenate(
            [np.zeros(0, dtype=kind), *(np.asarray(getattr(m, name), dtype=kind) for m in messages)]
        )
        for name, kind in OBSERVATION_COLUMNS.items()
    }
    return ObservationBlock(np.repeat(np.array(times, dtype=np.int64), counts), columns)


def ephemeris_from_message(message: GnssEphemeris) -> BroadcastEphemeris:
    """Return the ephemeris of a message."""
    return BroadcastEphemeris(
        time=GpsTime.from_unix_nanoseconds(to_nanoseconds(message.header.stamp)),
        **{name: getattr(message, name) for name in _EPHEMERIS_FIELDS},
    )


def second_from_messages(
    time: GpsTime,
    observations: tuple[ObservationBlock, ObservationBlock],
    relative: RelativeState | None,
    ambiguities: AmbiguityStatus | None,
    fixes: Sequence[GnssFix | None],
) -> FormationSecond:
    """Return what is known of a second.

    Relative navigation tells positions and integers. Where it has lost its way, which the
    receivers' own solutions show, those take its place and its integers are left out: those found
    before hold on.

    Parameters
    ----------
    time : GpsTime
        End of the second.
    observations : tuple of ObservationBlock
        Of chief and deputy.
    relative, ambiguities : RelativeState, AmbiguityStatus or None
        At `time`, as far as they have come.
    fixes : sequence of GnssFix or None
        The same of chief and deputy.
    """
    own = [None if fix is None else _state_from_fix(fix) for fix in fixes]
    told = None if relative is None else _states_from_relative_state(relative)
    is_lost = told is not None and any(
        fix is not None and np.linalg.norm(fix[:3] - state[:3]) > _LARGEST_CONTRADICTION
        for fix, state in zip(own, told, strict=True)
    )
    states = own if told is None or is_lost else told
    known = {} if ambiguities is None or is_lost else _integers_from_message(ambiguities)
    return FormationSecond(time.nanoseconds, observations, (states[0], states[1]), known)


def _integers_from_message(message: AmbiguityStatus) -> dict[tuple[Group, int], float]:
    """Return the integers of a message, cycles relative to the reference of their group."""
    names = ("system", "band", "attribute", "prn", "ambiguity_cycles", "state")
    rows = zip(*(getattr(message, name).tolist() for name in names), strict=True)
    return {
        ((system, band, attribute), prn): cycles
        for system, band, attribute, prn, cycles, state in rows
        if state != AmbiguityStatus.STATE_FLOAT
    }


def _state_from_fix(message: GnssFix) -> FloatArray | None:
    """Return position and velocity of a receiver's own solution, shape (6,); None without one."""
    state = np.concatenate((message.position, message.velocity))
    return state if np.isfinite(state).all() else None


def _states_from_relative_state(message: RelativeState) -> tuple[FloatArray, FloatArray] | None:
    """Return the Earth-fixed states (6,) of chief and deputy; None if there is no solution."""
    if message.solution == RelativeState.SOLUTION_NONE:
        return None
    time = GpsTime.from_unix_nanoseconds(to_nanoseconds(message.header.stamp))
    chief = np.concatenate((message.position_chief_gcrf, message.velocity_chief_gcrf))
    deputy = deputy_state_gcrf(chief, np.concatenate((message.position, message.velocity)))
    states = state_gcrf_to_itrf(time, chief), state_gcrf_to_itrf(time, deputy)
    return states if np.isfinite(states).all() else None


def slant_tec_to_message(epoch: SlantTecEpoch, frame_id: str) -> SlantTec:
    """Return the message of the contents of one epoch."""
    message = SlantTec()
    _set_header(message, epoch.time, frame_id)
    links = epoch.links
    _set_columns(
        message,
        {
            "system": ("B", [link.system for link in links]),
            "prn": ("B", [link.prn for link in links]),
            "band_first": ("B", [link.band_first for link in links]),
            "band_second": ("B", [link.band_second for link in links]),
            "stec_tecu": ("d", epoch.stec_tecu),
            "stec_sigma_tecu": ("f", epoch.stec_sigma_tecu),
            "stec_code_tecu": ("d", epoch.stec_code_tecu),
            "vtec_tecu": ("f", epoch.vtec_tecu),
            "elevation": ("f", epoch.elevation),
            "azimuth": ("f", epoch.azimuth),
            "pierce_latitude_deg": ("f", np.degrees(epoch.pierce_latitude)),
            "pierce_longitude_deg": ("f", np.degrees(epoch.pierce_longitude)),
            "arc": ("I", epoch.arc),
            "rejected": ("H", epoch.rejected),
        },
    )
    return message


def scintillation_to_message(
    window: ScintillationWindow,
    roti_tecu_per_minute: FloatArray,
    window_length: float,
    roti_interval: float,
    frame_id: str,
) -> Scintillation:
    """Return the message of the indices of one window; lengths in s."""
    message = Scintillation(
        window=window_length,
        sample_rate_hz=window.sample_rate_hz,
        phase_cutoff_hz=window.phase_cutoff_hz,
        roti_interval=roti_interval,
    )
    _set_header(message, window.time, frame_id)
    floats = ("s4", "s4_corrected", "s4_pseudo", "sigma_phi", "cn0_dbhz", "elevation", "azimuth")
    _set_columns(
        message,
        {
            **{n: ("B", getattr(window, n)) for n in ("system", "prn", "band", "attribute")},
            **{name: ("f", getattr(window, name)) for name in floats},
            "roti_tecu_per_minute": ("f", roti_tecu_per_minute),
            "samples": ("I", window.samples),
        },
    )
    return message


def density_to_message(result: DensityResult) -> ElectronDensity:
    """Return the message of the density of one second: a row a satellite, the last one of all."""
    epoch = result.epoch
    used = np.isfinite(epoch.density_satellite)
    message = ElectronDensity(
        position=result.position_itrf,
        altitude=epoch.altitude,
        vertical_separation=epoch.separation,
    )
    _set_header(message, result.time, EARTH_FRAME)
    _set_columns(
        message,
        {
            "system": ("B", [*result.system[used], COMBINED_SYSTEM]),
            "prn": ("B", [*result.prn[used], 0]),
            "density": ("d", [*epoch.density_satellite[used], epoch.density]),
            "density_sigma": ("d", [*epoch.sigma_satellite[used], epoch.sigma]),
        },
    )
    return message


def boundary_to_message(boundary: Boundary, spacecraft: str) -> IrregularityBoundary:
    """Return the message of an edge; `spacecraft` is the name of the one that tells it."""
    latitude, longitude, altitude = geodetic_from_itrf(boundary.position_itrf)
    time = GpsTime(boundary.time)
    message = IrregularityBoundary(
        kind=int(boundary.kind),
        source=int(boundary.source),
        entry=boundary.is_entry,
        system=boundary.system,
        prn=boundary.prn,
        time_sigma=boundary.time_sigma,
        position=boundary.position_itrf,
        latitude_deg=math.degrees(latitude),
        longitude_deg=math.degrees(longitude),
        altitude=float(altitude),
        local_time_hours=mean_solar_local_time_hours(time, float(longitude)),
        confidence=boundary.confidence,
        spacecraft=spacecraft,
    )
    _set_header(message, boundary.time, EARTH_FRAME)
    return message


def _set_header(message: Any, gps_nanoseconds: int, frame_id: str) -> None:
    message.header.stamp = to_stamp(GpsTime(gps_nanoseconds).to_unix_nanoseconds())
    message.header.frame_id = frame_id


def _set_columns(message: Any, columns: Mapping[str, tuple[str, Any]]) -> None:
    for name, (kind, values) in columns.items():
        column = np.asarray(values).astype(kind)
        setattr(message, name, array.array(kind, column.tobytes()))
