"""Emulated NovAtel receivers: what they measure, the commands they obey, the logs they send."""
