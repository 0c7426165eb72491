"""Time scales, frames, orbit propagation and relative motion (library, no ROS)."""
