"""Ionosphere logs of a GPStation-6 (GISTM): ISMREDTEC and ISMREDOBS, once a minute.

Layouts: NovAtel's own ParseReduced program and NovAtelLogReader (not in novatel_edie). System and
signal codes are other ones than those of RANGE.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.novatel.events import IsmScintillation, IsmSlantTec

__all__ = ["decode_ismredobs", "decode_ismredtec"]

_IDENTITY = [("prn", "u1"), ("glonass_channel", "i1"), ("system", "u1")]
_RED_TEC = np.dtype(
    [
        *_IDENTITY,
        ("first", "u1"), ("second", "u1"), ("reserved", "u1", 3),
        ("azimuth_deg", "<f4"), ("elevation_deg", "<f4"),
        ("second_lock_time", "<f4"), ("second_cn0_dbhz", "<f4"),
        ("tec", [("stec_tecu", "<f4"), ("change_tecu", "<f4")], 4),
    ]
)  # fmt: skip
_RED_OBS = np.dtype(
    [
        *_IDENTITY,
        ("signal", "u1"), ("azimuth_deg", "<f4"), ("elevation_deg", "<f4"),
        ("cn0_dbhz", "<f4"), ("lock_time", "<f4"), ("cmc_mean", "<f4"), ("cmc_sigma", "<f4"),
        ("s4_total", "<f4"), ("s4_correction", "<f4"), ("sigma_phi", "<f4", 5),
    ]
)  # fmt: skip
#: Instants of the TEC values of a log, s before its time.
_TEC_AGES = (45, 30, 15, 0)

#: Signal codes of the other systems are not public; their signals are left out and counted.
_SYSTEM_BY_CODE = {0: c.SYSTEM_GPS, 5: c.SYSTEM_GALILEO}
_SYSTEM_UNKNOWN = 255
#: RINEX frequency digit and tracking attribute of (system, signal code of the ISM logs).
_SIGNALS = {
    (c.SYSTEM_GPS, 1): (1, "C"),
    (c.SYSTEM_GPS, 4): (2, "W"),
    (c.SYSTEM_GPS, 5): (2, "L"),
    (c.SYSTEM_GPS, 6): (2, "P"),
    (c.SYSTEM_GPS, 7): (5, "Q"),
    (c.SYSTEM_GALILEO, 1): (1, "C"),
    (c.SYSTEM_GALILEO, 2): (5, "Q"),
    (c.SYSTEM_GALILEO, 3): (7, "Q"),
    (c.SYSTEM_GALILEO, 4): (8, "Q"),
}


def decode_ismredtec(payload: bytes, time: GpsTime) -> tuple[list[IsmSlantTec], int]:
    """Return the TEC of an ISMREDTEC payload, one event for each 15 s, oldest first.

    Without a usable pair there is none.

    Parameters
    ----------
    payload : bytes
        Without header and checksum.
    time : GpsTime
        Time of the header: the last instant of the log.

    Returns
    -------
    list of IsmSlantTec, int
        And the number of pairs left out because system or signals have no RINEX name.

    Raises
    ------
    ValueError
        If the payload is shorter than its count says.
    """
    rows = _rows(payload, _RED_TEC)
    system = _systems(rows)
    first, _ = _signals(system, rows["first"])
    second, _ = _signals(system, rows["second"])
    kept = (first > 0) & (second > 0)
    rows, system = rows[kept], system[kept]
    if not len(rows):
        return [], len(kept)
    events = [
        IsmSlantTec(
            time=time - float(age),
            system=system,
            prn=rows["prn"].copy(),
            band_first=first[kept],
            band_second=second[kept],
            stec_tecu=rows["tec"]["stec_tecu"][:, index].astype(np.float64),
            stec_change_tecu=rows["tec"]["change_tecu"][:, index].astype(np.float64),
            azimuth=np.radians(rows["azimuth_deg"].astype(np.float64)),
            elevation=np.radians(rows["elevation_deg"].astype(np.float64)),
        )
        for index, age in enumerate(_TEC_AGES)
    ]
    return events, int(np.count_nonzero(~kept))


def decode_ismredobs(payload: bytes, time: GpsTime) -> tuple[IsmScintillation, int]:
    """Return the indices of an ISMREDOBS payload, and the number of signals left out.

    Raises
    ------
    ValueError
        If the payload is shorter than its count says.
    """
    rows = _rows(payload, _RED_OBS)
    system = _systems(rows)
    band, attribute = _signals(system, rows["signal"])
    kept = band > 0
    rows, system = rows[kept], system[kept]

    def column(name: str) -> npt.NDArray[np.float64]:
        return rows[name].astype(np.float64)

    event = IsmScintillation(
        time=time,
        system=system,
        prn=rows["prn"].copy(),
        band=band[kept],
        attribute=attribute[kept],
        s4_total=column("s4_total"),
        s4_correction=column("s4_correction"),
        sigma_phi=column("sigma_phi"),
        cn0_dbhz=column("cn0_dbhz"),
        lock_time=column("lock_time"),
        code_minus_carrier_mean=column("cmc_mean"),
        code_minus_carrier_sigma=column("cmc_sigma"),
        azimuth=np.radians(column("azimuth_deg")),
        elevation=np.radians(column("elevation_deg")),
    )
    return event, int(np.count_nonzero(~kept))


def _rows(payload: bytes, layout: np.dtype[np.void]) -> npt.NDArray[np.void]:
    count = int.from_bytes(payload[:4], "little")
    if len(payload) < 4 + count * layout.itemsize:
        raise ValueError(f"{count} records of {layout.itemsize} bytes in {len(payload)} bytes")
    return np.frombuffer(payload, layout, count, offset=4)


def _systems(rows: npt.NDArray[np.void]) -> npt.NDArray[np.uint8]:
    """Return ``SYSTEM_*`` of each row."""
    codes = rows["system"].tolist()
    return np.array([_SYSTEM_BY_CODE.get(code, _SYSTEM_UNKNOWN) for code in codes], dtype=np.uint8)


def _signals(
    system: npt.NDArray[np.uint8], codes: npt.NDArray[np.uint8]
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Return RINEX frequency digit and attribute; digit 0 where the signal has no name."""
    named = [
        _SIGNALS.get(key, (0, "\0")) for key in zip(system.tolist(), codes.tolist(), strict=True)
    ]
    bands = np.array([band for band, _ in named], dtype=np.uint8)
    return bands, np.array([ord(attribute) for _, attribute in named], dtype=np.uint8)
