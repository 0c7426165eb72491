"""Simulated GNSS: what receivers on the vehicles of a scenario measure and send."""
