"""Bags in the formats of other programs: tables, RINEX, orbits, CZML."""
