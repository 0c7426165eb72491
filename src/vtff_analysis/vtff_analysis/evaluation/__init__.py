"""Evaluation of a run: its numbers, and its errors against truth, receiver and target."""
