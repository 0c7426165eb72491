"""Emulated thruster on a CAN bus."""
