"""Noise of code and phase, estimated from the measurements."""
