"""Message ids of the NovAtel logs that are decoded, and the lengths of common ones.

Source: OEM7 Commands and Logs Reference Manual; checked on the definitions of novatel_edie.
"""

from __future__ import annotations

from typing import NamedTuple

ID_GPSEPHEM = 7
ID_VERSION = 37
ID_RAWEPHEM = 41
ID_BESTPOS = 42
ID_RANGE = 43
ID_SATVIS = 48
ID_ALMANAC = 73
ID_TRACKSTAT = 83
ID_TIME = 101
ID_RANGECMP = 140
ID_BESTXYZ = 241
ID_GLOEPHEMERIS = 723
ID_RANGECMP2 = 1273
ID_GALINAVEPHEMERIS = 1309
ID_GALFNAVEPHEMERIS = 1310
ID_ISMREDOBS = 1393
ID_ISMREDTEC = 1394
ID_RANGECMP4 = 2050
ID_RANGECMP5 = 2537

OBSERVATION_LOG_NAMES = {
    ID_RANGE: "RANGE",
    ID_RANGECMP: "RANGECMP",
    ID_RANGECMP2: "RANGECMP2",
    ID_RANGECMP4: "RANGECMP4",
    ID_RANGECMP5: "RANGECMP5",
}


class PayloadLayout(NamedTuple):
    """Length of a payload: `fixed` bytes and `stride` bytes for each of the counted elements."""

    fixed: int
    stride: int = 0
    count_offset: int = 0


PAYLOAD_LAYOUTS = {
    ID_GPSEPHEM: PayloadLayout(224),
    ID_VERSION: PayloadLayout(4, 108),
    ID_RAWEPHEM: PayloadLayout(102),
    ID_BESTPOS: PayloadLayout(72),
    ID_RANGE: PayloadLayout(4, 44),
    ID_SATVIS: PayloadLayout(12, 40, 8),
    ID_ALMANAC: PayloadLayout(4, 112),
    ID_TRACKSTAT: PayloadLayout(16, 40, 12),
    ID_TIME: PayloadLayout(44),
    ID_RANGECMP: PayloadLayout(4, 24),
    ID_BESTXYZ: PayloadLayout(112),
    ID_GLOEPHEMERIS: PayloadLayout(144),
    ID_RANGECMP2: PayloadLayout(4, 1),
    ID_ISMREDOBS: PayloadLayout(4, 56),
    ID_ISMREDTEC: PayloadLayout(4, 56),
    ID_RANGECMP4: PayloadLayout(4, 1),
    ID_RANGECMP5: PayloadLayout(4, 1),
}
"""Logs whose length follows from their content, so that a corrupted length shows at once."""
