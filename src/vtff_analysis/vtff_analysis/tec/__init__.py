"""Total electron content of recorded receivers: `vtff tec`."""
