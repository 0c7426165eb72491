"""Orbits of one spacecraft: elements, gravity, forces and propagation."""
