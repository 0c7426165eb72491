"""Receivers on ports, sockets and in log files: sessions, commands and the feeds of the driver."""
