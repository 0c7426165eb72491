"""Scintillation: S4, sigma-phi, and the lag between two receivers."""
