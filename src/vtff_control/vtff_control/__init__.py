"""Formation controller and thrusters."""
