"""GNSS signals, ephemerides and receiver log codec (library, no ROS)."""
