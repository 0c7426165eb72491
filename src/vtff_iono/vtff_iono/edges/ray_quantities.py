"""Quantities that show each second whether a ray crosses an irregularity.

They are the variance of the intensity relative to that of noise (S4), the spread of the rate of TEC
(ROTI), and the gradient of TEC. Vertical motion of the spacecraft changes the contents of all
satellites alike, so that the median of the rates, mapped to the vertical, is removed first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import satellite_number
from vtff_iono.edges.boundary import BoundarySource
from vtff_iono.edges.edge_detectors import intensity_variance
from vtff_iono.geometry.mapping import mapping_factor
from vtff_iono.scintillation.indices import linear_power, noise_s4
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftSeries

__all__ = ["ContentRates", "RayGroups", "RayQuantities", "variance_ratios"]

IntArray = npt.NDArray[np.int64]

# Fewest epochs of a second in which the variance of the intensity is looked at.
_FEWEST_EPOCHS = 10
# Part of the epochs of a second in which a signal must have samples.
_COVERAGE = 0.9
# Seconds over which the rates of a ray are averaged, and over which their spread is computed.
_RATE_SECONDS = 5
# Fewest rays whose median shows the vertical motion.
_FEWEST_RATES = 4
_SECONDS_PER_MINUTE = 60.0
_KILOMETRES_PER_METRE = 1e-3
# ns; the end of a second that has not been.
_NEVER = -(2**62)


class RayQuantities(NamedTuple):
    """Quantities of rays, second by second; arrays of shape (n,).

    Attributes
    ----------
    group : ndarray of int
        Group of rows of the ray, see `RayGroups`.
    source : ndarray of int
        Which quantity it is, a `BoundarySource`.
    value : ndarray
        Variance of the intensity relative to that of noise, ROTI (TECU/min) or gradient (TECU/km).
    """

    group: IntArray
    source: IntArray
    value: FloatArray


@dataclass(frozen=True, eq=False)
class RayGroups:
    """Rows of links, those of each link and second together; m groups by second and link.

    Parameters
    ----------
    order : ndarray of int, shape (n,)
        Rows with a link, group by group, in each by time.
    first : ndarray of int, shape (m + 1,)
        Where each group begins in `order`; last their number.
    second, link : ndarray of int, shape (m,)
        Second, counted from the beginning of the series, and link of each group.
    """

    order: IntArray
    first: IntArray
    second: IntArray
    link: IntArray

    @classmethod
    def of(cls, series: SpacecraftSeries) -> RayGroups:
        """Return the groups of the rows of a series."""
        link = series.rows.pairs.link
        order, groups = _group_rows(series.first_row, link, int(link.max(initial=-1)) + 1)
        first, second, link_of_group = groups
        return cls(order, first, second[:-1], link_of_group[:-1])

    def last_rows(self) -> IntArray:
        """Return the last row of each group, shape (m,)."""
        return self.order[self.first[1:] - 1]


# ---- intensity -----------------------------------------------------------------------------------


def variance_ratios(
    series: SpacecraftSeries, groups: RayGroups, elevation_mask: float
) -> RayQuantities:
    """Return the variances of the intensity in each second relative to that of noise.

    They are those of the first signal of each satellite.

    Parameters
    ----------
    series : SpacecraftSeries
        Observations and results, a block for each second.
    groups : RayGroups
        Groups of its rows.
    elevation_mask : float
        Lowest elevation of rays whose intensity is looked at, rad.
    """
    rows, columns = series.rows, series.block.columns
    observation = rows.pairs.row_first[groups.order[groups.first[:-1]]]
    satellite = satellite_number(columns["system"][observation], columns["prn"][observation])
    chosen, lengths = _choose_rays(
        series.first_row,
        rows.pairs.time,
        rows.elevation,
        groups.order,
        groups.first,
        groups.second,
        satellite,
        elevation_mask,
        _FEWEST_EPOCHS,
        _COVERAGE,
    )
    counts = groups.first[chosen + 1] - groups.first[chosen]
    ratios = np.empty(len(chosen))
    # Links with equal numbers of samples, as a rule all links, are computed together.
    for count in np.unique(counts).tolist():
        of_count = np.flatnonzero(counts == count)
        table = groups.first[chosen[of_count], np.newaxis] + np.arange(count)
        power = linear_power(columns["cn0_dbhz"][rows.pairs.row_first[groups.order[table]]])
        noise = noise_s4(10.0 * np.log10(power.mean(axis=-1)), lengths[of_count]) ** 2
        ratios[of_count] = intensity_variance(power) / noise
    return RayQuantities(chosen, np.full(len(chosen), int(BoundarySource.S4)), ratios)


# ---- rate of TEC ---------------------------------------------------------------------------------


class ContentRates:
    """Rates of the contents of one spacecraft's links over the last seconds.

    Parameters
    ----------
    elevation_mask : float
        Lowest elevation of rays whose rate of TEC is looked at, rad.
    """

    def __init__(self, elevation_mask: float) -> None:
        self._elevation_mask = elevation_mask
        # By link: end (ns) and arc of the last second with a content, and its mean content (TECU).
        self._last_second = np.zeros((2, 0), dtype=np.int64)
        self._last_content = np.zeros(0)
        # By link: ends (ns) of the last seconds with a rate, the latest last, and these rates.
        self._ends = np.zeros((0, _RATE_SECONDS), dtype=np.int64)
        self._rates = np.zeros((0, _RATE_SECONDS))

    def update(self, series: SpacecraftSeries, groups: RayGroups) -> RayQuantities:
        """Process the next seconds; return ROTI and gradients of links with rates for long enough.

        Parameters
        ----------
        series : SpacecraftSeries
            Observations and results of the spacecraft, a block for each second.
        groups : RayGroups
            Groups of its rows.
        """
        self._make_room(int(groups.link.max(initial=-1)) + 1)
        rows, position = series.rows, series.position_itrf
        begins, ends = series.first_observation[:-1], series.first_observation[1:] - 1
        has_rows = np.diff(series.first_row) > 0
        is_placed = has_rows.copy()
        is_placed[has_rows] = np.isfinite(position[ends[has_rows]]).all(axis=1)
        found, contents = _content_changes(
            series.first_row,
            rows.pairs.time,
            is_placed,
            groups.order,
            groups.first,
            groups.second,
            groups.link,
            rows.arc,
            rows.elevation,
            rows.stec_phase_tecu,
            self._elevation_mask,
            _FEWEST_RATES,
            self._last_second,
            self._last_content,
        )
        group, second_of_change = found
        if not len(group):
            return RayQuantities(group, group, np.zeros(0))
        changes, elevation = contents
        seconds, counts = np.unique(second_of_change, return_counts=True)
        first, last = position[begins[seconds]], position[ends[seconds]]
        factors = mapping_factor(
            elevation,
            np.repeat(np.linalg.norm(last, axis=-1), counts),
            np.repeat(geodetic_from_itrf(last)[:, 2], counts),
        )
        time = rows.pairs.time
        end_of_second = time[series.first_row[seconds + 1] - 1]
        durations = (end_of_second - time[series.first_row[seconds]]) / NANOSECONDS_PER_SECOND
        numbers, table = _recent_rates(
            groups.link[group],
            np.append(0, np.cumsum(counts)),
            end_of_second,
            changes,
            changes / factors,
            factors,
            self._ends,
            self._rates,
        )
        roti = _SECONDS_PER_MINUTE * table.std(axis=-1, ddof=1)
        distance = np.linalg.norm(last - first, axis=-1)
        kilometres_per_second = _KILOMETRES_PER_METRE * distance / durations
        speed = np.repeat(kilometres_per_second, counts)[numbers]
        gradient = np.abs(table.mean(axis=-1)) / speed
        sources = [int(BoundarySource.ROTI), int(BoundarySource.TEC_GRADIENT)]
        return RayQuantities(
            np.repeat(group[numbers], 2),
            np.tile(sources, len(numbers)),
            np.column_stack((roti, gradient)).ravel(),
        )

    def _make_room(self, links: int) -> None:
        """Make room for links that have not been observed before."""
        new = links - len(self._ends)
        if new > 0:
            never = np.full((new, _RATE_SECONDS), _NEVER, dtype=np.int64)
            self._last_second = np.hstack((self._last_second, never[:, :2].T))
            self._last_content = np.append(self._last_content, np.zeros(new))
            self._ends = np.vstack((self._ends, never))
            self._rates = np.vstack((self._rates, np.zeros((new, _RATE_SECONDS))))


# ---- compiled ------------------------------------------------------------------------------------


@compiled
def _group_rows(first_row, link, links):  # type: ignore[no-untyped-def]
    """Return the order of rows with a link, and where groups begin, their seconds and links.

    The latter have shape (3, m + 1); see `RayGroups`. `first_row` tells where seconds begin.
    """
    rows = len(link)
    order = np.empty(rows, dtype=np.int64)
    groups = np.zeros((3, rows + 1), dtype=np.int64)
    place = np.zeros(links, dtype=np.int64)
    number, placed = 0, 0
    for second in range(len(first_row) - 1):
        begin, end = first_row[second], first_row[second + 1]
        for row in range(begin, end):
            if link[row] >= 0:
                place[link[row]] += 1
        for other in range(links):
            count = place[other]
            if count > 0:
                groups[0, number], groups[1, number], groups[2, number] = placed, second, other
                place[other] = placed
                placed += count
                number += 1
        for row in range(begin, end):
            if link[row] >= 0:
                order[place[link[row]]] = row
                place[link[row]] += 1
        place[:] = 0
    groups[0, number] = placed
    return order[:placed].copy(), groups[:, : number + 1].copy()


@compiled
def _choose_rays(  # type: ignore[no-untyped-def]
    first_row, time, elevation, order, first, second, satellite, elevation_mask, fewest, coverage
):
    """Return the first group of each satellite and second that has samples enough.

    Parameters
    ----------
    first_row : ndarray of int64, shape (k + 1,)
        Where the rows of each second begin.
    time, elevation : ndarray, shape (n,)
        Time (ns) and elevation (rad) of each row.
    order, first, second : ndarray of int64
        See `RayGroups`.
    satellite : ndarray of int64, shape (m,)
        Number of the satellite of each group.
    elevation_mask : float
        Rad; a ray must have been higher in the second.
    fewest : int
        Fewest epochs of a second.
    coverage : float
        Part of them in which a ray must have samples.

    Returns
    -------
    group : ndarray of int64, shape (c,)
    length : ndarray, shape (c,)
        Time from sample to sample, s.
    """
    groups = len(second)
    chosen, lengths = np.empty(groups, dtype=np.int64), np.empty(groups)
    satellites = 0
    for number in satellite:
        satellites = max(satellites, number + 1)
    # The second, counted from 1, in which each satellite was chosen last.
    last = np.zeros(satellites, dtype=np.int64)
    count, group = 0, 0
    for number in range(len(first_row) - 1):
        begin, end = first_row[number], first_row[number + 1]
        steps, epochs = np.empty(end - begin), 0
        for row in range(begin, end):
            if row == begin or time[row] != time[row - 1]:
                if row > begin:
                    steps[epochs - 1] = time[row] - time[row - 1]
                epochs += 1
        is_long = epochs >= fewest
        length = np.median(steps[: epochs - 1]) / NANOSECONDS_PER_SECOND if is_long else 1.0
        while group < groups and second[group] == number:
            samples = first[group + 1] - first[group]
            if is_long and samples >= coverage * epochs and last[satellite[group]] != number + 1:
                for place in range(first[group], first[group + 1]):
                    if elevation[order[place]] >= elevation_mask:
                        last[satellite[group]] = number + 1
                        chosen[count], lengths[count] = group, length
                        count += 1
                        break
            group += 1
    return chosen[:count].copy(), lengths[:count].copy()


@compiled
def _content_changes(  # type: ignore[no-untyped-def]
    first_row,
    time,
    is_placed,
    order,
    first,
    second,
    link,
    arc,
    elevation,
    content,
    elevation_mask,
    fewest,
    last_second,
    last_content,
):
    """Return the changes of content since the second before, of seconds with changes enough.

    A link has a change if its arc has lasted through both seconds. The contents of the last seconds
    are renewed in place.

    Parameters
    ----------
    first_row : ndarray of int64, shape (k + 1,)
        Where the rows of each second begin.
    time, arc, elevation, content : ndarray, shape (n,)
        Time (ns), number of the arc, elevation (rad) and content (TECU) of each row.
    is_placed : ndarray of bool, shape (k,)
        Whether the position of the spacecraft is known.
    order, first, second, link : ndarray of int64
        See `RayGroups`.
    elevation_mask : float
        Rad.
    fewest : int
        Fewest changes of a second.
    last_second : ndarray of int64, shape (2, links)
        End (ns) and arc of the last second with a content.
    last_content : ndarray, shape (links,)
        Mean content of that second, TECU.

    Returns
    -------
    found : ndarray of int64, shape (2, c)
        Groups, and their seconds.
    contents : ndarray, shape (2, c)
        Changes, TECU, and elevations, rad.
    """
    groups = len(second)
    found, contents = np.empty((2, groups), dtype=np.int64), np.empty((2, groups))
    count, group = 0, 0
    for number in range(len(is_placed)):
        begin, end = first_row[number], first_row[number + 1]
        kept = count
        while group < groups and second[group] == number:
            total, samples, last_row = 0.0, 0, -1
            for place in range(first[group], first[group + 1]):
                row = order[place]
                if arc[row] > 0:
                    total += content[row]
                    samples += 1
                    last_row = row
            group += 1
            if samples == 0 or not is_placed[number] or elevation[last_row] < elevation_mask:
                continue
            of_link, now, mean = link[group - 1], time[end - 1], total / samples
            is_next = now - last_second[0, of_link] == NANOSECONDS_PER_SECOND
            if is_next and last_second[1, of_link] == arc[last_row]:
                found[0, count], found[1, count] = group - 1, number
                contents[0, count] = mean - last_content[of_link]
                contents[1, count] = elevation[last_row]
                count += 1
            last_second[0, of_link], last_second[1, of_link] = now, arc[last_row]
            last_content[of_link] = mean
        if count - kept < fewest or time[end - 1] == time[begin]:
            count = kept
    return found[:, :count].copy(), contents[:, :count].copy()


@compiled
def _recent_rates(  # type: ignore[no-untyped-def]
    link, first, end, change, vertical, factor, last_ends, last_rates
):
    """Return the changes that follow others without a gap, and all of these.

    Parameters
    ----------
    link : ndarray of int64, shape (c,)
        Link of each change, second by second.
    first : ndarray of int64, shape (s + 1,)
        Where the changes of each second begin.
    end : ndarray of int64, shape (s,)
        Ends of the seconds, ns.
    change, vertical, factor : ndarray, shape (c,)
        Changes of content, the same mapped to the vertical, TECU, and the mapping factors.
    last_ends, last_rates : ndarray, shape (links, r)
        Ends (ns) of the last seconds with a rate, the latest last, and these rates (TECU/s): they
        are renewed in place.

    Returns
    -------
    numbers : ndarray of int64, shape (f,)
        Changes of links that have had a rate in each of the last r seconds.
    table : ndarray, shape (f, r)
        The rates of these, TECU/s, vertical motion removed.
    """
    seconds = last_ends.shape[1]
    numbers, table = np.empty(len(link), dtype=np.int64), np.empty((len(link), seconds))
    count = 0
    for second in range(len(end)):
        begin = end[second] - seconds * NANOSECONDS_PER_SECOND
        median = np.median(vertical[first[second] : first[second + 1]])
        for number in range(first[second], first[second + 1]):
            ends, rates = last_ends[link[number]], last_rates[link[number]]
            for place in range(seconds - 1):
                ends[place], rates[place] = ends[place + 1], rates[place + 1]
            ends[seconds - 1] = end[second]
            rates[seconds - 1] = change[number] - factor[number] * median
            if ends[0] > begin:
                numbers[count] = number
                table[count] = rates
                count += 1
    return numbers[:count].copy(), table[:count].copy()
