"""ROTI: standard deviation of the rate of change of TEC over a window.

It depends on the interval of the rates, on the length of the window and on the speed of the ray
through the plasma; interval and window are therefore part of the result.

Rates are formed within arcs. Where samples are as far apart as the rates, half a minute on a
ground station, a jump of the content alone may be a slip or the wall of a bubble. To leave it out
would take the largest rates out of the disturbed windows. Such a rate counts if it is no outlier
among the certain ones of its window, so that a slip in quiet air does not.

References
----------
Pi et al. (1997), Monitoring of global ionospheric irregularities using the worldwide GPS network,
Geophys. Res. Lett. 24(18), 2283-2286.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import special

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_iono.content.slant_tec import SlantTecRows
from vtff_iono.links.arcs import ArcBreak
from vtff_iono.links.windows import Columns, WindowBuffer

__all__ = ["RateOfTecMonitor", "RateOfTecWindow"]

# A sample belongs to an instant if it is this near to it, as a part of the interval.
_TOLERANCE = 0.02
_FEWEST_RATES = 5
# A doubtful rate beyond this probability of Student's distribution is a slip.
_OUTLIER_PROBABILITY = 0.999


_NEEDED = ("time", "arc", "content", "doubtful")


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
        Of slant TEC; NaN with fewer than 5 rates.
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
        s: 300 on the ground, 60 in orbit.
    """

    def __init__(self, interval: float, window: float) -> None:
        self._interval = interval
        self._buffer = WindowBuffer(window)
        # Last sample of each link: time in ns, arc, content.
        self._last: dict[int, tuple[int, int, float]] = {}
        # Time of the last epoch and the shortest interval of epochs, ns.
        self._newest: int | None = None
        self._shortest = int(np.iinfo(np.int64).max)

    def update(self, rows: SlantTecRows) -> Iterator[RateOfTecWindow]:
        """Take contents in and yield the windows that they end.

        The rates are those within arcs, and doubtful ones that are like them.
        """
        interval = round(self._interval * NANOSECONDS_PER_SECOND)
        self._follow(rows.pairs.time)
        is_slow = self._shortest > interval // 2
        phase = (rows.pairs.time + interval // 2) % interval - interval // 2
        chosen = (
            (np.abs(phase) <= _TOLERANCE * interval)
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
            yield self._roti(end, window)

    def _follow(self, time: npt.NDArray[np.int64]) -> None:
        """Keep the shortest interval of epochs."""
        if len(time) == 0:
            return
        steps = np.diff(time, prepend=time[0] if self._newest is None else self._newest)
        self._shortest = int(np.min(steps, where=steps > 0, initial=self._shortest))
        self._newest = int(time[-1])

    def flush(self) -> Iterator[RateOfTecWindow]:
        """Yield the last window, which may be short."""
        for end, window in self._buffer.flush():
            yield self._roti(end, window)

    def _roti(self, end: int, window: Columns) -> RateOfTecWindow:
        order = np.argsort(window["link"], kind="stable")
        starts = np.flatnonzero(np.diff(window["link"][order], prepend=-1))
        links, values = [], []
        for rows in np.split(order, starts[1:]):
            link = int(window["link"][rows[0]])
            rates = self._rates(link, *(window[n][rows] for n in _NEEDED))
            enough = len(rates) >= _FEWEST_RATES
            links.append(link)
            values.append(
                (
                    float(rates.std(ddof=1)) if enough else np.nan,
                    float(rates.mean()) if len(rates) else np.nan,
                    len(rates),
                )
            )
        table = np.array(values, dtype=float).reshape(-1, 3)
        return RateOfTecWindow(
            time=end,
            interval=self._interval,
            link=np.array(links, dtype=np.int64),
            roti_tecu_per_minute=table[:, 0],
            mean_rate_tecu_per_minute=table[:, 1],
            rates=table[:, 2].astype(np.int64),
        )

    def _rates(
        self,
        link: int,
        time: npt.NDArray[np.int64],
        arc: npt.NDArray[np.int64],
        content: FloatArray,
        is_doubtful: npt.NDArray[np.bool_],
    ) -> FloatArray:
        """Return the rates of one link, TECU/min, the first one from the window before."""
        last = self._last.get(link, (0, -1, np.nan))
        self._last[link] = (int(time[-1]), int(arc[-1]), float(content[-1]))
        elapsed = np.diff(time, prepend=last[0]) / NANOSECONDS_PER_SECOND
        is_next = elapsed < 1.5 * self._interval
        new_arcs = np.diff(arc, prepend=last[1])
        certain = is_next & (new_arcs == 0)
        doubtful = is_next & (new_arcs == 1) & is_doubtful
        with np.errstate(invalid="ignore", divide="ignore"):
            rates = np.diff(content, prepend=last[2]) / elapsed * 60.0
        if doubtful.any():
            certain |= doubtful & _is_like(rates, rates[certain])
        return np.asarray(rates[certain])


def _is_like(values: FloatArray, others: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which values may be of the same normal distribution as others."""
    count = len(others)
    if count < _FEWEST_RATES:
        return np.zeros(len(values), dtype=np.bool_)
    limit = special.stdtrit(count - 1, 0.5 * (1.0 + _OUTLIER_PROBABILITY))
    spread = others.std(ddof=1) * math.sqrt(1.0 + 1.0 / count)
    return np.asarray(np.abs(values - others.mean()) <= limit * spread)
