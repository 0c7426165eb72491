"""Recordings as arrays: run folders, histories, observations, orbits, settings, true values."""
