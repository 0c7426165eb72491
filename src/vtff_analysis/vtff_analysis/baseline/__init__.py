"""Relative positions of two recorded receivers, offline, by the filters of `vtff_nav.relative`."""
