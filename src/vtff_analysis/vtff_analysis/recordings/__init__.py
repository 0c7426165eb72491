"""Recordings as arrays and domain objects: topics, histories, orbits, settings, truth files."""
