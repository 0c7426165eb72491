"""A process among others: it ends in order when asked to, and when its runner is gone."""
