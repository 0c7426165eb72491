"""What every vtff node shares: parameters, QoS, diagnostics, lockstep, main loop."""
