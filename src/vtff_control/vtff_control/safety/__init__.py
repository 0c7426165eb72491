"""Collision avoidance that trusts neither guidance nor controllers nor thrusters (no ROS)."""
