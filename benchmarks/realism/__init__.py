"""Worlds that do not match the relative filter, flown without ROS (`bench_realism.py`)."""
