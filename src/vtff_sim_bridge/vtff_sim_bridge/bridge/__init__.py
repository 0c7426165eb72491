"""The bridge to SimGEN: one run of it, and the thrust that acts in each step."""
