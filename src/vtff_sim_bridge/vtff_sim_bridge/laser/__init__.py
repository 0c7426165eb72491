"""Emulated laser ranging between two spacecraft."""
