"""Signals behind the observation types of RINEX 2, 3 and 4.

RINEX 3 names band and tracking attribute in every type (RINEX 3.05, tables 4 to 10). RINEX 2 does
not: its types are mapped to the signal that receivers mean by them (RINEX 2.11, section 5.1).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

__all__ = ["RINEX2_ATTRIBUTES", "SignalColumns", "signal_columns"]

RINEX2_ATTRIBUTES: dict[str, dict[str, str]] = {
    "G": {"C1": "1C", "P1": "1W", "C2": "2X", "P2": "2W", "C5": "5X"},
    "R": {"C1": "1C", "P1": "1P", "C2": "2C", "P2": "2P", "C3": "3X"},
    "E": {"C1": "1X", "C5": "5X", "C6": "6X", "C7": "7X", "C8": "8X"},
    "S": {"C1": "1C", "C5": "5X"},
    "J": {"C1": "1C", "C2": "2X", "C5": "5X", "C6": "6X"},
    "C": {"C1": "2I", "C2": "2I", "C6": "6I", "C7": "7I"},
    "I": {"C5": "5A"},
}
"""Band and attribute of the code types of RINEX 2, by system letter.

P1 and P2 of GPS are tracked without the key (W), C2 is L2C of both components (X). Types that are
not listed are left out.
"""

# Phase, Doppler and strength of a band belong to one of its codes: to the first that the file has.
_CARRIER_PRIORITY = {"1": ("C1", "P1"), "2": ("P2", "C2")}
# The pseudorange types of RINEX 2.20 and 2.12 name the C/A code A.
_CIVIL_TYPES = {"CA": "C1", "LA": "L1", "DA": "D1", "SA": "S1"}
_UNUSED = -1


class SignalColumns(NamedTuple):
    """One signal, and which element of a satellite's record holds each of its values; -1: none."""

    band: int
    attribute: str
    code: int
    phase: int
    doppler: int
    strength: int


def signal_columns(
    letter: str,
    types: tuple[str, ...],
    version: float,
    rinex2_attributes: Mapping[str, Mapping[str, str]] = RINEX2_ATTRIBUTES,
) -> list[SignalColumns]:
    """Return the signals of a system, in the order in which the types name them first.

    Parameters
    ----------
    letter : str
        RINEX letter of the system.
    types : tuple of str
        Observation types in the order of the record.
    version : float
        RINEX version.
    rinex2_attributes : mapping
        As `RINEX2_ATTRIBUTES`.
    """
    columns_of_signal: dict[str, dict[str, int]] = {}
    if version < 3.0:
        named = _named_types_2(letter, types, rinex2_attributes.get(letter, {}))
    else:
        named = [(_signal_3(letter, name[1:], version), name[0]) for name in types]
    for column, (signal, quantity) in enumerate(named):
        if signal and quantity in "CLDS" and signal[0].isdigit():
            columns_of_signal.setdefault(signal, {}).setdefault(quantity, column)
    return [
        SignalColumns(int(s[0]), s[1], *(columns.get(q, _UNUSED) for q in "CLDS"))
        for s, columns in columns_of_signal.items()
        if columns.keys() & set("CLD")
    ]


def _signal_3(letter: str, signal: str, version: float) -> str:
    """Undo the names that BeiDou B1I had before RINEX 3.03 (RINEX 3.05, table 9, note)."""
    if letter == "C" and (signal in ("1I", "1Q") or (signal == "1X" and version < 3.04)):
        return "2" + signal[1]
    return signal


def _named_types_2(
    letter: str, types: tuple[str, ...], attributes: Mapping[str, str]
) -> list[tuple[str, str]]:
    """Return (signal, quantity) of RINEX 2 types; an empty signal for types that are left out."""
    has_civil = "LA" in types or "CA" in types
    civil = [_CIVIL_TYPES.get(name, name) for name in types]
    named = []
    for name, renamed in zip(types, civil, strict=True):
        quantity, band = renamed[0], renamed[1]
        if quantity in "CP":
            named.append((attributes.get(renamed, ""), "C"))
            continue
        codes = _CARRIER_PRIORITY.get(band, (f"C{band}",))
        if name in _CIVIL_TYPES:
            codes = ("C1",)
        elif has_civil and band == "1":
            # Beside a separate type for the C/A carrier, L1 is the carrier phase of the P code.
            codes = ("P1",)
        present = [code for code in codes if code in civil and code in attributes]
        present = present or [code for code in codes if code in attributes]
        named.append((attributes[present[0]] if present else "", quantity))
    return named
