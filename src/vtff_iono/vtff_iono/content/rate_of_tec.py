"""ROTI: standard deviation of the rate of change of TEC over a window.

ROTI depends on the interval of the rates, on the length of the window and on the speed of the ray
through the plasma; interval and window are therefore part of the result.

Rates are formed within arcs. Where the interval of the samples is that of the rates (half a minute
on a ground station), a jump of the content that no other test confirms may be a slip or the wall of
a bubble. To leave such a rate out would take the largest rates out of disturbed windows. This
doubtful rate counts if it is no outlier among the certain rates of its window; so a slip in a quiet
ionosphere does not count.

References
----------
Pi et al. (1997), Monitoring of global ionospheric irregularities using the worldwide GPS network,
Geophys. Res. Lett. 24(18), 2283-2286.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_iono.content.slant_tec import SlantTecRows
from vtff_iono.links.arcs import ArcBreak
from vtff_iono.links.windows import Columns, WindowBuffer

__all__ = ["RateOfTecMonitor", "RateOfTecWindow"]

# Rates are formed between samples at multiples of the interval; a sample may be off by this
# fraction of the interval.
_TOLERANCE = 0.02
# A sample continues a rate if it follows the previous one within this many intervals.
_LONGEST_STEP_INTERVALS = 1.5
_FEWEST_RATES = 5
# A doubtful rate beyond this probability of Student's distribution is a slip.
_OUTLIER_PROBABILITY = 0.999
_SECONDS_PER_MINUTE = 60.0


@dataclass(frozen=True, eq=False)
class RateOfTecWindow:
    """ROTI of all links in one window; arrays of shape (m,).

    Parameters
    ----------
    time : int
        End of the window, GPS time in ns since 1980-01-06.
    interval : float
        Interval of the rates, s.
    link : ndarray of int64
        Numbers of the links.
    roti_tecu_per_minute : ndarray
        Standard deviation of the rates of slant TEC; NaN with fewer than 5 rates.
    mean_rate_tecu_per_minute : ndarray
        Mean rate of slant TEC.
    rates : ndarray of int64
        Number of rates used.
    """

    time: int
    interval: float
    link: npt.NDArray[np.int64]
    roti_tecu_per_minute: FloatArray
    mean_rate_tecu_per_minute: FloatArray
    rates: npt.NDArray[np.int64]


class RateOfTecMonitor:
    """ROTI of the links of one receiver.

    Parameters
    ----------
    interval : float
        Interval of the rates, s: 30 on the ground by custom, 1 in orbit.
    window : float
        Length of the windows, s: 300 on the ground, 60 in orbit.
    """

    def __init__(self, interval: float, window: float) -> None:
        self._interval = interval
        self._buffer = WindowBuffer(window)
        # Last sample of each link: time in ns, arc, content in TECU.
        self._last_sample: dict[int, tuple[int, int, float]] = {}
        # Time of the last epoch and the shortest interval of epochs, ns.
        self._last_epoch: int | None = None
        self._shortest_interval = int(np.iinfo(np.int64).max)

    def update(self, rows: SlantTecRows) -> Iterator[RateOfTecWindow]:
        """Add contents and yield the windows that they end.

        A window has the rates within arcs, and the doubtful rates that are no outliers among them.
        """
        interval = round(self._interval * NANOSECONDS_PER_SECOND)
        self._follow_epochs(rows.pairs.time)
        is_slow = self._shortest_interval > interval // 2
        offset = (rows.pairs.time + interval // 2) % interval - interval // 2
        chosen = (
            (np.abs(offset) <= _TOLERANCE * interval)
            & (rows.arc > 0)
            & np.isfinite(rows.stec_phase_tecu)
        )
        columns = {
            "link": rows.pairs.link[chosen],
            "arc": rows.arc[chosen],
            "content": rows.stec_phase_tecu[chosen],
            "doubtful": is_slow & (rows.break_reason[chosen] == ArcBreak.GEOMETRY_FREE),
        }
        for end, window in self._buffer.update(rows.pairs.time[chosen], columns):
            yield self._window_roti(end, window)

    def _follow_epochs(self, time: npt.NDArray[np.int64]) -> None:
        """Keep the shortest interval of epochs."""
        if len(time) == 0:
            return
        before = time[0] if self._last_epoch is None else self._last_epoch
        steps = np.diff(time, prepend=before)
        self._shortest_interval = int(
            np.min(steps, where=steps > 0, initial=self._shortest_interval)
        )
        self._last_epoch = int(time[-1])

    def flush(self) -> Iterator[RateOfTecWindow]:
        """Yield the last window, which may be short."""
        for end, window in self._buffer.flush():
            yield self._window_roti(end, window)

    def _window_roti(self, end: int, window: Columns) -> RateOfTecWindow:
        """Return ROTI of the links in a window that ends at a time, ns."""
        order = np.argsort(window["link"], kind="stable")
        starts = np.flatnonzero(np.diff(window["link"][order], prepend=-1))
        window = {name: column[order] for name, column in window.items()}
        rates, is_used = self._rates(window, starts)
        # Number of the link of each rate that is used.
        link = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(order)))[is_used]
        used = rates[is_used]
        counts = np.bincount(link, minlength=len(starts))
        mean_rate = np.bincount(link, used, len(starts)) / np.where(counts > 0, counts, np.nan)
        squares = np.bincount(link, (used - mean_rate[link]) ** 2, len(starts))
        freedom = np.where(counts >= _FEWEST_RATES, counts - 1.0, np.nan)
        return RateOfTecWindow(
            time=end,
            interval=self._interval,
            link=window["link"][starts].astype(np.int64),
            roti_tecu_per_minute=np.sqrt(squares / freedom),
            mean_rate_tecu_per_minute=mean_rate,
            rates=counts,
        )

    def _rates(
        self, window: Columns, starts: npt.NDArray[np.intp]
    ) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Return the rates to the samples of a window, TECU/min, and which of them are used.

        The samples of a link stand together from its index in `starts` on. The first rate of a link
        begins in the previous window.
        """
        time, arc, content = window["time"], window["arc"], window["content"]
        ends = np.append(starts[1:], len(time))
        links = window["link"][starts].tolist()
        before = [self._last_sample.get(link, (0, -1, np.nan)) for link in links]
        last = zip(
            time[ends - 1].tolist(), arc[ends - 1].tolist(), content[ends - 1].tolist(), strict=True
        )
        self._last_sample.update(zip(links, last, strict=True))

        def steps(column: npt.NDArray[Any], last_values: Sequence[float]) -> npt.NDArray[Any]:
            previous = np.empty_like(column)
            previous[1:] = column[:-1]
            previous[starts] = last_values
            return np.asarray(column - previous)

        elapsed = steps(time, [sample[0] for sample in before]) / NANOSECONDS_PER_SECOND
        is_next = elapsed < _LONGEST_STEP_INTERVALS * self._interval
        new_arcs = steps(arc, [sample[1] for sample in before])
        is_used = is_next & (new_arcs == 0)
        is_doubtful = is_next & (new_arcs == 1) & window["doubtful"]
        with np.errstate(invalid="ignore", divide="ignore"):
            step = steps(content, [sample[2] for sample in before])
            rates = step / elapsed * _SECONDS_PER_MINUTE
        for number in np.unique(np.searchsorted(starts, np.flatnonzero(is_doubtful), "right") - 1):
            rows = slice(starts[number], ends[number])
            belongs = _may_belong_to(rates[rows], rates[rows][is_used[rows]])
            is_used[rows] |= is_doubtful[rows] & belongs
        return rates, is_used


def _may_belong_to(values: FloatArray, sample: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which values are no outliers of the normal distribution that a sample is from."""
    count = len(sample)
    if count < _FEWEST_RATES:
        return np.zeros(len(values), dtype=np.bool_)
    spread = sample.std(ddof=1) * math.sqrt(1.0 + 1.0 / count)
    quantile = stdtrit(count - 1, 0.5 * (1.0 + _OUTLIER_PROBABILITY))
    return np.asarray(np.abs(values - sample.mean()) <= quantile * spread)
