"""Scenario files, and the true motion of the formation that they describe."""
