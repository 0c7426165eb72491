"""Plug-ins of installed packages: found by entry point, called with a time limit."""
