"""The Kalman filter of the density between two spacecraft: its compiled steps and their tables."""
