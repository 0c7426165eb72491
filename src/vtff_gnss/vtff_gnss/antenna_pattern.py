"""Gain of antennas against the angle from boresight."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vtff_dynamics.compiled import compiled

__all__ = ["ParabolicPattern", "parabolic_gain_db"]


@dataclass(frozen=True)
class ParabolicPattern:
    """Axially symmetric pattern whose gain in dB falls with the square of the angle.

    ``gain = boresight_gain_db - min(12 (angle / half_power_beamwidth)^2, front_to_back_db)``, the
    usual model of a single main lobe (3GPP TR 36.942, section 4.2.1, with its maximum
    attenuation). The defaults are those of a hemispherical patch antenna: 5 dBic at boresight,
    -4 dBic at the horizon.

    Parameters
    ----------
    boresight_gain_db : float
        dBic.
    half_power_beamwidth : float
        rad; full width, at which the gain is 3 dB down on both sides.
    front_to_back_db : float
        dB; largest attenuation.

    Raises
    ------
    ValueError
        If the beamwidth is not positive or the front-to-back ratio is negative.
    """

    boresight_gain_db: float = 5.0
    half_power_beamwidth: float = math.radians(104.0)
    front_to_back_db: float = 20.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        if not self.half_power_beamwidth > 0.0:
            raise ValueError(f"half_power_beamwidth {self.half_power_beamwidth}: must be positive")
        if not self.front_to_back_db >= 0.0:
            raise ValueError(f"front_to_back_db {self.front_to_back_db}: must not be negative")


@compiled
def parabolic_gain_db(  # type: ignore[no-untyped-def]
    off_boresight, boresight_gain_db, half_power_beamwidth, front_to_back_db
):
    """Return the gain in dB of a `ParabolicPattern` at an angle from boresight in rad."""
    ratio = off_boresight / half_power_beamwidth
    return boresight_gain_db - min(12.0 * (ratio * ratio), front_to_back_db)
