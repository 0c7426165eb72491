"""Observation logs of NovAtel receivers (RANGE, RANGECMP to RANGECMP5) to columns."""
