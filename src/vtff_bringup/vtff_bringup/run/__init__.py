"""Running of a system: processes, progress, comparison of outputs, exit codes."""
