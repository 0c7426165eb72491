"""GNSS constants: system numbers, observation flags, carrier frequencies.

The numbers of systems, flags and ephemeris sources are those of the messages
``vtff_msgs/GnssObservations`` and ``vtff_msgs/GnssEphemeris``.
"""

from __future__ import annotations

SYSTEM_GPS = 0
SYSTEM_GLONASS = 1
SYSTEM_SBAS = 2
SYSTEM_GALILEO = 3
SYSTEM_BEIDOU = 4
SYSTEM_QZSS = 5
SYSTEM_NAVIC = 6

SYSTEM_LETTERS = "GRSECJI"
"""RINEX 3 letter of each system, at the index of its number."""

FLAG_CODE_VALID = 1
"""Code loop locked: the pseudorange may be used."""
FLAG_PHASE_VALID = 2
"""Phase loop locked: carrier phase and Doppler may be used."""
FLAG_PARITY_KNOWN = 4
"""Without it the carrier phase may be off by half a cycle."""
FLAG_HALF_CYCLE_ADDED = 8
"""The receiver has added half a cycle; a change between epochs is a half-cycle slip."""
FLAG_LOCK_LOST = 16
"""The lock time did not grow since the previous epoch: a cycle slip is possible."""

EPHEMERIS_SOURCE_LNAV = 0
EPHEMERIS_SOURCE_CNAV = 1
EPHEMERIS_SOURCE_INAV = 2
EPHEMERIS_SOURCE_FNAV = 3
EPHEMERIS_SOURCE_D1D2 = 4

GLONASS_CHANNEL_UNKNOWN = -128
"""Frequency channel of a GLONASS signal whose log does not tell it."""

GPS_MINUS_BDT = 14
"""GPS - BDT, s (BDS-SIS-ICD B1I 3.0, section 3.3: BDT began at 2006-01-01 00:00:00 UTC)."""

GPS_PI = 3.1415926535898
"""Pi as defined for the GPS user algorithms (IS-GPS-200, 20.3.3.4.3.3)."""

# Carrier frequencies, Hz: IS-GPS-200 3.3.1.1, IS-GPS-705, GLONASS ICD 5.1 (channel 0) and CDMA
# L3 ICD, Galileo OS SIS ICD table 2, BDS-SIS-ICD B1I/B1C/B2a/B2b/B3I, IS-QZSS-PNT/L6,
# NavIC SPS ICD.
FREQUENCY_L1 = 1575.42e6
FREQUENCY_L2 = 1227.60e6
FREQUENCY_L5 = 1176.45e6
FREQUENCY_E5B = 1207.14e6
FREQUENCY_E5 = 1191.795e6
FREQUENCY_E6 = 1278.75e6
FREQUENCY_B1I = 1561.098e6
FREQUENCY_B3I = 1268.52e6
FREQUENCY_GLONASS_L1 = 1602.0e6
FREQUENCY_GLONASS_L2 = 1246.0e6
FREQUENCY_GLONASS_L3 = 1202.025e6
FREQUENCY_STEP_GLONASS_L1 = 562.5e3
FREQUENCY_STEP_GLONASS_L2 = 437.5e3

IONOSPHERIC_DELAY_CONSTANT = 40.308193
"""e^2 / (8 pi^2 epsilon_0 m_e), m3/s2 (CODATA 2018): first-order delay in m times f^2 per electron
and square metre (IERS Conventions 2010, eq. 9.27)."""

ELECTRONS_PER_TECU = 1e16
"""Electrons per square metre in one TEC unit."""

DELAY_PER_TECU = IONOSPHERIC_DELAY_CONSTANT * ELECTRONS_PER_TECU
"""First-order delay of one TEC unit times the square of the frequency, m Hz2."""

GRAVITATIONAL_PARAMETER_BROADCAST = {SYSTEM_GPS: 3.986005e14, SYSTEM_GALILEO: 3.986004418e14}
"""m3/s2, by system, for broadcast elements only (IS-GPS-200 table 20-IV; Galileo OS SIS ICD)."""

EARTH_ROTATION_RATE_BROADCAST = 7.2921151467e-5
"""rad/s, for broadcast elements only (IS-GPS-200 table 20-IV; Galileo OS SIS ICD, same value)."""
