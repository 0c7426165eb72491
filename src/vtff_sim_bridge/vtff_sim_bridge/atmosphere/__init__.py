"""Ionosphere of the GNSS emulator: density profiles, slant TEC, irregularities, scintillation."""
