"""Guidance of formations: reconfiguration by convex optimisation, keeping, phasing, clusters."""
