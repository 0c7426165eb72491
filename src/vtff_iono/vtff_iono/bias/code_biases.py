"""Differential code biases of satellites and receivers, chained over pairs of signals.

A bias is the hardware delay of a code observation. Only differences of two signals matter to the
electron content (differential signal biases, DSB): with ``P`` pseudoranges and ``K`` of
`vtff_iono.links.geometry_free.tecu_per_metre`,

    (P_second - P_first) = STEC / K - c (DSB_satellite + DSB_receiver),   DSB = first - second.

Files contain the biases of some pairs of signals. Every bias is an edge of a graph whose nodes are
signals; the bias of any other pair is the sum along the path with the smallest variance.
"""

from __future__ import annotations

import dataclasses
import heapq
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from vtff_dynamics.constants import SECONDS_PER_DAY
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import (
    EPHEMERIS_SOURCE_FNAV,
    SYSTEM_GALILEO,
    SYSTEM_GPS,
    SYSTEM_LETTERS,
)
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.signals import carrier_frequency_hz

__all__ = [
    "COARSE_CODE_SIGMA",
    "BiasFileError",
    "CodeBias",
    "CodeBiasTable",
    "broadcast_code_biases",
]

BROADCAST_SIGMA = 0.5e-9
"""s; scatter of broadcast group delays about network solutions (0.4 ns for GPS against CAS on
2024-01-10). Their common mean, which a receiver bias absorbs, is not part of it."""

_BROADCAST_PAIRS = {
    SYSTEM_GPS: (("C1W", "C2W", "group_delay"),),
    SYSTEM_GALILEO: (
        ("C1X", "C5X", "group_delay"),
        ("C1C", "C5Q", "group_delay"),
        ("C1X", "C7X", "group_delay_secondary"),
        ("C1C", "C7Q", "group_delay_secondary"),
    ),
}

# End of a bias that is valid for ever; some 1900 years after 1980.
_LAST_WEEK = 100_000

COARSE_CODE_SIGMA = 1.2e-9
"""s; scatter of C1C-C1W over the satellites: GPS broadcasts no delay of C/A against P(Y)."""


class BiasFileError(ValueError):
    """A bias file cannot be read or has no bias for a time; the message names the file."""


@dataclass(frozen=True)
class CodeBias:
    """A code bias and the time for which it is valid.

    Parameters
    ----------
    system : int
        ``SYSTEM_*``.
    prn : int
        RINEX satellite number; 0 for a receiver.
    station : str
        Name of the receiver; empty for a satellite.
    first, second : str
        RINEX 3 observation codes of the pair; `second` is empty for an absolute bias (OSB).
    start, end : GpsTime
        First and last time for which the bias is valid.
    value, sigma : float
        Delay of the first signal minus that of the second, and its standard deviation as stated by
        the file, s.
    """

    system: int
    prn: int
    station: str
    first: str
    second: str
    start: GpsTime
    end: GpsTime
    value: float
    sigma: float


class CodeBiasTable:
    """Biases of many satellites and receivers.

    Parameters
    ----------
    biases : iterable of CodeBias
        The biases.
    origin : str
        Source of the biases, for example a file; error messages name it.
    """

    def __init__(self, biases: Iterable[CodeBias], origin: str = "code biases") -> None:
        self.origin = origin
        self.biases: tuple[CodeBias, ...] = tuple(biases)
        self._by_owner: dict[tuple[int, int, str], list[CodeBias]] = {}
        for bias in self.biases:
            self._by_owner.setdefault((bias.system, bias.prn, bias.station), []).append(bias)

    def __len__(self) -> int:
        """Return the number of biases."""
        return len(self.biases)

    @classmethod
    def joined(cls, tables: Sequence[CodeBiasTable]) -> CodeBiasTable:
        """Return the biases of several tables as one."""
        return cls(
            (bias for table in tables for bias in table.biases),
            ", ".join(table.origin for table in tables),
        )

    def at_all_times(self) -> CodeBiasTable:
        """Return the same biases without limits of time."""
        end = GpsTime.from_week_tow(_LAST_WEEK, 0.0)
        return CodeBiasTable(
            (dataclasses.replace(bias, start=GpsTime(0), end=end) for bias in self.biases),
            self.origin,
        )

    def is_valid(self, time: GpsTime, tolerance: float = 0.0) -> bool:
        """Return whether some bias is valid within `tolerance` (s) of a time."""
        return any(b.start - tolerance <= time <= b.end + tolerance for b in self.biases)

    def describe_age(self, time: GpsTime) -> str:
        """Return how many days biases of another time are away from `time`, as a sentence."""
        first = min(bias.start for bias in self.biases)
        last = max(bias.end for bias in self.biases)
        days = max(first - time, time - last) / SECONDS_PER_DAY
        return (
            f"{self.origin}: its biases are valid from {_day(first)} to {_day(last)}, "
            f"the observations are of {_day(time)}, {days:.0f} days away"
        )

    def require_valid(self, time: GpsTime, tolerance: float = 0.0) -> None:
        """Raise `BiasFileError` unless some bias is valid within `tolerance` (s) of a time."""
        if self.is_valid(time, tolerance):
            return
        if not self.biases:
            raise BiasFileError(f"{self.origin}: holds no code bias")
        raise BiasFileError(f"{self.describe_age(time)}; --allow-old-biases uses them")

    def satellite_bias(
        self, system: int, prn: int, first: str, second: str, time: GpsTime, tolerance: float = 0.0
    ) -> tuple[float, float]:
        """Return the bias first - second of a satellite and its sigma, s.

        Parameters
        ----------
        system, prn : int
            ``SYSTEM_*`` and RINEX satellite number.
        first, second : str
            RINEX 3 observation codes, e.g. ``"C1C"`` and ``"C2W"``.
        time : GpsTime
            Time for which the bias must be valid.
        tolerance : float
            Time before and after its validity during which a bias is still used, s.

        Returns
        -------
        value, sigma : float
            NaN if no chain of pairs connects the two signals.
        """
        return self._chain((system, prn, ""), first, second, time, tolerance)

    def receiver_bias(
        self,
        station: str,
        system: int,
        first: str,
        second: str,
        time: GpsTime,
        tolerance: float = 0.0,
    ) -> tuple[float, float]:
        """Return the bias first - second of a receiver and its sigma, s; see `satellite_bias`."""
        return self._chain((system, 0, station), first, second, time, tolerance)

    def _chain(
        self, owner: tuple[int, int, str], first: str, second: str, time: GpsTime, tolerance: float
    ) -> tuple[float, float]:
        """Return bias and sigma along the chain of pairs with the smallest variance, s.

        `owner` is the system, PRN and station that the biases belong to.
        """
        edges: dict[str, list[tuple[str, float, float]]] = {}
        # Integers, because a day of a station asks for some twenty thousand validities.
        latest_start = (time + tolerance).nanoseconds
        earliest_end = (time - tolerance).nanoseconds
        for bias in self._by_owner.get(owner, ()):
            if bias.start.nanoseconds <= latest_start and earliest_end <= bias.end.nanoseconds:
                variance = bias.sigma**2
                edges.setdefault(bias.first, []).append((bias.second, bias.value, variance))
                edges.setdefault(bias.second, []).append((bias.first, -bias.value, variance))
        # Dijkstra's algorithm over variances. Between biases without variance the chain with fewer
        # steps is preferred.
        queue: list[tuple[float, int, str, float]] = [(0.0, 0, first, 0.0)]
        visited: set[str] = set()
        while queue:
            variance, steps, signal, value = heapq.heappop(queue)
            if signal == second:
                return value, math.sqrt(variance)
            if signal in visited:
                continue
            visited.add(signal)
            for neighbour, step_value, step_variance in edges.get(signal, ()):
                entry = (variance + step_variance, steps + 1, neighbour, value + step_value)
                heapq.heappush(queue, entry)
        return math.nan, math.nan


def broadcast_code_biases(ephemerides: Sequence[BroadcastEphemeris]) -> CodeBiasTable:
    """Return the satellite biases that the navigation messages imply.

    GPS gives ``C1W - C2W`` from TGD; ``C1C - C1W`` is taken as zero with a sigma of 1.2 ns. Galileo
    gives E1 - E5a and E1 - E5b from its two BGD. The datum of these biases is that of the system,
    not that of a network solution: a receiver bias that is estimated with them differs by a
    constant from a bias that is estimated with a file.

    References
    ----------
    IS-GPS-200, 20.3.3.3.3.2; Galileo OS SIS ICD 2.1, 5.1.5: TGD = (t_first - t_second) /
    (1 - (f_first / f_second)^2).
    """
    biases = []
    for ephemeris in ephemerides:
        half = 0.5 * ephemeris.fit_interval
        for first, second, field in _BROADCAST_PAIRS.get(ephemeris.system, ()):
            if ephemeris.source == EPHEMERIS_SOURCE_FNAV and field == "group_delay_secondary":
                continue  # F/NAV does not tell the delay of E5b.
            frequency_first, frequency_second = carrier_frequency_hz(
                [ephemeris.system] * 2, [int(first[1]), int(second[1])]
            )
            value = getattr(ephemeris, field) * (1.0 - (frequency_first / frequency_second) ** 2)
            pairs = [(first, second, float(value), BROADCAST_SIGMA)]
            if ephemeris.system == SYSTEM_GPS:
                pairs.append(("C1C", "C1W", 0.0, COARSE_CODE_SIGMA))
            reference = ephemeris.time_of_ephemeris
            biases += [
                CodeBias(
                    system=ephemeris.system,
                    prn=ephemeris.prn,
                    station="",
                    first=signal_first,
                    second=signal_second,
                    start=reference - half,
                    end=reference + half,
                    value=bias,
                    sigma=sigma,
                )
                for signal_first, signal_second, bias, sigma in pairs
            ]
    systems = sorted({SYSTEM_LETTERS[bias.system] for bias in biases})
    return CodeBiasTable(biases, f"broadcast group delays ({', '.join(systems) or 'none'})")


def _day(time: GpsTime) -> str:
    return time.isoformat()[:10]
