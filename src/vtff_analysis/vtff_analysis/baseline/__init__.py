"""Relative positions of two recorded receivers, by the filters of `vtff_nav.relative`."""
