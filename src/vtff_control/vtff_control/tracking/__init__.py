"""Tracking of a target by feedback: SDRE control and its Riccati gains (no ROS)."""
