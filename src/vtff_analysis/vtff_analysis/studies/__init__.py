"""Parameter studies on the in-process closed loop."""
