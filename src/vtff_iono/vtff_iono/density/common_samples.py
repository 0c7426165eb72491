"""Samples that chief and deputy have of the same links at the same epochs, compiled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_iono.content.slant_tec import Rejection, SlantTecRows

__all__ = ["NO_LINK", "common_samples", "squared_steps"]

IntArray = npt.NDArray[np.int64]

NO_LINK = -1
"""Number of a link that has other signals than those that are compared."""

# A phase that was rejected for one of these reasons does not belong to its integer.
_NO_PHASE = np.uint16(
    Rejection.NO_SECOND_SIGNAL | Rejection.PHASE_INVALID | Rejection.PARITY_UNKNOWN
)


def common_samples(
    rows: tuple[SlantTecRows, SlantTecRows], numbers: tuple[Sequence[int], Sequence[int]]
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the rows of chief and deputy of the same epochs and links, and these links.

    Only rows with a phase in the last arc of their link are returned, in the order of the chief.

    Parameters
    ----------
    rows : tuple of SlantTecRows
        Rows of chief and deputy, epoch by epoch.
    numbers : tuple of sequence of int
        For both, the numbers of the links common to them by their own ones; `NO_LINK` for others.
    """
    samples = []
    for rows_of_craft, numbers_of_craft in zip(rows, numbers, strict=True):
        # Rows without a link have the last number.
        table = np.array([*numbers_of_craft, NO_LINK], dtype=np.int64)
        link = table[rows_of_craft.pairs.link] if len(rows_of_craft) else np.zeros(0, np.int64)
        samples.append((rows_of_craft.pairs.time, link, rows_of_craft.arc, rows_of_craft.rejected))
    links = 1 + max((max(of_craft, default=NO_LINK) for of_craft in numbers), default=NO_LINK)
    first, second, link = _common_samples(*samples[0], *samples[1], links, _NO_PHASE)
    return first, second, link


@compiled
def _last_arcs(link, arc, links):  # type: ignore[no-untyped-def]
    """Return the arc of the last row of each link."""
    last = np.zeros(links, dtype=np.int64)
    for row in range(len(link)):
        if link[row] >= 0:
            last[link[row]] = arc[row]
    return last


@compiled
def _common_samples(  # type: ignore[no-untyped-def]
    time_first,
    link_first,
    arc_first,
    rejected_first,
    time_second,
    link_second,
    arc_second,
    rejected_second,
    links,
    no_phase,
):
    """Return the rows of two receivers of the same epochs and links, and these links."""
    last_first = _last_arcs(link_first, arc_first, links)
    last_second = _last_arcs(link_second, arc_second, links)
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
    return found[0, :count], found[1, :count], found[2, :count]


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
