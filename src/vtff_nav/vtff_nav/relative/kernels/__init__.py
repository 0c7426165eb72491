"""Compiled arithmetic of an epoch: what would be hundreds of array operations on a dozen signals.

Each function takes and returns arrays and numbers. `vtff_nav.relative.synthetic_epochs` has
them compiled before the first epoch of a node.
"""
