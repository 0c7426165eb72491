"""Attitude without ROS: closed loop of one spacecraft, and the cases of the SNAP-1 study."""
