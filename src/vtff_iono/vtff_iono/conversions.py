"""Conversions between the ionosphere algorithms and the messages of vtff_msgs."""

from __future__ import annotations

import array
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.frames.rtn import deputy_state_gcrf
from vtff_dynamics.time.local_time import mean_solar_local_time_hours
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.observations import OBSERVATION_COLUMNS
from vtff_gnss.signals import SignalKey
from vtff_iono.density.formation_density import DensityResult
from vtff_iono.edges.boundary import Boundary
from vtff_iono.scintillation.indices import ScintillationWindow
from vtff_iono.spacecraft.formation_second import FormationSecond
from vtff_iono.spacecraft.navigation_choice import NavigationChoice
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock, SlantTecEpoch
from vtff_msgs.msg import (
    AmbiguityStatus,
    ElectronDensity,
    GnssFix,
    GnssObservations,
    IrregularityBoundary,
    RelativeState,
    Scintillation,
    SlantTec,
)
from vtff_node.conversions.gnss import EARTH_FRAME, observations_from_message
from vtff_node.stamps import to_nanoseconds, to_stamp

__all__ = [
    "COMBINED_SYSTEM",
    "block_from_messages",
    "boundary_to_message",
    "density_to_message",
    "scintillation_to_message",
    "second_from_messages",
    "slant_tec_to_message",
]

COMBINED_SYSTEM = 255
"""System of the row that combines all satellites."""


def block_from_messages(messages: Sequence[GnssObservations]) -> ObservationBlock:
    """Return the observations of epochs, in the order of the messages.

    Raises
    ------
    ValueError
        If the arrays of a message are not all of one length.
    """
    epochs = [observations_from_message(message) for message in messages]
    times = np.array([epoch.time.nanoseconds for epoch in epochs], dtype=np.int64)
    counts = [len(epoch.prn) for epoch in epochs]
    columns_of_epochs = [epoch.columns() for epoch in epochs]
    columns = {
        name: np.concatenate(
            [np.zeros(0, dtype=kind), *(columns[name] for columns in columns_of_epochs)]
        )
        for name, kind in OBSERVATION_COLUMNS.items()
    }
    return ObservationBlock(np.repeat(times, counts), columns)


def second_from_messages(
    time: GpsTime,
    observations: Sequence[ObservationBlock],
    relative: Sequence[RelativeState | None],
    ambiguities: Sequence[AmbiguityStatus | None],
    fixes: Sequence[GnssFix | None],
    choice: NavigationChoice,
) -> FormationSecond:
    """Return the measurements of a second.

    Relative navigation gives the states and the integers. Where it is lost, the receivers' own
    solutions are the states, and its integers are left out, so that the integers found before hold
    on.

    Parameters
    ----------
    time : GpsTime
        End of the second.
    observations : sequence of ObservationBlock
        Observations of the chief and of each deputy.
    relative : sequence of RelativeState or None
        Relative state of each deputy at `time`, as far as it has come.
    ambiguities : sequence of AmbiguityStatus or None
        Integers of each deputy at `time`, as far as they have come.
    fixes : sequence of GnssFix or None
        Solutions of the receivers of the chief and each deputy at `time`, as far as they have come.
    choice : NavigationChoice
        Knows whether relative navigation was contradicted before.
    """
    states, are_trusted = choice.choose(
        time.nanoseconds,
        [None if state is None else _states_from_relative_state(state) for state in relative],
        [None if fix is None else _state_from_fix(fix) for fix in fixes],
    )
    integers = [
        _integers_from_message(status) if status is not None and is_trusted else {}
        for status, is_trusted in zip(ambiguities, are_trusted, strict=True)
    ]
    sigmas = [
        _relative_sigma(state) if state is not None and is_trusted else math.inf
        for state, is_trusted in zip(relative, are_trusted, strict=True)
    ]
    return FormationSecond(
        time.nanoseconds, tuple(observations), states, tuple(integers), tuple(sigmas)
    )


def _integers_from_message(message: AmbiguityStatus) -> dict[SignalKey, float]:
    """Return the fixed integers of a message, cycles relative to the reference of their group."""
    names = ("system", "prn", "band", "attribute", "ambiguity_cycles", "state")
    rows = zip(*(getattr(message, name).tolist() for name in names), strict=True)
    floating = AmbiguityStatus.STATE_FLOAT
    return {
        SignalKey(system, prn, band, attribute): cycles
        for system, prn, band, attribute, cycles, state in rows
        if state != floating
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


def _relative_sigma(message: RelativeState) -> float:
    """Return the sigma of the relative position, m; infinite without a solution."""
    # On the diagonal of a matrix of 6 rows.
    variance = float(sum(message.covariance[:15:7]))
    has_solution = message.solution != RelativeState.SOLUTION_NONE
    return math.sqrt(variance) if has_solution and variance >= 0.0 else math.inf


def slant_tec_to_message(epoch: SlantTecEpoch, spacecraft: str) -> SlantTec:
    """Return the message of the contents between a spacecraft and its satellites at one epoch."""
    message = SlantTec(child_frame_id=spacecraft)
    _set_header(message, epoch.time, antenna_frame(spacecraft))
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
    spacecraft: str,
) -> Scintillation:
    """Return the message of the indices of one window.

    Parameters
    ----------
    window : ScintillationWindow
    roti_tecu_per_minute : ndarray, shape (m,)
        ROTI of the signals of the window.
    window_length, roti_interval : float
        Length of the window, and interval of the rates of TEC, s.
    spacecraft : str
        Whose observations the indices are of.
    """
    message = Scintillation(
        window=window_length,
        sample_rate_hz=window.sample_rate_hz,
        phase_cutoff_hz=window.phase_cutoff_hz,
        roti_interval=roti_interval,
    )
    _set_header(message, window.time, antenna_frame(spacecraft))
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


def density_to_message(result: DensityResult, deputy: str) -> ElectronDensity:
    """Return the message of one second between the chief and a deputy.

    It has a row for each satellite; the last row is of all together.
    """
    epoch = result.epoch
    used = np.isfinite(epoch.density_satellite)
    message = ElectronDensity(
        position=result.position_itrf,
        altitude=epoch.altitude,
        vertical_separation=epoch.separation,
        child_frame_id=deputy,
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


def boundary_to_message(boundary: Boundary, spacecraft: str, deputy: str) -> IrregularityBoundary:
    """Return the message of an edge that a spacecraft has crossed or seen.

    Parameters
    ----------
    boundary : Boundary
    spacecraft : str
        Name of the spacecraft whose observations tell the edge.
    deputy : str
        Name of the deputy of the pair.
    """
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
        width=boundary.width,
        width_sigma=boundary.width_sigma,
        spacecraft=spacecraft,
        child_frame_id=deputy,
    )
    _set_header(message, boundary.time, EARTH_FRAME)
    return message


def antenna_frame(spacecraft: str) -> str:
    """Return the frame of the GNSS antenna of a spacecraft."""
    return f"{spacecraft}/gnss_antenna"


def _set_header(message: Any, gps_nanoseconds: int, frame_id: str) -> None:
    message.header.stamp = to_stamp(GpsTime(gps_nanoseconds).to_unix_nanoseconds())
    message.header.frame_id = frame_id


def _set_columns(message: Any, columns: Mapping[str, tuple[str, Any]]) -> None:
    for name, (kind, values) in columns.items():
        column = np.asarray(values).astype(kind)
        setattr(message, name, array.array(kind, column.tobytes()))
