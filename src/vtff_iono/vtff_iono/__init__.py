"""Ionosphere processing: total electron content, scintillation, electron density."""
