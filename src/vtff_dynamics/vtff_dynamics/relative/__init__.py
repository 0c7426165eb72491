"""Relative motion of two spacecraft."""
