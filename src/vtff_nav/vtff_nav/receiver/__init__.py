"""Receivers on ports, sockets and in log files: sessions, commands and feeds of the driver."""
