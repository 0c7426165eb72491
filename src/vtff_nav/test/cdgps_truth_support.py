"""Integers and slant TEC of the emulated receivers, and what a solution makes of them."""

from __future__ import annotations

import bisect
from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from vtff_gnss.constants import SYSTEM_LETTERS
from vtff_gnss.signals import satellite_name
from vtff_nav.relative.common.solution import AMBIGUITY_FLOAT, RelativeSolution
from vtff_sim_bridge.receiver.truth_file import TruthFile

__all__ = ["TruthRecorder", "longest_run", "tec_errors", "wrong_integers"]


class TruthRecorder(TruthFile):
    """Truth of a run, kept in memory as far as the tests of the relative filter need it.

    Attributes
    ----------
    arcs : dict of (receiver, satellite, signal) to (list of float, list of float)
        Times (s into the run) and cycles from then on, in the order of time.
    slant_tec_tecu : dict of (receiver, int) to dict of str to float
        By receiver and second: that of each tracked satellite.
    """

    def __init__(self) -> None:
        super().__init__(None)
        self.arcs: dict[tuple[str, str, str], tuple[list[float], list[float]]] = defaultdict(
            lambda: ([], [])
        )
        self.slant_tec_tecu: dict[tuple[str, int], dict[str, float]] = {}

    @property
    def is_wanted(self) -> bool:
        """Whether records are kept."""
        return True

    def write(self, record: str, **fields: Any) -> None:
        """Keep a record of kind ``arc`` or ``second``."""
        if record == "arc":
            key = (fields["receiver"], fields["satellite"], fields["signal"])
            times, cycles = self.arcs[key]
            times.append(fields["time"])
            cycles.append(fields["cycles"])
        elif record == "second":
            content = zip(fields["satellites"], fields["slant_tec_tecu"], strict=True)
            self.slant_tec_tecu[fields["receiver"], round(fields["time"])] = dict(content)

    def cycles(self, receiver: str, satellite: str, signal: str, second: float) -> float:
        """Return what the phase of a signal is greater by than the range, cycles."""
        times, cycles = self.arcs[receiver, satellite, signal]
        return cycles[bisect.bisect_right(times, second) - 1]


def wrong_integers(truth: TruthRecorder, second: float, solution: RelativeSolution) -> list[str]:
    """Return the fixed ambiguities of an epoch that are not the true ones.

    Single differences of the emulator's cycles stand against the integers of the table. Within a
    signal all must be off by the same whole number, the reference's: whoever is not with the most
    is wrong.
    """
    table = solution.ambiguities
    offsets: dict[str, dict[str, float]] = defaultdict(dict)
    for row in np.flatnonzero(table.state != AMBIGUITY_FLOAT).tolist():
        system = int(table.system[row])
        satellite = satellite_name(system, int(table.prn[row]))
        signal = f"{SYSTEM_LETTERS[system]}{table.band[row]}{chr(table.attribute[row])}"
        deputy, chief = (truth.cycles(n, satellite, signal, second) for n in ("deputy", "chief"))
        offsets[signal][satellite] = float(table.ambiguity_cycles[row]) - (deputy - chief)
    wrong = []
    for signal, offset_of_satellite in offsets.items():
        common, _ = Counter(offset_of_satellite.values()).most_common(1)[0]
        wrong += [
            f"{satellite} {signal} {offset - common:+g}"
            for satellite, offset in offset_of_satellite.items()
            if offset != common
        ]
    return wrong


def longest_run(wrong: Sequence[Sequence[str]]) -> int:
    """Return for how many consecutive epochs any one signal was wrong."""
    longest, lasting = 0, Counter[str]()
    for names in wrong:
        signals = {" ".join(name.split()[:2]) for name in names}
        lasting = Counter({signal: lasting[signal] + 1 for signal in signals})
        longest = max(longest, *lasting.values(), 0)
    return longest


def tec_errors(
    truth: TruthRecorder, second: int, solution: RelativeSolution
) -> tuple[np.ndarray, np.ndarray]:
    """Return errors and sigmas of the differential slant TEC of an epoch, TECU, shape (n,)."""
    table = solution.differential_tec
    chief, deputy = (truth.slant_tec_tecu[name, second] for name in ("chief", "deputy"))
    names = list(map(satellite_name, table.system.tolist(), table.prn.tolist()))
    true = np.array([deputy[name] - chief[name] for name in names])
    return table.stec_tecu - true, table.stec_sigma_tecu
