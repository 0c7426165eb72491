"""Attitude of a rigid spacecraft: quaternions, orbit axes, magnetic field, body with wheel."""
