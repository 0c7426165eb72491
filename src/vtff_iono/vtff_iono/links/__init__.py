"""Links from a satellite to a receiver: signal pairs, arcs and windows of samples."""
