"""Absolute slant and vertical TEC of one receiver after the fact: a file of a station or an orbit.

The classes are those that run online (`SlantTecProcessor`); on top of their numbers come the levels
of whole arcs and receiver biases estimated from all data.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_LETTERS
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_iono.bias.bias_samples import BiasSamples, ReceiverBiasError
from vtff_iono.bias.receiver_bias import ReceiverBias, content_sigma, estimate_receiver_biases
from vtff_iono.content.slant_tec import (
    ArcLevels,
    BiasFunction,
    Rejection,
    SlantTecProcessor,
    SlantTecRows,
    no_bias,
)
from vtff_iono.geometry.satellite_geometry import SatelliteGeometry, geometry_from_stores
from vtff_iono.geometry.vertical_mapping import vertical_mapping
from vtff_iono.links.signal_pairs import DEFAULT_PAIRS, Link, SignalPair

__all__ = ["AbsoluteTec", "BiasKey", "absolute_tec"]

BiasKey = tuple[int, str, str]
"""System and the two observation codes that a receiver bias belongs to."""

# A sample with one of these says nothing about the receiver bias.
_NO_CONTENT = np.uint16(
    (1 << 16) - 1 - Rejection.CODE_OUTLIER - Rejection.CODE_INVALID - Rejection.NO_RECEIVER_BIAS
)


@dataclass(frozen=True, eq=False)
class AbsoluteTec:
    """Contents of all links at all epochs; arrays of shape (n,), one row each.

    Parameters
    ----------
    links : list of Link
        Indexed by ``rows.pairs.link``.
    rows : SlantTecRows
        What runs online gives, without receiver biases.
    stec_tecu, stec_sigma_tecu : ndarray
        With the level of the whole arc, all biases removed.
    vtec_tecu : ndarray
        Mapped to the vertical above the receiver's altitude.
    azimuth : ndarray
        rad.
    geometry : SatelliteGeometry
        Of all observations that were given, those without a link too.
    pierce_latitude, pierce_longitude : ndarray
        rad; at the thin shell, or at half the shell height above an orbit.
    rejected : ndarray of uint16
        `Rejection`; a row is good if it is 0.
    receiver_biases : dict of BiasKey to ReceiverBias
    remarks : tuple of str
        What could not be done, for people.
    """

    links: list[Link]
    rows: SlantTecRows
    stec_tecu: FloatArray
    stec_sigma_tecu: FloatArray
    vtec_tecu: FloatArray
    azimuth: FloatArray
    geometry: SatelliteGeometry
    pierce_latitude: FloatArray
    pierce_longitude: FloatArray
    rejected: npt.NDArray[np.uint16]
    receiver_biases: dict[BiasKey, ReceiverBias]
    remarks: tuple[str, ...]


def _geometry_by_system(
    ephemerides: Sequence[BroadcastEphemeris],
    time: npt.NDArray[np.int64],
    columns: Mapping[str, npt.NDArray],  # type: ignore[type-arg]
    position_receiver_itrf: npt.ArrayLike,
) -> SatelliteGeometry:
    """Return the geometry of all observations; arguments as in `geometry_from_stores`."""
    # An unhealthy satellite is where it says, and its signals pass the same ionosphere.
    stores = {
        system: EphemerisStore([e for e in ephemerides if e.system == system], healthy_only=False)
        for system in np.unique(columns["system"]).tolist()
    }
    return geometry_from_stores(
        stores, time, columns["system"], columns["prn"], position_receiver_itrf
    )


def absolute_tec(
    time: npt.NDArray[np.int64],
    columns: dict[str, npt.NDArray],  # type: ignore[type-arg]
    position_receiver_itrf: npt.ArrayLike,
    ephemerides: Sequence[BroadcastEphemeris],
    satellite_bias: BiasFunction = no_bias,
    pairs: Sequence[SignalPair] = DEFAULT_PAIRS,
) -> AbsoluteTec:
    """Return absolute TEC with receiver biases estimated from the data themselves.

    Parameters
    ----------
    time : ndarray of int64, shape (m,)
        GPS time of every observation, ns since 1980-01-06, not decreasing.
    columns : dict of str to ndarray, shape (m,)
        Columns of `vtff_gnss.observations.OBSERVATION_COLUMNS`.
    position_receiver_itrf : array_like, shape (3,) or (m, 3)
        m; NaN where unknown.
    ephemerides : sequence of BroadcastEphemeris
    satellite_bias : BiasFunction
        None removed by default, as for simulated signals without biases.
    pairs : sequence of SignalPair
        The first one of each system steers the ionosphere of the bias solution; the biases of the
        others follow from comparison with it.
    """
    position = np.asarray(position_receiver_itrf, dtype=float)
    geometry = _geometry_by_system(ephemerides, time, columns, position)
    processor = SlantTecProcessor(satellite_bias, pairs=pairs)
    rows = processor.update(time, columns, geometry.elevation)
    levels = ArcLevels(rows)
    first = rows.pairs.row_first
    direction = geometry.direction_itrf[first]
    place = position if position.ndim == 1 else position[first]
    place = np.broadcast_to(place, (len(rows), 3))
    is_content = ((rows.rejected & _NO_CONTENT) == 0) & np.isfinite(levels.stec_tecu)
    key_of_link = [(link.system, link.code_first, link.code_second) for link in processor.links]
    biases, remarks = _receiver_biases(rows, levels, direction, place, is_content, key_of_link)
    bias = np.array([biases[k].bias_tecu if k in biases else 0.0 for k in key_of_link] + [0.0])
    sigma = content_sigma(
        levels.stec_sigma_tecu,
        rows.satellite_bias_sigma_tecu,
        [biases.get(key) for key in key_of_link],
        rows.pairs.link,
    )
    unknown = np.array([k not in biases for k in key_of_link] + [False])[rows.pairs.link]
    stec = levels.stec_tecu - bias[rows.pairs.link]
    vertical = vertical_mapping(place, direction, rows.elevation)
    return AbsoluteTec(
        links=processor.links,
        rows=rows,
        stec_tecu=stec,
        stec_sigma_tecu=sigma,
        vtec_tecu=stec / vertical.factor,
        azimuth=geometry.azimuth[first],
        geometry=geometry,
        pierce_latitude=vertical.pierce_latitude,
        pierce_longitude=vertical.pierce_longitude,
        rejected=rows.rejected
        | np.where(unknown, np.uint16(Rejection.NO_RECEIVER_BIAS), np.uint16(0)),
        receiver_biases=biases,
        remarks=remarks,
    )


def _receiver_biases(
    rows: SlantTecRows,
    levels: ArcLevels,
    direction: FloatArray,
    position: FloatArray,
    is_content: npt.NDArray[np.bool_],
    key_of_link: list[BiasKey],
) -> tuple[dict[BiasKey, ReceiverBias], tuple[str, ...]]:
    """Return the biases of all pairs of codes, and what could not be estimated."""
    groups = sorted(set(key_of_link))
    number = np.array([groups.index(key) for key in key_of_link] + [-1])[rows.pairs.link]
    number = np.where(is_content, number, -1)
    counts = np.bincount(number[number >= 0], minlength=len(groups))
    primary = [
        max((g for g in range(len(groups)) if groups[g][0] == system), key=lambda g: counts[g])
        for system in sorted({key[0] for key in groups})
    ]
    primary = [g for g in primary if counts[g] > 0]
    place = {g: index for index, g in enumerate(primary)}
    chosen = np.isin(number, primary)
    samples = BiasSamples(
        time=np.asarray(1e-9 * (rows.pairs.time - rows.pairs.time[:1])[chosen], dtype=float),
        group=np.array([place.get(g, 0) for g in range(len(groups))])[number[chosen]],
        stec_tecu=levels.stec_tecu[chosen],
        stec_sigma_tecu=levels.stec_sigma_tecu[chosen],
        elevation=rows.elevation[chosen],
        direction_itrf=direction[chosen],
        position_receiver_itrf=position[chosen],
        arc=(rows.pairs.link << 32 | rows.arc)[chosen],
        link=rows.pairs.link[chosen],
        satellite_sigma_tecu=rows.satellite_bias_sigma_tecu[chosen],
    )
    try:
        estimated = estimate_receiver_biases(samples)
    except ReceiverBiasError as error:
        return {}, (f"{error}; contents include the receiver bias",)
    biases = {groups[g]: estimated[index] for g, index in place.items()}
    remarks = []
    for g, key in enumerate(groups):
        if g in place:
            continue
        reference = [p for p in primary if groups[p][0] == key[0]]
        found = _compared(rows, levels, number, g, reference, biases, groups)
        if found is None:
            letter = SYSTEM_LETTERS[key[0]]
            remarks.append(f"receiver bias {letter} {key[1]}-{key[2]}: no samples to tell it")
        else:
            biases[key] = found
    return biases, tuple(remarks)


def _compared(
    rows: SlantTecRows,
    levels: ArcLevels,
    number: npt.NDArray[np.int64],
    group: int,
    reference: list[int],
    biases: dict[BiasKey, ReceiverBias],
    groups: list[BiasKey],
) -> ReceiverBias | None:
    """Return the bias of a pair from another pair of the same satellites at the same time."""
    if not reference:
        return None
    epoch = np.unique(rows.pairs.time, return_inverse=True)[1]
    key = epoch << 10 | rows.pairs.satellite
    mine, theirs = np.flatnonzero(number == group), np.flatnonzero(number == reference[0])
    _, one, other = np.intersect1d(key[mine], key[theirs], return_indices=True)
    if len(one) == 0:
        return None
    known = biases[groups[reference[0]]]
    difference = levels.stec_tecu[mine[one]] - levels.stec_tecu[theirs[other]]
    # Levels are constant over an arc: as many independent differences as there are arcs.
    arcs = len(np.unique(rows.pairs.link[mine[one]] << 32 | rows.arc[mine[one]]))
    middle = float(np.median(difference))
    scatter = 1.4826 * float(np.median(np.abs(difference - middle))) / math.sqrt(arcs)
    return ReceiverBias(
        bias_tecu=known.bias_tecu + middle,
        sigma_tecu=math.hypot(known.sigma_tecu, scatter),
        sampling_sigma_tecu=math.hypot(known.sampling_sigma_tecu, scatter),
        spread_tecu=known.spread_tecu,
        model_tecu=tuple(value + middle for value in known.model_tecu),
        is_bounded=known.is_bounded,
        pairs=len(one),
    )
