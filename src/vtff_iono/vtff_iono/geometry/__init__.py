"""Geometry of signals in the ionosphere: pierce points, mapping to the vertical."""
