"""Comparison of recorded runs: tables and overlaid plots."""
