"""Edges of irregularity regions, seen by one or two spacecraft."""
