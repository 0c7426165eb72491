"""Time scales as exact integer nanoseconds."""
