"""Base of every vtff node: parameters, QoS, diagnostics, lockstep, conversions, main loop."""
