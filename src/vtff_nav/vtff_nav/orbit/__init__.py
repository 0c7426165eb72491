"""Orbit of one spacecraft from the fixes of its receiver, on the ground."""
