"""Shared observation files, small observation files as text, and comparisons of tables."""

from __future__ import annotations

import functools
import pathlib

import numpy as np
from constellation_test_support import shared_file
from shared_data import shared_folder

from vtff_gnss.constants import SYSTEM_LETTERS
from vtff_gnss.observation_table import ObservationTable, signal_keys
from vtff_gnss.rinex.observation import RinexObservations, read_rinex_observation

NAVIGATION = shared_folder() / "data/navigation"
LEO = NAVIGATION / "leo_250m/250m_A.obs.gz"
SPIRENT_BASE = NAVIGATION / "spirent_dynamic/Base-static_MO_Spirent.obs.gz"
BELE = shared_folder() / "data/ionosphere/bele_2024010/BELE00BRA_R_20240100000_01D_30S_MO.crx.gz"
REAL_FILES = {"leo_250m": LEO, "spirent_dynamic": SPIRENT_BASE, "bele": BELE}


@functools.lru_cache(maxsize=3)
def real_observations(name: str) -> RinexObservations:
    return read_rinex_observation(shared_file(REAL_FILES[name]))


def header_line(text: str, label: str) -> str:
    return f"{text:<60}{label}\n"


def header_3(*lines: str, version: str = "3.05", system: str = "M") -> str:
    """Return a header of RINEX 3 or 4; further lines as (text, label) already joined."""
    first = f"{version:>9}{'':11}{'OBSERVATION DATA':<20}{system}"
    return (
        header_line(first, "RINEX VERSION / TYPE")
        + "".join(lines)
        + header_line("", "END OF HEADER")
    )


def types_3(letter: str, *types: str) -> str:
    return header_line(f"{letter}{len(types):5d} " + " ".join(types), "SYS / # / OBS TYPES")


def header_2(*types: str, version: str = "2.11", system: str = "M") -> str:
    first = f"{version:>9}{'':11}{'OBSERVATION DATA':<20}{system}"
    lines = header_line(first, "RINEX VERSION / TYPE")
    for start in range(0, len(types), 9):
        count = f"{len(types):6d}" if start == 0 else " " * 6
        names = "".join(f"{name:>6}" for name in types[start : start + 9])
        lines += header_line(count + names, "# / TYPES OF OBSERV")
    return lines + header_line("", "END OF HEADER")


def value(number: float | None, lock: int | str = " ", strength: int | str = " ") -> str:
    return f"{number:14.3f}{lock}{strength}" if number is not None else f"{'':14}{lock}{strength}"


def epoch_3(second: float, count: int, kind: int = 0, minute: int = 0, clock: str = "") -> str:
    return f"> 2024 01 10 00 {minute:02d}{second:11.7f}  {kind}{count:3d}{clock}\n"


def read_text(tmp_path: pathlib.Path, text: str, **options) -> RinexObservations:
    path = tmp_path / "some.rnx"
    path.write_text(text, encoding="ascii")
    return read_rinex_observation(path, **options)


def names(table: ObservationTable) -> list[str]:
    """Return for example ``"G05 1C"`` for every row."""
    columns = table.columns
    return [
        f"{SYSTEM_LETTERS[system]}{prn:02d} {band}{chr(attribute)}"
        for system, prn, band, attribute in zip(
            *(columns[name] for name in ("system", "prn", "band", "attribute")), strict=True
        )
    ]


def in_order_of_signals(table: ObservationTable) -> dict[str, np.ndarray]:
    """Return the columns, epoch by epoch in one order of signals."""
    order = np.lexsort((signal_keys(table.columns), table.epoch_index))
    columns = {name: column[order] for name, column in table.columns.items()}
    return {"epoch": table.epoch_index[order], **columns}


def assert_same_rows(first: ObservationTable, second: ObservationTable) -> None:
    """Compare all columns but for the order of signals within an epoch."""
    np.testing.assert_array_equal(first.time_nanoseconds, second.time_nanoseconds)
    ours, theirs = in_order_of_signals(first), in_order_of_signals(second)
    for name, column in ours.items():
        np.testing.assert_array_equal(column, theirs[name], err_msg=name)
