"""Worlds of plasma and receivers, flown without ROS, and what the ionosphere chain tells."""
