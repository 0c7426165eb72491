"""Parts that relative estimators share: measurements, dynamics, inputs and solutions."""
