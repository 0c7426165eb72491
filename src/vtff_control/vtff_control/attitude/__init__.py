"""Attitude control with torquers and a pitch wheel: detumbling, compass mode, pointing, pulses."""
