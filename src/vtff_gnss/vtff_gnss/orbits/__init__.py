"""Orbits and clocks of GNSS satellites, and the lines of sight to them."""
