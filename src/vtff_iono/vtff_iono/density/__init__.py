"""Electron density between two spacecraft, and the integers that it rests on."""
