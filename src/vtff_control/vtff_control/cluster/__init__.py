"""Clusters in which every chaser decides alone: its tracks, the potential field, its rhythm."""
