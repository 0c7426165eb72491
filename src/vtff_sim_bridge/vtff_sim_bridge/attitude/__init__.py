"""The emulated ADCS module: magnetometer, torquer pulses, wheel, the attitude that they turn."""
