"""Compiled arithmetic of an epoch: what would be hundreds of array operations on a dozen signals.

Each function takes and returns arrays and numbers. `vtff_nav.relative.rehearsal` compiles all of
them before the first epoch of a node.
"""
