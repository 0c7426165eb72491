"""Samples that chief and deputy have of the same links at the same epochs, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_iono.content.slant_tec import Rejection, SlantTecRows

__all__ = ["NO_LINK", "CommonSamples", "common_samples", "squared_steps"]

IntArray = npt.NDArray[np.int64]

NO_LINK = -1
"""Number of a link that has other signals than those that are compared."""

# A phase that was rejected for one of these reasons does not belong to its integer.
_NO_PHASE = int(Rejection.NO_SECOND_SIGNAL | Rejection.PHASE_INVALID | Rejection.PARITY_UNKNOWN)


class CommonSamples(NamedTuple):
    """Rows of chief and deputy of the same epochs and links.

    Attributes
    ----------
    chief, deputy, link : ndarray of int64, shape (n,)
        Rows of both spacecraft, and their links by the numbers common to both.
    """

    chief: IntArray
    deputy: IntArray
    link: IntArray


def common_samples(
    rows: tuple[SlantTecRows, SlantTecRows], numbers: tuple[IntArray, IntArray]
) -> tuple[CommonSamples, IntArray]:
    """Return the rows of both spacecraft of the same epochs and links, and the last arcs of links.

    Only rows with a phase in the last arc of their link are returned, in the order of the chief.
    The last arcs are those of chief and deputy, shape (2, links), 0 for a link without rows.

    Parameters
    ----------
    rows : tuple of SlantTecRows
        Rows of chief and deputy, epoch by epoch.
    numbers : tuple of ndarray of int64
        For both, the numbers of the links common to them by their own ones; `NO_LINK` for others.
    """
    chief, deputy = rows
    found, last_arcs = _common_samples(
        chief.pairs.time,
        chief.pairs.link,
        chief.arc,
        chief.rejected,
        numbers[0],
        deputy.pairs.time,
        deputy.pairs.link,
        deputy.arc,
        deputy.rejected,
        numbers[1],
        _NO_PHASE,
    )
    return CommonSamples(*found), last_arcs


@compiled
def _common_links(link, numbers):  # type: ignore[no-untyped-def]
    """Return the links of rows by the numbers common to both receivers, `NO_LINK` for others."""
    common = np.full(len(link), NO_LINK, dtype=np.int64)
    for row in range(len(link)):
        if link[row] >= 0:
            common[row] = numbers[link[row]]
    return common


@compiled
def _last_arcs(link, arc, last):  # type: ignore[no-untyped-def]
    """Set the arc of the last row of each link (links,), in place."""
    for row in range(len(link)):
        if link[row] >= 0:
            last[link[row]] = arc[row]


@compiled
def _common_samples(  # type: ignore[no-untyped-def]
    time_first,
    own_link_first,
    arc_first,
    rejected_first,
    numbers_first,
    time_second,
    own_link_second,
    arc_second,
    rejected_second,
    numbers_second,
    no_phase,
):
    """Return rows of two receivers and links, (3, n), and last arcs; see `common_samples`."""
    link_first = _common_links(own_link_first, numbers_first)
    link_second = _common_links(own_link_second, numbers_second)
    links = 0
    for number in numbers_first:
        links = max(links, number + 1)
    for number in numbers_second:
        links = max(links, number + 1)
    last_arcs = np.zeros((2, links), dtype=np.int64)
    last_first, last_second = last_arcs[0], last_arcs[1]
    _last_arcs(link_first, arc_first, last_first)
    _last_arcs(link_second, arc_second, last_second)
    most = min(len(time_first), len(time_second))
    found = np.empty((3, most), dtype=np.int64)
    count = 0
    row_of_link = np.full(links, -1, dtype=np.int64)
    begin, row = 0, 0
    while row < len(time_first):
        now = time_first[row]
        while begin < len(time_second) and time_second[begin] < now:
            begin += 1
        end = begin
        while end < len(time_second) and time_second[end] == now:
            link, arc = link_second[end], arc_second[end]
            if link >= 0 and arc > 0 and (rejected_second[end] & no_phase) == 0:
                if arc == last_second[link] and row_of_link[link] < 0:
                    row_of_link[link] = end
            end += 1
        while row < len(time_first) and time_first[row] == now:
            link, arc = link_first[row], arc_first[row]
            if link >= 0 and arc > 0 and (rejected_first[row] & no_phase) == 0:
                if arc == last_first[link] and row_of_link[link] >= 0:
                    found[0, count], found[1, count] = row, row_of_link[link]
                    found[2, count] = link
                    count += 1
                    row_of_link[link] = -1
            row += 1
        for other in range(begin, end):
            if link_second[other] >= 0:
                row_of_link[link_second[other]] = -1
        begin = end
    return found[:, :count].copy(), last_arcs


@compiled
def squared_steps(link, content, links):  # type: ignore[no-untyped-def]
    """Return the first content of each link, and the squared changes from sample to sample.

    Parameters
    ----------
    link : ndarray of int64, shape (n,)
        Link of each row, in the order of time.
    content : ndarray, shape (n,)
    links : int
        Number of links.

    Returns
    -------
    first : ndarray, shape (links,)
        NaN for a link without rows.
    steps : ndarray, shape (n,)
        Square of the change of each row from the row of its link before it; the first row of a link
        has the mean of the others.
    """
    first, last = np.full(links, np.nan), np.zeros(links)
    total, count = np.zeros(links), np.zeros(links, dtype=np.int64)
    steps = np.zeros(len(link))
    first_row = np.full(links, -1, dtype=np.int64)
    for row in range(len(link)):
        number = link[row]
        if first_row[number] < 0:
            first_row[number] = row
            first[number] = content[row]
        else:
            steps[row] = (content[row] - last[number]) ** 2
            total[number] += steps[row]
            count[number] += 1
        last[number] = content[row]
    for number in range(links):
        if first_row[number] >= 0:
            steps[first_row[number]] = total[number] / max(count[number], 1)
    return first, steps
