"""Functions for daily use from plain Python, without ROS (docs/libraries.md)."""
