"""Emulated sensors of a spacecraft that decides alone: neighbours in range, and the own fix."""
