"""Receiver driver and relative navigation."""
