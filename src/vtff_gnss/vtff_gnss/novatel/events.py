"""Events that a receiver log stream yields."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris, GlonassEphemeris
from vtff_gnss.fix import Fix, ReceiverTime
from vtff_gnss.observations import ObservationEpoch

__all__ = [
    "CommandResponse",
    "Event",
    "IsmScintillation",
    "IsmSlantTec",
    "RawLog",
    "ReceiverVersion",
]


@dataclass(frozen=True)
class RawLog:
    """One receiver log exactly as received (``vtff_msgs/ReceiverLog``).

    Parameters
    ----------
    time : GpsTime or None
        Time in the log header; None where the receiver did not know it.
    name : str
        Log name with its format suffix, e.g. ``"RANGEB"``; ``"LOG<id>B"`` for an unknown id.
    log_id : int
        Message id in the receiver's protocol.
    content : bytes
        All bytes, framing and checksum included.
    """

    time: GpsTime | None
    name: str
    log_id: int
    content: bytes


@dataclass(frozen=True)
class CommandResponse:
    """The receiver's answer to a command.

    Parameters
    ----------
    is_ok : bool
        The command was accepted.
    text : str
        The answer, e.g. ``"OK"`` or ``"ERROR:Invalid Message. Field = BESTGP"``.
    command : str
        Name of the command; empty for abbreviated answers, which do not tell it.
    """

    is_ok: bool
    text: str
    command: str = ""


@dataclass(frozen=True)
class ReceiverVersion:
    """The receiver card as the VERSION log names it.

    Parameters
    ----------
    time : GpsTime or None
        Time in the log header; None where the receiver did not know it.
    model, serial_number, hardware_version, software_version : str
        As told by the receiver, without padding.
    """

    time: GpsTime | None
    model: str
    serial_number: str
    hardware_version: str
    software_version: str


@dataclass(frozen=True)
class IsmSlantTec:
    """Slant TEC that a GPStation-6 has formed (one instant of an ISMREDTEC log).

    Parameters
    ----------
    time : GpsTime
        Instant of the TEC.
    system, prn : ndarray of uint8, shape (n,)
        ``SYSTEM_*`` of `vtff_gnss.constants`; satellite number.
    band_first, band_second : ndarray of uint8, shape (n,)
        RINEX frequency digits of the pair.
    stec_tecu : ndarray of float, shape (n,)
        Slant TEC, code smoothed by phase, with the receiver's own biases, TECU.
    stec_change_tecu : ndarray of float, shape (n,)
        Change since 15 s before, from the phases, TECU.
    azimuth, elevation : ndarray of float, shape (n,)
        rad, from the site that the receiver takes for its own.
    """

    time: GpsTime
    system: npt.NDArray[np.uint8]
    prn: npt.NDArray[np.uint8]
    band_first: npt.NDArray[np.uint8]
    band_second: npt.NDArray[np.uint8]
    stec_tecu: npt.NDArray[np.float64]
    stec_change_tecu: npt.NDArray[np.float64]
    azimuth: npt.NDArray[np.float64]
    elevation: npt.NDArray[np.float64]


@dataclass(frozen=True)
class IsmScintillation:
    """Scintillation indices that a GPStation-6 has formed over 60 s (ISMREDOBS log).

    Parameters
    ----------
    time : GpsTime
        End of the window.
    system, prn, band, attribute : ndarray of uint8, shape (n,)
        Signal as in `vtff_gnss.observations.ObservationEpoch`.
    s4_total, s4_correction : ndarray of float, shape (n,)
        Index of all intensity variation, and the part that thermal noise has in it.
    sigma_phi : ndarray of float, shape (n, 5)
        Deviation of the detrended phase over the last 1, 3, 10, 30 and 60 s, rad.
    cn0_dbhz, lock_time : ndarray of float, shape (n,)
        dB-Hz, s.
    code_minus_carrier_mean, code_minus_carrier_sigma : ndarray of float, shape (n,)
        m.
    azimuth, elevation : ndarray of float, shape (n,)
        rad.
    """

    time: GpsTime
    system: npt.NDArray[np.uint8]
    prn: npt.NDArray[np.uint8]
    band: npt.NDArray[np.uint8]
    attribute: npt.NDArray[np.uint8]
    s4_total: npt.NDArray[np.float64]
    s4_correction: npt.NDArray[np.float64]
    sigma_phi: npt.NDArray[np.float64]
    cn0_dbhz: npt.NDArray[np.float64]
    lock_time: npt.NDArray[np.float64]
    code_minus_carrier_mean: npt.NDArray[np.float64]
    code_minus_carrier_sigma: npt.NDArray[np.float64]
    azimuth: npt.NDArray[np.float64]
    elevation: npt.NDArray[np.float64]


Event = (
    ObservationEpoch
    | BroadcastEphemeris
    | GlonassEphemeris
    | Fix
    | ReceiverTime
    | RawLog
    | CommandResponse
    | ReceiverVersion
    | IsmSlantTec
    | IsmScintillation
)
"""Any event of a receiver log stream."""
