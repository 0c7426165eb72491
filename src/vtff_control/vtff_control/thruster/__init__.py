"""Thrusters: delay, cap and quantum of a command, and thrusters on a CAN bus (no ROS)."""
