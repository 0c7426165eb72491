"""Absolute slant and vertical TEC of one receiver, offline: a file of a station or of an orbit.

The contents come from the class that also runs online (`SlantTecProcessor`). Offline processing
replaces their levels by those of whole arcs, and estimates receiver biases from all data.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_LETTERS
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.orbits.ephemeris_selection import stores_by_system
from vtff_gnss.orbits.satellite_table import SatelliteOrbits
from vtff_iono.bias.bias_samples import BiasSamples, ReceiverBiasError
from vtff_iono.bias.profile_bias import ProfileBiases
from vtff_iono.bias.receiver_bias import ReceiverBias, content_sigma, estimate_receiver_biases
from vtff_iono.content.slant_tec import (
    WITHOUT_CONTENT,
    ArcLevels,
    BiasFunction,
    Rejection,
    SlantTecProcessor,
    SlantTecRows,
    no_bias,
)
from vtff_iono.geometry.satellite_geometry import SatelliteGeometry, geometry_from_stores
from vtff_iono.geometry.vertical_mapping import vertical_mapping
from vtff_iono.geometry.wind_up import count_wind_up, wind_up_cycles
from vtff_iono.links.arcs import arc_keys
from vtff_iono.links.signal_pairs import DEFAULT_PAIRS, Link, SignalPair

__all__ = ["AbsoluteTec", "BiasKey", "absolute_tec"]

BiasKey = tuple[int, str, str]
"""System and the two observation codes that share one receiver bias."""

# Ratio of standard deviation and median absolute deviation of a normal distribution.
_MEDIAN_TO_SIGMA = 1.0 / float(ndtri(0.75))


@dataclass(frozen=True, eq=False)
class AbsoluteTec:
    """Contents of all links at all epochs; arrays of shape (n,), one row for each link and epoch.

    Parameters
    ----------
    links : list of Link
        Links, indexed by ``rows.pairs.link``.
    rows : SlantTecRows
        Contents as online processing gives them, without receiver biases.
    stec_tecu, stec_sigma_tecu : ndarray
        Slant content with the level of the whole arc, all biases removed, and its sigma, TECU.
    vtec_tecu : ndarray
        Slant content mapped to the vertical above the receiver's altitude, TECU.
    azimuth : ndarray
        Azimuth of the satellite, rad.
    geometry : SatelliteGeometry
        Geometry of all given observations, including those without a link.
    pierce_latitude, pierce_longitude : ndarray
        Pierce point at the thin shell, or at half the shell height above an orbit, rad.
    rejected : ndarray of uint16
        `Rejection`; a row is good if it is 0.
    receiver_biases : dict of BiasKey to ReceiverBias
        Estimated receiver biases.
    remarks : tuple of str
        Sentences for the user about what could not be estimated.
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


def absolute_tec(
    time: npt.NDArray[np.int64],
    columns: dict[str, npt.NDArray],  # type: ignore[type-arg]
    position_receiver_itrf: npt.ArrayLike,
    orbits: Mapping[int, SatelliteOrbits] | Sequence[BroadcastEphemeris],
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
    orbits : mapping of int to SatelliteOrbits, or sequence of BroadcastEphemeris
        Orbits by ``SYSTEM_*``, or navigation messages.
    satellite_bias : BiasFunction
        Satellite biases to remove. The default removes nothing, as for simulated signals without
        biases.
    pairs : sequence of SignalPair
        Pairs of signals that form links. In each system the pair of codes with the most samples
        determines the ionosphere of the bias solution; the biases of its other pairs follow from
        comparison with it.
    """
    position = np.asarray(position_receiver_itrf, dtype=float)
    stores = orbits if isinstance(orbits, Mapping) else stores_by_system(orbits)
    geometry = geometry_from_stores(stores, time, columns["system"], columns["prn"], position)
    processor = SlantTecProcessor(satellite_bias, pairs=pairs)
    rows = processor.update(time, columns, geometry.elevation)
    levels = ArcLevels(rows)
    first = rows.pairs.row_first
    direction = geometry.direction_itrf[first]
    position_of_rows = np.broadcast_to(
        position if position.ndim == 1 else position[first], (len(rows), 3)
    )
    is_content = ((rows.rejected & WITHOUT_CONTENT) == 0) & np.isfinite(levels.stec_tecu)
    key_of_link = [(link.system, link.code_first, link.code_second) for link in processor.links]
    wind_up = np.zeros(len(rows))
    if position.ndim > 1:
        wind_up = _wind_up_tecu(rows, processor.links, geometry, position_of_rows)
    biases, profile, remarks = _receiver_biases(
        rows, levels, direction, position_of_rows, wind_up, is_content, key_of_link
    )
    # The last element is that of rows without a link, whose number is -1.
    bias_of_link = [biases[key].bias_tecu if key in biases else 0.0 for key in key_of_link]
    bias = np.array([*bias_of_link, 0.0])
    lacks_bias = np.array([*(key not in biases for key in key_of_link), False])[rows.pairs.link]
    sigma = content_sigma(
        levels.stec_sigma_tecu,
        rows.satellite_bias_sigma_tecu,
        [biases.get(key) for key in key_of_link],
        rows.pairs.link,
    )
    stec = levels.stec_tecu - bias[rows.pairs.link]
    if profile is not None:
        keys = arc_keys(rows.pairs.link, rows.arc)
        index = np.minimum(np.searchsorted(profile.arc, keys), len(profile.arc) - 1)
        is_known = profile.arc[index] == keys
        contents = levels.stec_tecu - profile.offset_tecu[index] - profile.wind_up * wind_up
        stec = np.where(is_known, contents, stec)
        sigma = np.where(is_known, profile.offset_sigma_tecu[index], sigma)
    vertical = vertical_mapping(position_of_rows, direction, rows.elevation)
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
        | np.where(lacks_bias, np.uint16(Rejection.NO_RECEIVER_BIAS), np.uint16(0)),
        receiver_biases=biases,
        remarks=remarks,
    )


def _wind_up_tecu(
    rows: SlantTecRows, links: list[Link], geometry: SatelliteGeometry, position: FloatArray
) -> FloatArray:
    """Return what the wind-up of rows since their arcs began looks like, TECU, shape (n,)."""
    first = rows.pairs.row_first
    cycles = wind_up_cycles(
        position,
        geometry.direction_itrf[first],
        geometry.range[first],
        geometry.velocity_satellite_itrf[first],
    )
    tecu_per_cycle = np.array([*(link.tecu_per_cycle for link in links), 0.0])[rows.pairs.link]
    return tecu_per_cycle * count_wind_up(arc_keys(rows.pairs.link, rows.arc), cycles)


def _receiver_biases(
    rows: SlantTecRows,
    levels: ArcLevels,
    direction: FloatArray,
    position: FloatArray,
    wind_up: FloatArray,
    is_content: npt.NDArray[np.bool_],
    key_of_link: list[BiasKey],
) -> tuple[dict[BiasKey, ReceiverBias], ProfileBiases | None, tuple[str, ...]]:
    """Return the biases of all pairs of codes, their profile, and remarks on those without bias.

    Samples of a pair of codes of one system share one bias; they are called a group here.
    """
    groups = sorted(set(key_of_link))
    group_of_link = np.array([*(groups.index(key) for key in key_of_link), -1])
    group = np.where(is_content, group_of_link[rows.pairs.link], -1)
    primary_groups = _primary_groups(groups, group)
    # Number of each primary group among the primary ones, as the samples want it.
    index_of_primary = {number: index for index, number in enumerate(primary_groups)}
    is_primary = np.isin(group, primary_groups)
    samples = BiasSamples(
        time=np.asarray(1e-9 * (rows.pairs.time - rows.pairs.time[:1])[is_primary], dtype=float),
        group=np.array([index_of_primary.get(number, 0) for number in range(len(groups))])[
            group[is_primary]
        ],
        stec_tecu=levels.stec_tecu[is_primary],
        stec_sigma_tecu=levels.stec_sigma_tecu[is_primary],
        elevation=rows.elevation[is_primary],
        direction_itrf=direction[is_primary],
        position_receiver_itrf=position[is_primary],
        arc=arc_keys(rows.pairs.link, rows.arc)[is_primary],
        link=rows.pairs.link[is_primary],
        satellite_sigma_tecu=rows.satellite_bias_sigma_tecu[is_primary],
        wind_up_tecu=wind_up[is_primary],
    )
    try:
        estimates, profile = estimate_receiver_biases(samples)
    except ReceiverBiasError as error:
        return {}, None, (f"{error}; contents include the receiver bias",)
    biases = {groups[number]: estimates[index] for number, index in index_of_primary.items()}
    remarks = []
    for number, key in enumerate(groups):
        if number in index_of_primary:
            continue
        bias = None
        references = [other for other in primary_groups if groups[other][0] == key[0]]
        if references:
            reference_bias = biases[groups[references[0]]]
            bias = _compare_groups(rows, levels, group, number, references[0], reference_bias)
        if bias is None:
            remarks.append(
                f"receiver bias {SYSTEM_LETTERS[key[0]]} {key[1]}-{key[2]}: no samples to "
                "estimate it from"
            )
        else:
            biases[key] = bias
    return biases, profile, tuple(remarks)


def _primary_groups(groups: list[BiasKey], group: npt.NDArray[np.int64]) -> list[int]:
    """Return the number of the group with the most samples in each system, without empty ones.

    `group` is the number of the group of each row, -1 for rows that are not used.
    """
    counts = np.bincount(group[group >= 0], minlength=len(groups))
    primary = []
    for system in sorted({key[0] for key in groups}):
        numbers = [number for number, key in enumerate(groups) if key[0] == system]
        largest = max(numbers, key=lambda number: counts[number])
        if counts[largest] > 0:
            primary.append(largest)
    return primary


def _epoch_satellite_keys(rows: SlantTecRows) -> npt.NDArray[np.int64]:
    """Return one integer for each satellite at each epoch."""
    epoch = np.unique(rows.pairs.time, return_inverse=True)[1].astype(np.int64)
    satellites = int(rows.pairs.satellite.max(initial=0)) + 1
    return epoch * satellites + rows.pairs.satellite


def _compare_groups(
    rows: SlantTecRows,
    levels: ArcLevels,
    group: npt.NDArray[np.int64],
    number: int,
    reference: int,
    reference_bias: ReceiverBias,
) -> ReceiverBias | None:
    """Return the bias of a group from a reference group of the same satellites at the same time.

    None if the groups have no satellite in common. `group` is the number of the group of each row.
    """
    key = _epoch_satellite_keys(rows)
    group_rows, reference_rows = np.flatnonzero(group == number), np.flatnonzero(group == reference)
    _, index, reference_index = np.intersect1d(
        key[group_rows], key[reference_rows], return_indices=True
    )
    if len(index) == 0:
        return None
    group_rows, reference_rows = group_rows[index], reference_rows[reference_index]
    difference = levels.stec_tecu[group_rows] - levels.stec_tecu[reference_rows]
    # Levels are constant over an arc: as many independent differences as there are arcs.
    arcs = len(np.unique(arc_keys(rows.pairs.link[group_rows], rows.arc[group_rows])))
    middle = float(np.median(difference))
    spread = _MEDIAN_TO_SIGMA * float(np.median(np.abs(difference - middle)))
    scatter = spread / math.sqrt(arcs)
    return ReceiverBias(
        bias_tecu=reference_bias.bias_tecu + middle,
        sigma_tecu=math.hypot(reference_bias.sigma_tecu, scatter),
        sampling_sigma_tecu=math.hypot(reference_bias.sampling_sigma_tecu, scatter),
        spread_tecu=reference_bias.spread_tecu,
        model_tecu=tuple(value + middle for value in reference_bias.model_tecu),
        is_bounded=reference_bias.is_bounded,
        pairs=len(index),
    )
