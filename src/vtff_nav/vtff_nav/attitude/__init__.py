"""Attitude from a magnetometer: multiplicative filter, bank of starts, rate-and-dipole filter."""
