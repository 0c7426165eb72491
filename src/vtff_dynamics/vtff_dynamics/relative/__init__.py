"""Relative motion: states, relative orbital elements, transition, formation designs, impulses."""
