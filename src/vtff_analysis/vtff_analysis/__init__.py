"""Readers of recordings: reports, comparisons, exports, views, TEC, baselines and studies."""
