"""Samples of the last hours that the receiver biases of a spacecraft are estimated from."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_iono.bias.bias_samples import BiasSamples, ReceiverBiasError
from vtff_iono.content.slant_tec import Rejection, SlantTecRows
from vtff_iono.links.signal_pairs import Link

__all__ = ["BIAS_SAMPLE_INTERVAL", "BiasGroup", "BiasSampleWindow", "bias_group"]

BiasGroup = tuple[int, str, str]
"""System and observation codes of two pseudoranges, whose links share one receiver bias."""

BIAS_SAMPLE_INTERVAL = 20 * NANOSECONDS_PER_SECOND
"""ns; epochs at multiples of it are sampled."""

# A content that was rejected for another reason than these shows nothing of the receiver bias.
_USABLE = np.uint16(Rejection.CODE_OUTLIER | Rejection.CODE_INVALID | Rejection.NO_RECEIVER_BIAS)


class _SampleEpoch(NamedTuple):
    """Samples of one epoch; arrays of shape (n,) and (n, 3)."""

    time: int
    link: npt.NDArray[np.int64]
    arc: npt.NDArray[np.int64]
    stec_phase_tecu: FloatArray
    wind_up_tecu: FloatArray
    elevation: FloatArray
    direction_itrf: FloatArray
    position_itrf: FloatArray


def bias_group(link: Link) -> BiasGroup:
    """Return the group of links that share their receiver bias with a link."""
    return link.system, link.code_first, link.code_second


class BiasSampleWindow:
    """Samples of the contents of one receiver over the last hours.

    A sample holds the content of the phase; the level of its arc is added when the samples are
    collected, so that all samples of an arc have its latest level. Samples that are older than the
    window are forgotten, and so are the levels of arcs without samples: memory and the cost of an
    estimate do not grow after that. The window must be long enough for the bias, which changes with
    the temperature of the receiver at most.

    Parameters
    ----------
    length : float
        Length of the window, s.
    """

    def __init__(self, length: float) -> None:
        self._length = round(length * NANOSECONDS_PER_SECOND)
        self._epochs: deque[_SampleEpoch] = deque()
        # By link and arc: the level and its sigma, and the sigma of the satellite bias in it, TECU.
        self._levels: dict[tuple[int, int], tuple[float, float, float]] = {}

    def __len__(self) -> int:
        """Return the number of samples."""
        return sum(len(epoch.link) for epoch in self._epochs)

    @property
    def arcs(self) -> int:
        """Number of arcs whose levels are remembered."""
        return len(self._levels)

    def add_epochs(
        self,
        rows: SlantTecRows,
        first: npt.NDArray[np.int64],
        last: npt.NDArray[np.int64],
        direction_itrf: FloatArray,
        position_itrf: FloatArray,
        wind_up_tecu: FloatArray,
    ) -> None:
        """Add epochs: the levels of their arcs, and samples of those whose time it is.

        Parameters
        ----------
        rows : SlantTecRows
            Contents, among them those of the epochs.
        first, last : ndarray of int64, shape (k,)
            First and last row of each epoch, in the order of time.
        direction_itrf, position_itrf : ndarray, shape (n, 3)
            Unit vectors to the satellites, and positions of the antenna (m), of all observations
            that the rows refer to.
        wind_up_tecu : ndarray, shape (m,)
            Content that the wind-up of each row since its arc began looks like, TECU.
        """
        counts = last + 1 - first
        row = np.arange(int(counts.sum())) + np.repeat(first - (np.cumsum(counts) - counts), counts)
        epoch = np.repeat(np.arange(len(first)), counts)
        usable = ((rows.rejected[row] & ~_USABLE) == 0) & np.isfinite(rows.stec_tecu[row])
        row, epoch = row[usable], epoch[usable]
        edges = np.searchsorted(epoch, np.arange(len(first) + 1)).tolist()
        arcs = list(zip(rows.pairs.link[row].tolist(), rows.arc[row].tolist(), strict=True))
        levels = list(
            zip(
                (rows.stec_tecu[row] - rows.stec_phase_tecu[row]).tolist(),
                rows.stec_sigma_tecu[row].tolist(),
                rows.satellite_bias_sigma_tecu[row].tolist(),
                strict=True,
            )
        )
        known = 0
        for number, time in enumerate(rows.pairs.time[first].tolist()):
            if time % BIAS_SAMPLE_INTERVAL != 0:
                continue
            begin, end = edges[number : number + 2]
            self._levels.update(zip(arcs[known:end], levels[known:end], strict=True))
            known, chosen = end, row[begin:end]
            if len(chosen):
                observation = rows.pairs.row_first[chosen]
                self._epochs.append(
                    _SampleEpoch(
                        time,
                        rows.pairs.link[chosen],
                        rows.arc[chosen],
                        rows.stec_phase_tecu[chosen],
                        wind_up_tecu[chosen],
                        rows.elevation[chosen],
                        direction_itrf[observation],
                        position_itrf[observation],
                    )
                )
            self._forget_older_than(time - self._length)
        self._levels.update(zip(arcs[known:], levels[known:], strict=True))

    def levels(self) -> list[tuple[tuple[int, int], float]]:
        """Return link and arc, and the level (TECU), of the arcs by their numbers in samples."""
        return [(arc, self._levels[arc][0]) for arc in sorted(self._levels)]

    def _forget_older_than(self, time: int) -> None:
        """Forget the samples before a time (ns) and the levels of arcs that have no sample left."""
        if not self._epochs or self._epochs[0].time >= time:
            return
        while self._epochs and self._epochs[0].time < time:
            self._epochs.popleft()
        sampled = {
            arc
            for epoch in self._epochs
            for arc in zip(epoch.link.tolist(), epoch.arc.tolist(), strict=True)
        }
        self._levels = {arc: level for arc, level in self._levels.items() if arc in sampled}

    def collect(self, links: Sequence[Link]) -> tuple[list[BiasGroup], BiasSamples]:
        """Return the groups of links that have samples, and all samples.

        Parameters
        ----------
        links : sequence of Link
            All links of the receiver, by their numbers.

        Raises
        ------
        ReceiverBiasError
            If there are no samples.
        """
        if not self._epochs:
            raise ReceiverBiasError(
                "receiver bias: no samples; contents at known positions with satellite biases are "
                f"needed at multiples of {BIAS_SAMPLE_INTERVAL // NANOSECONDS_PER_SECOND} s"
            )
        link = np.concatenate([epoch.link for epoch in self._epochs])
        arc = np.concatenate([epoch.arc for epoch in self._epochs])
        arc_of_sample = list(zip(link.tolist(), arc.tolist(), strict=True))
        levels = np.array([self._levels[key] for key in arc_of_sample])
        groups = sorted({bias_group(links[number]) for number in np.unique(link).tolist()})
        group_number = {group: number for number, group in enumerate(groups)}
        group_of_link = np.array([group_number.get(bias_group(link_key), -1) for link_key in links])
        arc_number = {key: number for number, key in enumerate(sorted(self._levels))}
        counts = [len(epoch.link) for epoch in self._epochs]
        samples = BiasSamples(
            time=np.repeat([1e-9 * epoch.time for epoch in self._epochs], counts),
            group=group_of_link[link],
            stec_tecu=np.concatenate([epoch.stec_phase_tecu for epoch in self._epochs])
            + levels[:, 0],
            stec_sigma_tecu=levels[:, 1],
            elevation=np.concatenate([epoch.elevation for epoch in self._epochs]),
            direction_itrf=np.concatenate([epoch.direction_itrf for epoch in self._epochs]),
            position_receiver_itrf=np.concatenate([epoch.position_itrf for epoch in self._epochs]),
            arc=np.array([arc_number[key] for key in arc_of_sample], dtype=np.int64),
            link=link,
            satellite_sigma_tecu=levels[:, 2],
            wind_up_tecu=np.concatenate([epoch.wind_up_tecu for epoch in self._epochs]),
        )
        return groups, samples
