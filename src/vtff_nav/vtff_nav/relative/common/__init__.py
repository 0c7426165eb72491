"""What every relative estimator shares: measurements, dynamics, inputs and solutions."""
